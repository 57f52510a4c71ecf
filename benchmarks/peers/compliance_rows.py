"""A row of the compliance table: the measured behaviour of one solver,
in words and numbers for a reader.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from benchmarks.peers.compliance_measurements import NO_AREAS, SETUPS, release, silent
from sepv.law import Verdict
from sepv.schemes import Scheme
from sepv.verification import LAWS, MARKS


@dataclass(frozen=True)
class Row:
    """The measured behaviour of one solver: a row of the table.

    Attributes
    ----------
    energy : tuple of str
        The largest energy defect in energy ulps, for each of `SETUPS`.
    verdicts : dict of law name to mark
    notes : tuple of str
        Reasons of the verdict "error", and other remarks.
    """

    library: str
    release: str
    solver: str
    source: str
    energy: tuple[str, ...]
    verdicts: dict[str, str]
    notes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The library and the solver."""
        return f"{self.library} {self.solver}"


def scheme_row(library: str, scheme: Scheme, cells: Mapping[tuple[str, str], Any]) -> Row:
    """The row of a solver that takes single steps, from its measured cells."""
    unasked = silent(library, scheme)
    findings = {name: unasked.get(name) or cells[scheme.name, name] for name in LAWS}
    return Row(
        library=library,
        release=release(library),
        solver=scheme.name.removeprefix(f"{library} "),
        source=scheme.source,
        energy=tuple(cells[scheme.name, f"energy defect, {s.problem}"] for s in SETUPS),
        verdicts={
            name: MARKS[Verdict(f["verdict"])] + (" +" if f["claimed"] else "")
            for name, f in findings.items()
        },
        notes=tuple(_notes(scheme, findings)),
    )


def _notes(scheme: Scheme, findings: Mapping[str, Any]) -> Iterator[str]:
    """Reasons of errors, and remarks that a reader of the marks needs."""
    for name, found in findings.items():
        lines = found["message"].splitlines()
        if Verdict(found["verdict"]) is Verdict.ERROR and lines:
            # The message has the case that could not be measured, and then three lines of the
            # error.
            yield f"{scheme.name}, {name}: {lines[-3] if lines[0].endswith(':') and len(lines) > 3 else lines[0]}"
    no_areas = [name for name, found in findings.items() if found["message"] == NO_AREAS]
    if no_areas:
        yield f"{scheme.name}: {', '.join(no_areas)} {NO_AREAS}"
    limit, order = findings.get("right-limit"), findings.get("mean-square-order")
    if limit is None or order is None or Verdict(limit["verdict"]) is not Verdict.VIOLATED:
        return
    intervals = [m["interval"] for m in order["measured"]]
    if intervals and all(low is not None and low > 0.25 for low, _ in intervals):
        yield (
            f"{scheme.name}, right-limit: the error itself falls with h. The law assumes mean errors in whole "
            "powers of h, so it mistakes one that falls like h^½ for a wrong limit"
        )
