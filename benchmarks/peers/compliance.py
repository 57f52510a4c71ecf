"""The compliance table of other libraries' solvers: ``python -m benchmarks.peers.compliance --out docs/compliance.md``.

Every law on every solver of the adapters, as `sepv verify` measures it, with orders and energy defects in numbers.
Scripts in the folder ``peers`` beside the output (`benchmarks.peers.deviations`) are quoted where they show that a
measurement differs from a library's documentation, after what the library itself says of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.peers.compliance_measurements import (
    LIBRARIES,
    SETUPS,
    law_cells,
    path_cells,
    release,
    suite_key,
)
from benchmarks.peers.compliance_rows import Row, path_row, scheme_row
from benchmarks.peers.deviations import Shown as Script
from benchmarks.peers.deviations import shown_by
from benchmarks.peers.kept_measurements import Cell, measured
from benchmarks.peers.options import measuring, page_options, put
from sepv import problems
from sepv._terminal import markdown
from sepv._version import __version__
from sepv.errors import TargetError
from sepv.peers.peer import load
from sepv.peers.posing import PathSolver
from sepv.problem import Problem
from sepv.schemes import Scheme, energy_preserving
from sepv.simulate import _wiener as wiener
from sepv.simulate import ensemble
from sepv.verification import LAWS, Effort, Law, energy_ulp, load_laws
from sepv.verification._progress import Shown
from sepv.verification._sequential import FALSE_ALARM, FIRST_LOOK

COMMAND = "python -m benchmarks.peers.compliance"
# Energy defects are those of this many paths and steps.
PATHS = 256
ENERGY_STEPS = 64


@dataclass(frozen=True)
class Deviation:
    """A solver, "library name", that was measured to differ from its documentation, and the section about it."""

    solver: str
    text: str


def rows(libraries: Sequence[str], effort: Effort, folder: Path | None, shown: Shown) -> list[Row]:
    """The rows of the libraries that are installed, after one of sepv's own for comparison."""
    jobs: list[tuple[str, Any]] = [("sepv", replace(energy_preserving, name="energy-preserving"))]
    for library in libraries:
        try:
            adapter = load(library)
        except TargetError as error:
            click.echo(f"{library} left out: {error.received}", err=True)
            continue
        jobs += [(library, solver) for solver in (*adapter.schemes.values(), *adapter.paths)]
    laws = load_laws()
    cells: list[Cell] = []
    for library, solver in jobs:
        cells += solver_cells(library, solver, laws, effort)
    found = measured(cells, folder, shown)
    return [
        (path_row if isinstance(solver, PathSolver) else scheme_row)(library, solver, found)
        for library, solver in jobs
    ]


def solver_cells(
    library: str, solver: Scheme | PathSolver, laws: Sequence[Law], effort: Effort
) -> Iterator[Cell]:
    """Laws on one scheme, or errors of whole paths, and energy defects."""
    if isinstance(solver, PathSolver):
        yield from path_cells(library, solver, effort)
    else:
        yield from law_cells(library, solver, laws, effort)
    for setup in SETUPS:
        yield Cell(
            solver.name,
            f"energy defect, {setup.problem}",
            (release(library), *suite_key(effort), setup.T, PATHS, ENERGY_STEPS),
            partial(_energy, solver, problems.by_name(setup.problem), setup.T),
        )


def _energy(solver: Scheme | PathSolver, problem: Problem, T: float) -> str:
    """The largest defect in energy ulps, or how many paths failed."""
    h, start = T / ENERGY_STEPS, np.array(problem.initial, dtype=np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        if isinstance(solver, PathSolver):
            dW = wiener.increments(0, T=T, steps=ENERGY_STEPS, noises=problem.noises, paths=PATHS)
            H = problem.hamiltonian(solver.path(problem, start, h, dW).swapaxes(0, 1))
            failed, defects = ~np.isfinite(H).all(axis=0), np.abs(H - H[0])
        else:
            result = ensemble(solver, problem, h=h, T=T, paths=PATHS, engine="numpy")
            failed, defects = result.status != 0, result.energy_defect
    if failed.any():
        return f"{np.count_nonzero(failed)} paths failed"
    return f"{float(np.max(defects)) / energy_ulp(problem, start, start):.2g}"


def document(found: Sequence[Row], deviations: Sequence[Deviation], command: str) -> str:
    """The page, in Markdown."""
    contradicted = {d.solver for d in deviations}
    numbers = ["library", "version", "solver", "claimed order, mean-square / weak"]
    numbers += [f"measured order, {s.problem}" for s in SETUPS] + [
        f"energy defect, {s.problem}" for s in SETUPS
    ]
    first = []
    for r in found:
        mark = " †" if f"{r.library} {r.solver}".split(",")[0] in contradicted else ""
        first.append((r.library, r.release, r.solver, r.claimed + mark, *r.orders, *r.energy))
    second = [(f"{r.library} {r.solver}", *(r.verdicts.get(law, "") for law in LAWS)) for r in found]
    notes = [f"- {note}" for r in found for note in r.notes]
    sources = [f"- {r.library} {r.solver}: {r.source}" for r in found if r.library != "sepv"]
    parts = [
        "# What other libraries' Stratonovich solvers keep, and with which order",
        f"Made by `{command}` with sepv {__version__}; not edited by hand.",
        _introduction(),
        "## Orders and energy",
        markdown(numbers, first),
        "† differs from what is documented: see the last section, where other problems than these two serve as well."
        if contradicted
        else "",
        "## Laws",
        "holds · – violated · ? inconclusive · n/a not applicable · error: not measured, reason below · + claimed",
        markdown(["solver", *LAWS], second),
        "\n".join(notes),
        "## Where the claimed orders come from",
        "\n".join(sources),
        "## Where a measurement differs from a library's documentation",
        "\n\n".join(d.text for d in deviations)
        or "Nothing found that reproduces in the library's own terms.",
    ]
    return "\n\n".join(p for p in parts if p) + "\n"


def _introduction() -> str:
    steps = ", ".join(str(n) for n in SETUPS[0].steps)
    sentences = (
        "None of these solvers is made to keep energy or Casimirs: a law that is violated without being claimed",
        "is no fault of theirs. Claimed are the contract of a step, and the order that the documentation or, where",
        "it is silent, theory states for noise that commutes: in (1.1) all noises drive one field. Each solver runs",
        "through its own library's code in float64, with the increment given.",
        f"\n\nOrders are slopes of the rms error against the exact flow over [0, {SETUPS[0].T:g}] with",
        f"{steps} steps (sepv's own scheme truncates its increments and begins with {SETUPS[0].steps[0] // 2}), with",
        f"intervals over paths; the nominal false-alarm rate of a whole run is {FALSE_ALARM:g}. Solvers that",
        f"take one state at a time get {FIRST_LOOK} paths, which leaves more verdicts open.",
        f"Energy defects are the largest |H(y_n) − H(y_0)| of {PATHS} paths over [0, 1] with {ENERGY_STEPS}",
        "steps, in energy ulps eps·|∇H|·|y|. A solver that hands state from step to step is measured over whole",
        "paths; its one step, started afresh, stands beside it.",
        "\n\nWhere a solver wants the space-time Lévy area beside the increment, it gets a normal one from a stream",
        "whose key is the increment: a step is a function of its arguments. Other Lévy areas are given as zero:",
        "they act through brackets of the noise fields, which vanish here.",
    )
    return " ".join(sentences).replace(" \n\n", "\n\n")


def deviations_shown_by(folder: Path) -> list[Deviation]:
    """The docstring and the output of every script that still shows its deviation."""
    found = []
    for script in shown_by(folder):
        if not script.deviates:
            click.echo(f"{folder / script.name} left out: exit code {script.code}\n{script.errors}", err=True)
            continue
        found.append(Deviation(script.solver, section(script, folder.name)))
    return found


def section(script: Script, folder: str) -> str:
    """What the library says, then what was measured."""
    notes = "\n".join(f"- {note.place}, {note.date}: “{note.quotation}”" for note in script.notes)
    run = f"[`{folder}/{script.name}`]({folder}/{script.name}) prints"
    return (
        f"### {script.title}\n\nWhat the library itself says:\n\n{notes}\n\nWhat was measured. {script.body}\n\n"
        f"{run}\n\n```\n{script.output}\n```"
    )


@click.command()
@page_options
def main(out: Path | None, keep: Path | None, libraries: tuple[str, ...], seed: int) -> None:
    """Measure every law on every solver that the adapters cover, and write the table as Markdown."""
    # Counterexamples are not shown here, so that little is spent on simplifying them.
    effort = Effort(seed=seed, shrink_checks=50)
    with measuring(keep) as line:
        found = rows(libraries or LIBRARIES, effort, keep, line)
        line.update("the scripts that show deviations", 1.0)
        shown = deviations_shown_by(out.parent / "peers") if out else []
    put(out, lambda arguments: document(found, shown, f"{COMMAND}{arguments}"), libraries, seed)


if __name__ == "__main__":
    main()
