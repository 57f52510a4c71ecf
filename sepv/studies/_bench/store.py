"""Records of the benchmark in a file: JSON, hex floats, sorted so that a difference reads well."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from sepv.errors import UsageError
from sepv.schemes import Scheme
from sepv.studies._bench import measure as measuring

FORMAT = 1


def record(target: str, scheme: Scheme, cases: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """A target's record: its cases measured."""
    return {"target": target, "cases": [measuring.measure(scheme, case) for case in cases]}


def save(records: list[dict[str, Any]]) -> str:
    """The text of a file."""
    document = {"format": FORMAT, "environment": measuring.environment(), "records": records}
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def load(path: str) -> list[dict[str, Any]]:
    """The records of a file.

    Raises
    ------
    UsageError
        For a file that is not one of `save`.
    """
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8"))
        if document["format"] != FORMAT:
            raise ValueError(f"format {document['format']!r}")
        for entry in document["records"]:
            for case in entry["cases"]:
                _check(entry["target"], case)
    except (
        OSError,
        UnicodeDecodeError,
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        RecursionError,
    ) as error:
        raise UsageError(
            expected=f"a file that `sepv bench --save` wrote, of format {FORMAT}",
            received=f"{path}: {type(error).__name__}: {error}",
            remedy="save it again with this release",
        ) from error
    records: list[dict[str, Any]] = document["records"]
    return records


def _check(target: Any, case: Any) -> None:
    if not isinstance(target, str) or not isinstance(case["case"]["name"], str):
        raise TypeError("a name that is no text")
    if set(case["case"]) != {"name", "problem", "initial", "h", "steps", "paths", "seed", "portable"}:
        raise ValueError(f"the case {case['case']['name']} with {', '.join(case['case'])}")
    for name, count in case["counters"].items():
        if count is not None and not isinstance(count, int):
            raise TypeError(f"counter {name!r} = {count!r}")
    for kind in ("error", "energy", "casimir"):
        if len(case[kind]) != measuring.GROUPS:
            raise ValueError(f"{kind} in {len(case[kind])} groups")
        for value in case[kind]:
            float.fromhex(value)
