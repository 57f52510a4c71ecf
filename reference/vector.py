"""Reference vectors: one step, or one exact flow, with its result to 50 digits,
as an object and as JSON.

Their results are made by `python -m benchmarks.vectors` only; docs/vectors.md explains them to
readers in any language.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from sepv.reference.problem import Description

from sepv._arguments import hex_float, parse_json
from sepv.errors import UsageError
from sepv.problem import problem_from_json, problem_to_json

VECTOR_FOLDER = Path(__file__).parent / "vectors"
VECTOR_FORMAT = "sepv-vectors-1"
FLOW = "exact-flow"
VECTOR_DIGITS = 50
# A solver may refuse a case that has one of these flags, but it may not return a wrong result for
# it.
HARD_FLAGS = frozenset({"large-step", "near-fold", "subnormal", "huge", "overflow"})

_VECTOR_KEYS = {
    "id",
    "hash",
    "problem",
    "y",
    "y1",
    "y1_hex",
    "condition",
    "rounding",
    "flags",
    "proof",
    "note",
}
_REMEDY = "install sepv again; in a checkout, `git restore` brings back the file"


@dataclass(frozen=True)
class ReferenceVector:
    """One reference case and its result.

    Attributes
    ----------
    y, h, dW : binary64
        The step. For the exact flow h holds the time θ, and dW is empty.
    y1 : d strings of 50 significant digits
    y1_hex : d binary64 numbers
        The result y1, rounded to nearest.
    condition : float
        ‖∂y1/∂residual‖_∞.
    rounding : d floats
        The possible error of plain binary64 arithmetic (`benchmarks.vectors.rounding`).
    flags : words that classify the case
    proof : str
        The kind of proof: "krawczyk" for implicit schemes, "balls" for explicit schemes and the
        exact flow.
    note : str
        The purpose of the case.
    """

    id: str
    scheme: str
    problem: Description
    y: tuple[float, ...]
    h: float
    dW: tuple[float, ...]
    y1: tuple[str, ...]
    y1_hex: tuple[float, ...]
    condition: float
    rounding: tuple[float, ...]
    flags: tuple[str, ...]
    proof: str
    note: str

    @property
    def hard(self) -> bool:
        """True if a correct solver may refuse the case."""
        return bool(HARD_FLAGS & set(self.flags))


def to_json(vector: ReferenceVector) -> dict[str, Any]:
    """The case as a JSON object whose last member is its hash."""
    step: dict[str, Any] = (
        {"theta": vector.h.hex()}
        if vector.scheme == FLOW
        else {"h": vector.h.hex(), "dW": [w.hex() for w in vector.dW]}
    )
    data = {
        "id": vector.id,
        "note": vector.note,
        "flags": list(vector.flags),
        "problem": problem_to_json(vector.problem),
        "y": [v.hex() for v in vector.y],
        **step,
        "y1": list(vector.y1),
        "y1_hex": [v.hex() for v in vector.y1_hex],
        "condition": vector.condition,
        "rounding": list(vector.rounding),
        "proof": vector.proof,
    }
    return {**data, "hash": digest(data)}


def digest(data: dict[str, Any]) -> str:
    """The first 16 hex digits of the SHA-256 of the case as JSON without its hash, keys sorted,
    no spaces, ASCII.
    """
    text = json.dumps(
        {k: v for k, v in data.items() if k != "hash"},
        sort_keys=True,
        separators=(",", ":"),
        ensure_ascii=True,
    )
    return hashlib.sha256(text.encode("ascii")).hexdigest()[:16]


def schemes_with_vectors(folder: Path = VECTOR_FOLDER) -> list[str]:
    """The names of the schemes that have a file of vectors."""
    return sorted(p.stem for p in folder.glob("*.json") if not p.stem.endswith(".schema"))


@lru_cache(maxsize=64)
def load(scheme: str, folder: Path = VECTOR_FOLDER) -> tuple[ReferenceVector, ...]:
    """The test vectors of one scheme, after a check of format, keys, hashes and ids.

    Raises
    ------
    UsageError
        The message names the file, the case and its defect.
    """
    path = folder / f"{scheme}.json"
    try:
        data = parse_json(path.read_bytes())
    except (OSError, ValueError) as error:
        have = ", ".join(schemes_with_vectors(folder)) or "none"
        raise UsageError(
            expected=f"a file of reference vectors for {scheme} (there are: {have})",
            received=f"{path}: {error}",
            remedy=_REMEDY,
        ) from error
    if not isinstance(data, dict) or data.get("format") != VECTOR_FORMAT or data.get("scheme") != scheme:
        loaded = (
            {k: data.get(k) for k in ("format", "scheme")} if isinstance(data, dict) else type(data).__name__
        )
        raise UsageError(
            expected=f'{path} with "format": "{VECTOR_FORMAT}" and "scheme": "{scheme}"',
            received=f"{loaded}",
            remedy=_REMEDY,
        )
    vectors, seen = [], set()
    for case in data.get("cases", []):
        vector = _from_json(scheme, case, path)
        if vector.id in seen:
            raise UsageError(
                expected=f"each id once in {path}", received=f"{vector.id} twice", remedy=_REMEDY
            )
        seen.add(vector.id)
        vectors.append(vector)
    return tuple(vectors)


def _from_json(scheme: str, case: Any, path: Path) -> ReferenceVector:
    keys = _VECTOR_KEYS | ({"theta"} if scheme == FLOW else {"h", "dW"})
    name = case.get("id") if isinstance(case, dict) else None
    if not isinstance(case, dict) or set(case) != keys:
        odd = sorted(set(case) ^ keys) if isinstance(case, dict) else type(case).__name__
        raise UsageError(
            expected=f"cases with the keys {', '.join(sorted(keys))} in {path}",
            received=f"case {name!r} that differs in {odd}",
            remedy=_REMEDY,
        )
    if not isinstance(name, str) or not name.startswith(f"{scheme}/"):
        raise UsageError(expected=f"ids {scheme}/… in {path}", received=repr(name), remedy=_REMEDY)
    if case["hash"] != digest(case):
        raise UsageError(
            expected=f"case {name} of {path} with the hash of what it says, {digest(case)}",
            received=f"{case['hash']!r}: the case was changed",
            remedy=_REMEDY,
        )
    try:
        vector = ReferenceVector(
            id=name,
            scheme=scheme,
            problem=problem_from_json(case["problem"]),
            y=tuple(map(hex_float, case["y"])),
            h=hex_float(case["theta"] if scheme == FLOW else case["h"]),
            dW=tuple(map(hex_float, case.get("dW", ()))),
            y1=tuple(case["y1"]),
            y1_hex=tuple(map(hex_float, case["y1_hex"])),
            condition=float(case["condition"]),
            rounding=tuple(map(float, case["rounding"])),
            flags=tuple(case["flags"]),
            proof=case["proof"],
            note=case["note"],
        )
    except (TypeError, ValueError, KeyError) as error:
        raise UsageError(
            expected=f"case {name} of {path} as its schema says",
            received=f"{type(error).__name__}: {error}",
            remedy=_REMEDY,
        ) from error
    if not len(vector.y) == len(vector.y1) == len(vector.y1_hex) == len(vector.rounding):
        raise UsageError(
            expected=f"case {name} of {path} with as many components in y1, y1_hex and rounding as in y",
            received=f"{len(vector.y)}, {len(vector.y1)}, {len(vector.y1_hex)}, {len(vector.rounding)}",
            remedy=_REMEDY,
        )
    return vector
