"""The JSON files of a page: their kinds, and a check that each is valid for its kind."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sepv.errors import UsageError
from sepv.files import read_json, require_schema
from sepv.properties import renamed

# The commands that write files for the page, by a key that only the command's files have; and the
# files' schemas.
COMMAND_OF_KEY = {
    "suite": "verify",
    "reproduction": "reproduce",
    "times_to_error": "compare",
    "records": "bench",
}
SCHEMA_OF = {"verify": "report", "compare": "comparison", "reproduce": "reproduction", "bench": "bench"}


@dataclass
class Sources:
    """The contents of a page's JSON files: a list for each command that wrote some,
    in the order of reading.
    """

    verify: list[dict[str, Any]] = field(default_factory=list)
    compare: list[dict[str, Any]] = field(default_factory=list)
    reproduce: list[dict[str, Any]] = field(default_factory=list)
    bench: list[dict[str, Any]] = field(default_factory=list)


def load(paths: Iterable[str | Path]) -> Sources:
    """Read JSON files of verify, compare, bench and reproduce.

    Raises
    ------
    UsageError
        If a file cannot be read, is no JSON, or was not written by one of these commands.
    """
    sources = Sources()
    for path in paths:
        data = read_json(
            path, expected="a JSON file written by sepv", remedy="correct the name, or write it anew"
        )
        kind = (
            next((k for key, k in COMMAND_OF_KEY.items() if key in data), None)
            if isinstance(data, dict)
            else None
        )
        if kind is None:
            raise UsageError(
                expected="JSON written by sepv verify, compare or reproduce with --json, or by sepv bench with --save",
                received=f"{path}, which is none of these",
                remedy="sepv verify energy-preserving --json report.json",
            )
        require_schema(
            data,
            SCHEMA_OF[kind],
            path,
            expected=f"the JSON of sepv {kind}, as its schema describes it",
            remedy="write the file anew with this version of sepv",
        )
        getattr(sources, kind).append(renamed(data) if kind == "verify" else data)
    return sources
