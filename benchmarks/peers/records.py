"""Records: the measured behaviour of each version of a library,
in ``results/LIBRARY/VERSION.json``.

A record is never overwritten. If a version is measured again, for example by a newer suite, the new
record is stored beside the old one, with its date in the name: ``VERSION@DATE.json``.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sepv.errors import UsageError
from sepv.files import fault, json_text, read_json, write_atomically

_SCHEMA = Path(__file__).with_name("record.schema.json")


def _fault(data: Any) -> str:
    """The violation of record.schema.json by the data of a record, as text; empty if there is
    none.
    """
    return fault(data, json.loads(_SCHEMA.read_text(encoding="utf-8")))


@dataclass(frozen=True)
class ReleaseRecord:
    """One record, as record.schema.json describes its data."""

    path: Path
    data: dict[str, Any]

    @property
    def library(self) -> str:
        """The name of the library."""
        return str(self.data["library"])

    @property
    def version(self) -> str:
        """The version of the library."""
        return str(self.data["version"])

    @property
    def solvers(self) -> dict[str, dict[str, Any]]:
        """Solver -> its entry in the record."""
        return {entry["name"]: entry for entry in self.data["solvers"]}


def recorded(folder: Path, library: str, version: str) -> list[Path]:
    """The files of all records of one version, the oldest first."""
    own = folder / library
    return [p for p in (own / f"{version}.json", *sorted(own.glob(f"{version}@*.json"))) if p.exists()]


def add(folder: Path, data: dict[str, Any]) -> Path:
    """Write a record to the folder under a new name. Raise UsageError if this version has a record
    of this day.
    """
    if wrong := _fault(data):
        raise UsageError(expected="a record of a version", received=wrong, remedy="measure it again")
    own, version = folder / data["library"], data["version"]
    first = own / f"{version}.json"
    path = own / f"{version}@{data['date']}.json" if first.exists() else first
    if path.exists():
        raise UsageError(
            expected=f"a version that has no record of {data['date']}",
            received=str(path),
            remedy="records are never overwritten; remove it yourself if it is wrong",
        )
    own.mkdir(parents=True, exist_ok=True)
    write_atomically(str(path), json_text(data))
    return path


def load(folder: Path) -> dict[str, list[ReleaseRecord]]:
    """All records by library, in the order of versions and then of dates.
    Raise UsageError if there are none.
    """
    found: dict[str, list[ReleaseRecord]] = {}
    for path in sorted(folder.glob("*/*.json")):
        said = {
            "expected": "records of versions",
            "remedy": "write it anew with `python -m benchmarks.peers.releases`, or name another folder",
        }
        data = read_json(path, **said)
        if wrong := _fault(data):
            raise UsageError(received=f"{path}: {wrong}", **said)
        found.setdefault(data["library"], []).append(ReleaseRecord(path, data))
    if not found:
        raise UsageError(
            expected="a folder of records, LIBRARY/VERSION.json",
            received=f"{folder}, without any",
            remedy="measure some: python -m benchmarks.peers.releases sdeint 0.2.4 0.3.0",
        )
    for records in found.values():
        records.sort(key=lambda r: (order(r.version), r.data["date"], r.path.name))
    return found


def order(version: str) -> tuple[Any, ...]:
    """The key that sorts versions: numbers as numbers, and a pre-release before its release."""
    numbers = tuple(int(n) for n in re.findall(r"\d+", re.split(r"[a-z@+]", version)[0]))
    return (numbers, re.search(r"(a|b|rc|dev)\d", version) is None, version)
