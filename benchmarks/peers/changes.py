"""Changes of verdicts between versions of a library: each record is compared with the record before
it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

from benchmarks.peers.records import ReleaseRecord
from sepv.files import finite
from sepv.law import Verdict

# Words for a solver that a version of the library lacks, and for one that it has.
ABSENT_WORD, PRESENT_WORD = "absent", "there"


@dataclass(frozen=True)
class VerdictChange:
    """A verdict that differs from that in the record before."""

    library: str
    solver: str
    law: str  # empty if the whole solver was added or removed
    since: str  # the version of the record before; equal to `version` if this version was measured again
    version: str
    before: str  # a value of `sepv.verification.Verdict`, or ABSENT_WORD or PRESENT_WORD
    after: str
    besides: tuple[str, ...]  # what else changed and may be the reason: the suite, packages, Python


def latest(records: Sequence[ReleaseRecord]) -> list[ReleaseRecord]:
    """The last record of each version, in the order of the versions."""
    return list({record.version: record for record in records}.values())


def changes(records: Sequence[ReleaseRecord]) -> list[VerdictChange]:
    """The changed verdicts between each record of a library and the record before it."""
    return [change for before, after in pairwise(records) for change in _between(before, after)]


def _between(before: ReleaseRecord, after: ReleaseRecord) -> Iterator[VerdictChange]:
    besides = tuple(_besides(before, after))
    old, new = before.solvers, after.solvers
    for name in dict.fromkeys((*old, *new)):

        def change(law: str, was: str, now: str, name: str = name) -> VerdictChange:
            return VerdictChange(after.library, name, law, before.version, after.version, was, now, besides)

        if name not in old:
            yield change("", ABSENT_WORD, PRESENT_WORD)
        elif name not in new:
            yield change("", PRESENT_WORD, ABSENT_WORD)
        else:
            for law, said in new[name]["laws"].items():
                was = old[name]["laws"].get(law)
                if was is not None and was["verdict"] != said["verdict"]:
                    yield change(law, was["verdict"], said["verdict"])


def _besides(before: ReleaseRecord, after: ReleaseRecord) -> Iterator[str]:
    """The differences between two records other than the library itself,
    such as versions of other packages.
    """
    old, new = before.data, after.data
    if old["suite"]["laws_version"] != new["suite"]["laws_version"]:
        yield f"suite {old['suite']['laws_version']} → {new['suite']['laws_version']}"
    for name in ("python", "machine"):
        if old["environment"][name] != new["environment"][name]:
            yield f"{name} {old['environment'][name]} → {new['environment'][name]}"
    was, now = old["environment"]["packages"], new["environment"]["packages"]
    for name in sorted(set(was) | set(now)):
        if name != after.library and was.get(name) != now.get(name):
            yield f"{name} {was.get(name, 'none')} → {now.get(name, 'none')}"


def broken(entry: dict[str, Any]) -> dict[str, list[str]]:
    """The claimed laws of a solver that are not found to hold, by verdict."""
    found: dict[str, list[str]] = {}
    for law, said in entry["laws"].items():
        verdict = Verdict(said["verdict"])
        if said["claimed"] and verdict not in (Verdict.HOLDS, Verdict.NOT_APPLICABLE):
            found.setdefault(verdict.text, []).append(law)
    return found


def cell(record: ReleaseRecord, solver: str) -> str:
    """The text of the table's cell for one solver and version."""
    entry = record.solvers.get(solver)
    if entry is None:
        return ABSENT_WORD
    return "; ".join(f"{verdict}: {', '.join(laws)}" for verdict, laws in broken(entry).items()) or "holds"


@dataclass(frozen=True)
class DeviatingVersions:
    """A script about a deviation: the versions that have the deviation,
    and the version that mended it.
    """

    library: str
    script: str
    title: str
    seen: tuple[str, ...]
    mended: str  # the first version without the deviation after the last with it; empty if there is none


def deviations(records: Sequence[ReleaseRecord]) -> list[DeviatingVersions]:
    """The `DeviatingVersions` of each script, from the last record of each version."""
    titles: dict[str, str] = {}
    states: dict[str, list[tuple[str, bool | None]]] = {}
    for record in latest(records):
        for script in record.data["scripts"]:
            titles[script["name"]] = script["title"]
            states.setdefault(script["name"], []).append((record.version, script["deviates"]))
    shown = []
    for name, found in states.items():
        seen = tuple(version for version, deviates in found if deviates)
        shown.append(DeviatingVersions(records[0].library, name, titles[name], seen, _mended(found)))
    return shown


def _mended(found: Sequence[tuple[str, bool | None]]) -> str:
    """The first version without the deviation after the last version with it; "" if there is
    none.
    """
    last = max((n for n, (_, deviates) in enumerate(found) if deviates), default=len(found))
    return next((version for version, deviates in found[last:] if deviates is False), "")


def to_json(found: dict[str, list[ReleaseRecord]]) -> dict[str, Any]:
    """The content of the page as JSON for another program: by library the versions, cells,
    changes and deviations.
    """
    return {
        library: {
            "versions": [r.version for r in latest(records)],
            "solvers": {
                solver: {r.version: cell(r, solver) for r in latest(records)} for solver in solvers(records)
            },
            "changes": [finite(asdict(change)) for change in changes(records)],
            "deviations": [finite(asdict(d)) for d in deviations(records)],
        }
        for library, records in found.items()
    }


def solvers(records: Sequence[ReleaseRecord]) -> list[str]:
    """The names of all solvers: first those of the last version, then those that it no longer
    has.
    """
    return list(dict.fromkeys(name for record in reversed(latest(records)) for name in record.solvers))
