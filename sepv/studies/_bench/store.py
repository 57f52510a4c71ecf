"""Records of the benchmark in a file: JSON, hex floats, sorted so that a difference reads well."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sepv.files import read_json, require_schema
from sepv.schemes import Scheme
from sepv.studies._bench import measure as measuring

FORMAT = 1


def record(target: str, scheme: Scheme, cases: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """A target's record: its cases measured."""
    return {"target": target, "cases": [measuring.measure(scheme, case) for case in cases]}


def document(records: list[dict[str, Any]]) -> dict[str, Any]:
    """What a file holds."""
    return {"format": FORMAT, "environment": measuring.environment(), "records": records}


def load(path: str) -> list[dict[str, Any]]:
    """The records of a file.

    Raises
    ------
    UsageError
        For a file that is not one of `sepv bench --save`.
    """
    said = {
        "expected": f"a file that `sepv bench --save` wrote, of format {FORMAT}",
        "remedy": "save it again with this release",
    }
    found = read_json(path, **said)
    require_schema(found, "bench", path, **said)
    records: list[dict[str, Any]] = found["records"]
    return records
