"""The JSON files that a page is made of: which is which, and that each is what it says."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sepv.errors import UsageError
from sepv.files import fault, schema

# A key that tells a file's kind, and whether the files of a kind are reports on a scheme, comparisons, …
KINDS = {"suite": "verify", "reproduction": "reproduce", "times_to_error": "compare", "records": "bench"}
# Larger files are no report of this package.
LARGEST = 64 * 2**20


@dataclass
class Sources:
    """What was read, by kind, in the order of the files."""

    verify: list[dict[str, Any]] = field(default_factory=list)
    compare: list[dict[str, Any]] = field(default_factory=list)
    reproduce: list[dict[str, Any]] = field(default_factory=list)
    bench: list[dict[str, Any]] = field(default_factory=list)


def load(paths: Iterable[str | Path]) -> Sources:
    """Read JSON files of verify, compare, bench and reproduce.

    Raises
    ------
    UsageError
        For a file that cannot be read, is no JSON, or none of these.
    """
    found = Sources()
    for path in paths:
        data = _read(Path(path))
        kind = next((k for key, k in KINDS.items() if key in data), None) if isinstance(data, dict) else None
        if kind is None:
            raise UsageError(
                expected="JSON written by sepv verify, compare or reproduce with --json, or by sepv bench with --save",
                received=f"{path}, which is none of these",
                remedy="sepv verify energy-preserving --json report.json",
            )
        _check(kind, data, path)
        getattr(found, kind).append(data)
    return found


def _read(path: Path) -> Any:
    try:
        if path.stat().st_size > LARGEST:
            raise ValueError(f"{path.stat().st_size} bytes")
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise UsageError(
            expected="a JSON file written by sepv",
            received=f"{path}: {error}",
            remedy="correct the name, or write it anew",
        ) from error


def _check(kind: str, data: dict[str, Any], path: str | Path) -> None:
    """The file obeys the schema in the package."""
    if kind == "bench":
        from sepv.studies._bench import store

        store.load(str(path))  # its own check
        return
    wrong = fault(
        data, schema({"verify": "report", "compare": "comparison", "reproduce": "reproduction"}[kind])
    )
    if wrong:
        raise UsageError(
            expected=f"the JSON of sepv {kind}, as its schema describes it",
            received=f"{path}: {wrong}",
            remedy="write the file anew with this version of sepv",
        )
