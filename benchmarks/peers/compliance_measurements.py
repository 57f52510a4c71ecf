"""Measurements of laws on a library's solver. Each is a `Cell`, whose result can be stored;
a `Row` has those of one solver.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib import resources
from importlib.metadata import packages_distributions, version
from pathlib import Path
from typing import Any

import numpy as np
from sepv.properties import setups

from benchmarks.peers.environments import VERSIONS
from benchmarks.peers.kept_measurements import Cell, measured
from sepv import __version__
from sepv.console import ShownProgress
from sepv.law import Effort, Law, Verdict
from sepv.peers.peer import load
from sepv.schemes import Scheme, page_of
from sepv.verification import VERDICT_MARKS, verify

LIBRARIES = tuple(VERSIONS)
# The setups on which schemes with untruncated increments are judged: all solvers here have such
# increments.
UNTRUNCATED_SETUPS = setups(truncation=None)

# Laws by quadrature over ΔW, which do not average over other noise that a step draws.
OVER_INCREMENTS = ("local-mean", "local-weak")
NO_AREAS = "not applicable: these laws average over ΔW alone, but the step also uses an area"


@dataclass(frozen=True)
class Row:
    """The measured behaviour of one scheme of a library: the finding on each law, as JSON."""

    library: str
    scheme: Scheme
    found: Mapping[str, Any]

    @property
    def name(self) -> str:
        """The library and the solver."""
        return f"{self.library} {self.scheme.name.removeprefix(f'{self.library} ')}"

    @property
    def marks(self) -> dict[str, str]:
        """The mark of each law's verdict, with a + if the law is claimed."""
        return {
            law: VERDICT_MARKS[Verdict(f["verdict"])] + " +" * bool(f["claimed"])
            for law, f in self.found.items()
        }


def rows(
    jobs: Sequence[tuple[str, Scheme]],
    laws: Sequence[Law],
    effort: Effort,
    folder: Path | None,
    shown: ShownProgress,
) -> list[Row]:
    """The row of each scheme, which stands behind the name of its library."""
    cells = [cell for library, scheme in jobs for cell in law_cells(library, scheme, laws, effort)]
    found = measured(cells, folder, shown)
    return [
        Row(
            library,
            scheme,
            {law.name: silent(library, scheme).get(law.name) or found[scheme.name, law.name] for law in laws},
        )
        for library, scheme in jobs
    ]


def law_cells(library: str, scheme: Scheme, laws: Sequence[Law], effort: Effort) -> Iterator[Cell]:
    """The cells of laws on one scheme, without the laws that cannot judge it because it draws areas
    (`silent`).
    """
    for law in laws:
        if law.name in OVER_INCREMENTS and draws(library, scheme):
            continue
        key = (
            release(library), *suite_key(effort), law.statement, law.source, _text_of(law), sorted(scheme.claims),
            scheme.mean_square_order, scheme.weak_order, scheme.order,
        )  # fmt: skip
        yield Cell(scheme.name, law.name, key, partial(_finding, scheme, law.name, effort))


def silent(library: str, scheme: Scheme) -> dict[str, dict[str, Any]]:
    """Law -> the finding "not applicable", for the laws that cannot judge a solver that draws areas
    beside ΔW.
    """
    text = {"verdict": Verdict.NOT_APPLICABLE.value, "claimed": False, "message": NO_AREAS, "measured": ()}
    return {name: text for name in OVER_INCREMENTS if draws(library, scheme)}


def draws(library: str, scheme: Scheme) -> bool:
    """True if a step of the solver draws noise of its own beside ΔW."""
    if library == "sepv":
        return False
    return scheme in load(library).drawing


def suite_key(effort: Effort) -> tuple[Any, ...]:
    return (__version__, effort.seed, effort.examples, effort.paths, effort.designs)


def _text_of(law: Law) -> str:
    """A digest of the law's file: a stored measurement is used only while the law is unchanged."""
    file = resources.files("sepv.properties") / f"test_{page_of(law.name).replace('-', '_')}.py"
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _finding(scheme: Scheme, law: str, effort: Effort) -> dict[str, Any]:
    """The part of a law's finding that the table shows, as JSON."""
    with np.errstate(over="ignore", invalid="ignore"):
        report = verify(scheme, laws=[law], effort=effort)
    if report.interrupted:
        raise KeyboardInterrupt
    finding = report.finding(law)
    said = {key: getattr(finding, key) for key in ("claimed", "message", "defect", "bound")}
    measured = (finding.witness or {}).get("measured", ()) if law == "mean-square-order" else ()
    return {"verdict": finding.verdict.value, **said, "measured": measured}


@cache
def release(library: str) -> str:
    """The version of a library that is installed here."""
    return __version__ if library == "sepv" else version(packages_distributions().get(library, [library])[0])
