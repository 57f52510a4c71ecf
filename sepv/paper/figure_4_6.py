"""§4.4, Figure 4.6: the stochastic Lotka-Volterra system."""

from __future__ import annotations

import numpy as np

from sepv import problems, schemes
from sepv.pictures import TIME_AXIS, Axis

from . import judge, order, record, runs
from .record import Job, Panel, Results, Size, Statement

LOTKA_VOLTERRA_KEEPERS = ("energy-preserving", "discrete-gradient")
LOTKA_VOLTERRA_SCHEMES = (*schemes.PAPER, *record.ORDER_OF_OURS)
LOTKA_VOLTERRA_RUNS = runs.LongRuns(
    "4.6", "lotka-volterra", 2.0**-8, 1280, LOTKA_VOLTERRA_SCHEMES, shared=False
)
# At h ≥ 2⁻⁶ some steps of implicit schemes have no solution, and explicit schemes leave the octant.
LOTKA_VOLTERRA_ORDER = order.Setting(
    "4.6", LOTKA_VOLTERRA_RUNS.problem, T=0.5, steps=(128, 256, 512, 1024), samples=1000,
    schemes=(*record.STATED_ORDERS, *record.ORDER_OF_OURS),
    title="Lotka-Volterra: order", source="Figure 4.6, right", place="§4.4, Theorem 3.4",
    chosen=(
        "end time 1/2, 1000 samples and step sizes 2^-8 to 2^-11 (the paper gives none of these)",
        "the exact solution instead of the midpoint scheme with h = 2^-12",
        "splitting, which the paper does not show, is added",
    ),
)  # fmt: skip
# Errors on the interval of the energy plot, against a scheme with a fine step, the kind of
# reference that §4.4 names.
LOTKA_VOLTERRA_FINE = order.Setting(
    "4.6", LOTKA_VOLTERRA_RUNS.problem, T=5.0, steps=(1280, 2560, 5120, 10240, 20480), samples=128,
    schemes=("midpoint", "milstein"),
    title="Lotka-Volterra: what a fine-step reference hides",
    source="Figure 4.6, right, on the interval of its left plot", place="§4.4",
)  # fmt: skip

_LOTKA_VOLTERRA_PARAMETERS = {
    "a": -2.0, "b": -1.0, "d": -0.5, "nu": 1.0, "mu": 2.0, "c": 0.5, "y0": [1.0, 1.9, 0.5],
    "h": LOTKA_VOLTERRA_RUNS.h, "T": LOTKA_VOLTERRA_RUNS.steps * LOTKA_VOLTERRA_RUNS.h,
}  # fmt: skip


def jobs(size: Size) -> list[Job]:
    """The jobs: paths, and errors at time T, of the paper's six schemes and of splitting."""
    return [
        *order.jobs(LOTKA_VOLTERRA_ORDER, size),
        *order.fine_jobs(LOTKA_VOLTERRA_FINE, size),
        *LOTKA_VOLTERRA_RUNS.jobs(size),
    ]


def panels(results: Results) -> list[Panel]:
    """The panels of Figure 4.6: the Hamiltonian along one sample, and the order."""
    long_runs = LOTKA_VOLTERRA_RUNS.by_scheme(results)
    energy = Panel(
        key="4.6-hamiltonian", title="Lotka-Volterra: energy", source="Figure 4.6, left",
        x=TIME_AXIS, y=Axis("energy H"), series=tuple(runs.curve(r, r.energy) for r in long_runs.values()),
        parameters=_LOTKA_VOLTERRA_PARAMETERS, chosen=("splitting, which the paper names and does not show, is added",),
        statements=(*runs.statements(long_runs, "energy", LOTKA_VOLTERRA_KEEPERS, "§4.4"),
            _domain(long_runs["splitting"])),
        description="Energy-preserving and discrete gradient scheme keep the energy; the others do not, and splitting "
        "stays near it.",
    )  # fmt: skip
    return [
        energy,
        order.panel(LOTKA_VOLTERRA_ORDER, results),
        order.fine_panel(LOTKA_VOLTERRA_FINE, results),
    ]


def _domain(run: runs.SampledRun) -> Statement:
    """The statement that splitting, a composition of exact flows,
    stays in y > 0 and keeps the Casimir.
    """
    system = problems.by_name(LOTKA_VOLTERRA_RUNS.problem)
    assert system.nambu is not None
    smallest = float(np.min(run.y))
    with np.errstate(invalid="ignore"):
        casimir = system.nambu.casimir(run.y)
        # A relative error eps of y_i moves C by |∂C/∂ln y_i| eps; a step multiplies each component
        # a few times.
        size = float(np.max(np.sum(np.abs(system.nambu.gradient(run.y) * run.y), axis=0)))
    moved, limit = float(np.max(np.abs(casimir - casimir[0]))), runs.rounding_bound(run.steps) * size
    return Statement(
        f"{record.sentence(run.scheme)} remains in the domain y > 0, and keeps the Casimir", "[23] in §1",
        judge.decide(smallest > 0 and moved <= limit, not smallest > 0 or moved > runs.DRIFT_FACTOR * limit),
        f"smallest component {smallest:.3g}, largest change of C {moved:.1e} over {run.steps} steps",
        f"positive; rounding can do {limit:.1e} to C",
    )  # fmt: skip
