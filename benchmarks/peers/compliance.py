"""The compliance table of other libraries' solvers: ``python -m benchmarks.peers.compliance --out
docs/compliance.md``.

The table has the verdict of every law on every solver of `sepv.peers`, as by `sepv verify`, and
energy defects in numbers. A solver is marked if a script in the folder ``peers`` beside the output
shows that it deviates from its documentation (`benchmarks.peers.deviations`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
from sepv.properties import FALSE_ALARM, FIRST_LOOK

from benchmarks.peers.compliance_measurements import (
    LIBRARIES,
    NO_AREAS,
    UNTRUNCATED_SETUPS,
    Row,
    release,
    rows,
    suite_key,
)
from benchmarks.peers.deviations import Deviation, deviations_shown_by
from benchmarks.peers.kept_measurements import Cell, measured
from benchmarks.peers.options import measuring, page_options, put
from sepv import __version__, problems
from sepv.console import ShownProgress, markdown
from sepv.errors import TargetError
from sepv.law import Effort, Verdict, energy_ulp
from sepv.peers.peer import load
from sepv.problem import Problem
from sepv.schemes import Scheme, energy_preserving
from sepv.simulate import ensemble
from sepv.verification import LAWS, VERDICT_MARKS, load_laws

COMPLIANCE_COMMAND = "python -m benchmarks.peers.compliance"
# The numbers of paths and steps for energy defects.
DEFECT_PATHS = 256
ENERGY_STEPS = 64
# The columns of `kept`, and a sentence about the laws that these columns do not name.
KEPT_COLUMNS = ("claimed laws that hold", "other laws that hold")
UNNAMED_LAWS = (
    "A measured law missing from a line is not claimed, and is violated, inconclusive or not applicable."
)
LESS_THAN_DOCUMENTED = (
    "† The solver does less than documented, as [scripts without sepv](deviations.md) show."
)
HOLDS_MARK = VERDICT_MARKS[Verdict.HOLDS]
# Words that replace marks.
WORD_OF_MARK = {VERDICT_MARKS[Verdict.VIOLATED]: "violated", VERDICT_MARKS[Verdict.INCONCLUSIVE]: "open"}


def schemes_of(libraries: Sequence[str]) -> list[tuple[str, Scheme]]:
    """The solvers of the installed libraries, after a scheme of sepv for comparison."""
    jobs = [("sepv", replace(energy_preserving, name="energy-preserving"))]
    for library in libraries:
        try:
            jobs += [(library, solver) for solver in load(library).schemes.values()]
        except TargetError as error:
            click.echo(f"{library} left out: {error.received}", err=True)
    return jobs


def energies(
    jobs: Sequence[tuple[str, Scheme]], effort: Effort, folder: Path | None, shown: ShownProgress
) -> dict[str, tuple[str, ...]]:
    """The largest energy defects of each scheme in energy ulps, for each of
    `UNTRUNCATED_SETUPS`.
    """
    cells = [
        Cell(
            solver.name,
            f"energy defect, {setup.problem}",
            (release(library), *suite_key(effort), setup.T, DEFECT_PATHS, ENERGY_STEPS),
            partial(_energy, solver, problems.by_name(setup.problem), setup.T),
        )
        for library, solver in jobs
        for setup in UNTRUNCATED_SETUPS
    ]
    found = measured(cells, folder, shown)
    names = [f"energy defect, {setup.problem}" for setup in UNTRUNCATED_SETUPS]
    return {solver.name: tuple(found[solver.name, name] for name in names) for _, solver in jobs}


def _energy(solver: Scheme, problem: Problem, T: float) -> str:
    """The largest defect in energy ulps, or how many paths failed."""
    h, start = T / ENERGY_STEPS, np.array(problem.initial, dtype=np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        result = ensemble(solver, problem, h=h, T=T, paths=DEFECT_PATHS, engine="numpy")
        failed, defects = result.status != 0, result.energy_defect
    if failed.any():
        return f"{np.count_nonzero(failed)} paths failed"
    return f"{float(np.max(defects)) / energy_ulp(problem, start, start):.2g}"


def document(
    found: Sequence[Row], energy: Mapping[str, Sequence[str]], deviations: Sequence[Deviation], command: str
) -> str:
    """The page, in Markdown."""
    contradicted = {d.solver for d in deviations}

    releases = dict.fromkeys(f"{r.library} {release(r.library)}" for r in found)
    said = (note.partition(": ") for r in found for note in _notes(r.scheme, r.found))
    notes = _grouped((text, name) for name, _, text in said)
    sources = _grouped((r.scheme.source, r.name) for r in found if r.library != "sepv")
    parts = [
        "# Laws of other libraries' Stratonovich solvers",
        f"Made by `{command}` with sepv {__version__}. Releases: {', '.join(releases)}.",
        _introduction(),
        "## Laws",
        _laws(found, contradicted),
        LESS_THAN_DOCUMENTED if contradicted else "",
        "\n".join(notes),
        "## Energy",
        _energy_defects(found, energy),
        "## Where the claimed orders come from",
        "\n".join(sources),
    ]
    return "\n\n".join(p for p in parts if p) + "\n"


def _grouped(pairs: Iterable[tuple[str, str]]) -> list[str]:
    """Lines of Markdown from pairs (text, name): each text once, after all its names."""
    names: dict[str, list[str]] = {}
    for text, name in pairs:
        names.setdefault(text, []).append(name)
    return [f"- {_listed(own)}: {text}" for text, own in names.items()]


def _listed(names: Sequence[str]) -> str:
    """The solvers, each "library name", in one line. Successive solvers of one library do not
    repeat its name.
    """
    libraries = ["", *(name.split()[0] for name in names)]
    pairs = zip(names, libraries, strict=False)
    return "; ".join(name.removeprefix(f"{before} ") if before else name for name, before in pairs)


def _energy_defects(found: Sequence[Row], energy: Mapping[str, Sequence[str]]) -> str:
    """The range of the energy defects of other libraries' solvers beside the defect of sepv's own
    scheme.
    """
    lines, own = [], found[0]
    for at, setup in enumerate(UNTRUNCATED_SETUPS):
        others = {r.name: energy[r.scheme.name][at] for r in found[1:]}
        failed = [f"{name}: {text}" for name, text in others.items() if text.endswith("failed")]
        values = sorted(float(text) for text in others.values() if not text.endswith("failed"))
        span = [f"other solvers {values[0]:.2g} to {values[-1]:.2g}"] if values else []
        lines.append(
            "; ".join([f"- {setup.problem}: {own.name} {energy[own.scheme.name][at]}", *span, *failed])
        )
    text = (
        f"The largest |H(y_n) − H(y_0)| of {DEFECT_PATHS} paths over [0, 1] with {ENERGY_STEPS} steps, in units of "
        "eps·|∇H|·|y|:"
    )
    return "\n".join([text, "", *lines])


def kept(verdicts: Mapping[str, str]) -> tuple[str, str]:
    """Two texts from the marks of laws: how many claimed laws hold and which do not,
    and the other laws that hold.
    """
    claimed = {law: mark.removesuffix(" +") for law, mark in verdicts.items() if mark.endswith("+")}
    failed = [f"{law} {WORD_OF_MARK.get(mark, mark)}" for law, mark in claimed.items() if mark != HOLDS_MARK]
    held = [law for law, mark in verdicts.items() if mark == HOLDS_MARK]
    return "; ".join([f"{len(claimed) - len(failed)} of {len(claimed)}", *failed]), ", ".join(held)


def _laws(found: Sequence[Row], contradicted: Collection[str]) -> str:
    """A line for each group of solvers with the same verdicts on the same laws."""
    left_out = [law for law in LAWS if not any(law in r.found for r in found)]
    groups: dict[tuple[tuple[str, str], ...], list[str]] = {}
    for r in found:
        mark = " †" if r.name.split(",")[0] in contradicted else ""
        groups.setdefault(tuple(r.marks.items()), []).append(r.name + mark)
    lines = [(_listed(names), *kept(dict(verdicts))) for verdicts, names in groups.items()]
    missing = f"Not measured: {', '.join(left_out) or 'none'}."
    caption = f"{missing} {UNNAMED_LAWS}"
    return f"{caption}\n\n{markdown(('solvers', *KEPT_COLUMNS), lines)}"


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


def _introduction() -> str:
    setup = UNTRUNCATED_SETUPS[0]
    steps, own = (
        ", ".join(map(str, (first, *setup.steps[1:]))) for first in (setup.steps[0], setup.steps[0] // 2)
    )
    return f"""\
The laws were measured on dy = B(y)∇H(y)(dt + Σ_j c_j ∘dW_j). Other libraries' solvers are not made to preserve energy
or Casimirs, so a violated law that they do not claim is no fault. They claim the law *contract* (a step depends on its
arguments alone), and the documented order for commutative noise, because all noises here drive one field. If no order
is documented, they claim the order by theory. Each solver runs its library's code in float64, with given increments.

- Paths cover [0, {setup.T:g}] in {steps} steps (sepv's scheme: {own}).
  Solvers that take one state at a time get {FIRST_LOOK} paths, so more of their verdicts are open (inconclusive). The
  nominal false-alarm rate of a run is {FALSE_ALARM:g}.
- Some solvers pass an internal state from step to step. Paths keep it; laws about one step start with a new one.
- A space-time Lévy area is a normal random number, with the increment as seed. Other Lévy areas are set to zero,
  because the Lie brackets of these noise fields vanish."""


@click.command()
@page_options(LIBRARIES)
def main(out: Path | None, keep: Path | None, libraries: tuple[str, ...], seed: int) -> None:
    """Measure every law on every solver that the adapters cover, and write the table as
    Markdown.
    """
    # Counterexamples are not shown here, so that little is spent on simplifying them.
    effort = Effort(seed=seed, shrink_checks=50)
    with measuring(keep) as line:
        jobs = schemes_of(libraries or LIBRARIES)
        found, energy = rows(jobs, load_laws(), effort, keep, line), energies(jobs, effort, keep, line)
        line.update("the scripts that show deviations", 1.0)
        shown = deviations_shown_by(out.parent / "peers", LIBRARIES) if out else []
    put(
        out,
        lambda arguments: document(found, energy, shown, f"{COMPLIANCE_COMMAND}{arguments}"),
        libraries,
        seed,
    )


if __name__ == "__main__":
    main()
