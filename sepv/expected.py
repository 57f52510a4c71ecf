"""Expected failures: a TOML file of laws that a scheme is known to break, each with a reason and a witness.

Each entry is checked by its witness and not by search, so that it costs one measurement and is never flaky. It
is strict both ways: a violation that is not listed fails the run, and so does an entry that no longer fails.

    [[expected]]
    law = "casimir"
    reason = "B is taken at y_n in the drift"
    witness = "eNp1j88K…"        # as printed after --replay; for statistical laws a table { seed, paths }
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sepv import case as cases
from sepv.errors import UsageError
from sepv.law import Finding, Verdict

_ENTRY = {"law", "reason", "witness"}
_EXAMPLE = (
    '[[expected]] with law = "…", reason = "…", witness = "…"; `--write-expected FILE` makes a first one'
)


@dataclass(frozen=True)
class ExpectedFailure:
    """One entry: the law, why it fails, and the witness as JSON."""

    law: str
    reason: str
    witness: dict[str, Any]


def load(path: str | Path, laws: Iterable[str]) -> dict[str, ExpectedFailure]:
    """The entries of a file, by law.

    Raises
    ------
    UsageError
        For a file that is missing or not TOML, an unknown or repeated law, a missing reason or witness.
    """
    try:
        data = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(
            expected="a file of expected failures", received=f"{path}: {error.strerror}", remedy=_EXAMPLE
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(expected=f"TOML in {path}", received=str(error), remedy=_EXAMPLE) from error
    entries = data.get("expected", [])
    if set(data) - {"expected", "scheme"} or not isinstance(entries, list):
        raise UsageError(
            expected=f"tables [[expected]] in {path}", received=f"keys {sorted(data)}", remedy=_EXAMPLE
        )
    known, found = set(laws), {}
    for number, entry in enumerate(entries, start=1):
        failure = _entry(entry, f"{path}, entry {number}", known)
        if failure.law in found:
            raise UsageError(
                expected="each law once", received=f"{failure.law!r} twice in {path}", remedy="keep one entry"
            )
        found[failure.law] = failure
    return found


def _entry(entry: Any, where: str, known: set[str]) -> ExpectedFailure:
    if not isinstance(entry, dict) or set(entry) != _ENTRY:
        keys = sorted(entry) if isinstance(entry, dict) else type(entry).__name__
        raise UsageError(expected=f"law, reason and witness in {where}", received=f"{keys}", remedy=_EXAMPLE)
    law, reason, witness = entry["law"], entry["reason"], entry["witness"]
    if law not in known:
        raise UsageError(
            expected=f"a law in {where}, one of {', '.join(sorted(known))}",
            received=repr(law),
            remedy="correct the name",
        )
    if not isinstance(reason, str) or not reason.strip():
        raise UsageError(
            expected=f"a reason in {where}", received=repr(reason), remedy="say why this failure is expected"
        )
    if isinstance(witness, str):
        witness = cases.to_json(cases.from_token(witness))
    if not isinstance(witness, dict):
        raise UsageError(
            expected=f"a witness in {where}: a token or a table",
            received=f"{witness!r:.60}",
            remedy="copy what the report prints after --replay",
        )
    return ExpectedFailure(law, reason, witness)


def to_toml(scheme: str, findings: Iterable[Finding]) -> str:
    """A first file, from the violations of a report; the reasons are to be filled in by a person."""
    lines = [f"# Expected failures of {_line(scheme)}. Replace each reason by yours."]
    for f in findings:
        if f.verdict is not Verdict.VIOLATED or f.witness is None:
            continue
        size = "" if f.defect is None else f"{f.defect:.3g} {f.unit} against {f.bound:.3g}"
        lines += [
            "",
            "[[expected]]",
            f"law = {_quoted(f.law)}",
            f"reason = {_quoted('violated when this file was written: ' + size)}",
            f"witness = {_witness(f.witness)}",
        ]
    return "\n".join(lines) + "\n"


def _witness(witness: dict[str, Any]) -> str:
    if "problem" in witness:
        return _quoted(cases.to_token(cases.from_json(witness)))
    numbers = {k: v for k, v in witness.items() if isinstance(v, int)}
    return "{ " + ", ".join(f"{k} = {v}" for k, v in numbers.items()) + " }"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'


def _line(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)
