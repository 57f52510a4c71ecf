"""What is measured of a library's solver: laws and whole paths, each a cell that can be kept."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from functools import cache, partial
from importlib import resources
from importlib.metadata import packages_distributions, version
from typing import Any

import numpy as np
from sepv.properties import StrongErrors
from sepv.properties import mean_square_slope as slope
from sepv.properties._orders.convergence import log_decay
from sepv.properties._sequential import FALSE_ALARM, Setup, setups
from sepv.reference.peers.peer import load
from sepv.reference.peers.posing import PathSolver

from benchmarks.peers.environments import VERSIONS
from benchmarks.peers.kept_measurements import Cell
from sepv import problems
from sepv._version import __version__
from sepv.exact import exact_flow
from sepv.problem import Problem
from sepv.schemes import Scheme
from sepv.simulate import wiener
from sepv.verification import Effort, Law, Verdict, verify

LIBRARIES = tuple(VERSIONS)
# The orders of whole paths are those of so many.
ORDER_PATHS = 1024
# Where schemes with untruncated increments are judged, as all of these are.
SETUPS = setups(truncation=None)

# Laws by quadrature over ΔW, which is all of the noise that they know of.
OVER_INCREMENTS = ("local-mean", "local-weak")
NO_AREAS = "not applicable: they average over ΔW alone, and the solver also draws an area"


def law_cells(library: str, scheme: Scheme, laws: Sequence[Law], effort: Effort) -> Iterator[Cell]:
    """Laws on one scheme, but for those that do not know of the areas which it draws (`silent`)."""
    for law in laws:
        if law.name in OVER_INCREMENTS and draws(library, scheme):
            continue
        key = (
            release(library), *suite_key(effort), law.statement, law.source, _text_of(law), sorted(scheme.claims),
            scheme.mean_square_order, scheme.weak_order, scheme.order,
        )  # fmt: skip
        yield Cell(scheme.name, law.name, key, partial(_finding, scheme, law.name, effort))


def silent(library: str, scheme: Scheme) -> dict[str, dict[str, Any]]:
    """Law -> the finding "not applicable" of the laws that cannot judge a solver that draws areas beside ΔW."""
    text = {"verdict": Verdict.NOT_APPLICABLE.value, "claimed": False, "message": NO_AREAS, "measured": ()}
    return {name: text for name in OVER_INCREMENTS if draws(library, scheme)}


def draws(library: str, scheme: Scheme) -> bool:
    """True if a step of the solver draws noise of its own beside ΔW."""
    if library == "sepv":
        return False
    return scheme in load(library).drawing


def path_cells(library: str, solver: PathSolver, effort: Effort) -> Iterator[Cell]:
    """The error of whole paths of a solver that hands state on, problem by problem."""
    for setup in SETUPS:
        key = (release(library), *suite_key(effort), setup.T, setup.steps, ORDER_PATHS)
        measure = partial(_paths, solver, setup, effort.seed)
        yield Cell(solver.name, f"whole paths, {setup.problem}", key, measure)


def path_verdicts(
    solver: PathSolver, cells: Mapping[tuple[str, str], Any]
) -> dict[str, tuple[Verdict, float, float]]:
    """Verdict, measured number and limit of two laws on whole paths, by the thresholds of the laws of these names."""
    found = [cells[solver.name, f"whole paths, {s.problem}"] for s in SETUPS]
    span = min(s.steps[-1] / s.steps[0] for s in SETUPS)
    limits = (
        ("mean-square-order", "order", solver.mean_square_order - 0.25),
        ("right-limit", "fall", 0.25 * float(np.log(span))),
    )
    verdicts = {}
    for law, number, limit in limits:
        intervals = [cell[number] for cell in found]
        above = all(low > limit for _, low, _ in intervals)
        below = any(high < limit for _, _, high in intervals)
        verdict = Verdict.HOLDS if above else Verdict.VIOLATED if below else Verdict.INCONCLUSIVE
        verdicts[law] = (verdict, min(value for value, _, _ in intervals), limit)
    return verdicts


def suite_key(effort: Effort) -> tuple[Any, ...]:
    return (__version__, effort.seed, effort.examples, effort.paths, effort.designs)


def _text_of(law: Law) -> str:
    """A digest of the law's file: a kept measurement is used only while the law is unchanged."""
    file = resources.files("sepv.properties") / f"test_{law.name.replace('-', '_')}.py"
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


def _paths(solver: PathSolver, setup: Setup, seed: int) -> dict[str, Any]:
    """Order and fall of the error as (estimate, low, high), and paths that failed."""
    alpha = FALSE_ALARM / len(SETUPS)
    problem, note = problems.by_name(setup.problem), ""
    errors = _path_errors(solver, problem, setup, seed)
    if any(errors.failures):
        counts = ", ".join(str(n) for n in errors.failures)
        note = (
            f"{solver.name}, {setup.problem}: {counts} of {ORDER_PATHS} paths failed with "
            f"{', '.join(str(n) for n in errors.steps)} steps and are left out at every number of steps"
        )
    order, decay = slope(errors, alpha), log_decay(errors, alpha)
    return {
        "order": (order.value, order.low, order.high),
        "fall": (-decay.value, -decay.high, -decay.low),
        "note": note,
    }


def _path_errors(solver: PathSolver, problem: Problem, setup: Setup, seed: int) -> StrongErrors:
    """As `sepv.properties._orders.convergence.strong_errors`, with whole paths by the solver's own code."""
    start, steps = np.array(problem.initial, dtype=np.float64), setup.steps
    finest = steps[-1]
    fine = wiener.increments(seed, T=setup.T, steps=finest, noises=problem.noises, paths=ORDER_PATHS)
    exact = exact_flow(problem, problem.random_step(setup.T, fine.sum(axis=0))).y
    ends = [solver.path(problem, start, setup.T / n, wiener.coarsen(fine, finest // n))[-1] for n in steps]
    errors = np.stack([y - exact for y in ends])
    arrived = np.isfinite(errors).all(axis=(0, 1))
    return StrongErrors(
        T=setup.T,
        steps=steps,
        squared=np.sum(errors[:, :, arrived] ** 2, axis=1),
        errors=errors[:, :, arrived],
        failures=tuple(int(np.count_nonzero(~np.isfinite(e).all(axis=0))) for e in errors),
        scale=float(np.max(np.abs(exact))),
    )


@cache
def release(library: str) -> str:
    """The version of a library that is installed here."""
    return __version__ if library == "sepv" else version(packages_distributions().get(library, [library])[0])
