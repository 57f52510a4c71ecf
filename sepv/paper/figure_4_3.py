"""§4.2, Figure 4.3: the stochastic rigid body."""

from __future__ import annotations

import numpy as np

from sepv import problems
from sepv.pictures import TIME_AXIS, Axis
from sepv.record import EPS

from . import judge, order, record, runs
from .record import Job, Panel, Results, Size, Statement

BODY_LOSERS = ("euler-maruyama", "euler-heun", "milstein", "discrete-gradient")
BODY_SCHEMES = (*BODY_LOSERS, "energy-preserving", "midpoint", *record.ORDER_OF_OURS)
BODY_RUNS = runs.LongRuns("4.3", "rigid-body", 1e-2, 300, BODY_SCHEMES, shared=False)
BODY_ORDER = order.Setting(
    "4.3", BODY_RUNS.problem, T=1.0, steps=(16, 32, 64, 128, 256), samples=1000,
    schemes=(*record.STATED_ORDERS, *record.ORDER_OF_OURS),
    title="Rigid body: order", source="Figure 4.3, right", place="§4.2, Theorem 3.4",
    chosen=(
        "step sizes 2^-4 to 2^-8", "1000 samples (the paper gives no number here)", "the exact solution as reference",
        "splitting, which the paper does not show, is added",
    ),
    same=(("energy-preserving", "midpoint", "§4.2 and §3.3", "the Hamiltonian is quadratic"),),
)  # fmt: skip

_BODY_PARAMETERS = {
    "c": 1.0,
    "I": [0.345, 0.653, 1.0],
    "y0": [0.8, 0.6, 0.0],
    "h": BODY_RUNS.h,
    "N": BODY_RUNS.steps,
}


def jobs(size: Size) -> list[Job]:
    """The jobs: paths for the left plots, and errors at time T,
    of the paper's six schemes and of splitting.
    """
    return [*order.jobs(BODY_ORDER, size), *BODY_RUNS.jobs(size)]


def panels(results: Results) -> list[Panel]:
    """The panels of Figure 4.3: Casimir and Hamiltonian along one sample, and the order."""
    long_runs = BODY_RUNS.by_scheme(results)
    shown = [r for n, r in long_runs.items() if n != "midpoint"]
    places = {"energy-preserving": "§4.2, Proposition 3.2", "midpoint": "§4.2, by §3.3"}
    keep = ("energy-preserving", "midpoint", "discrete-gradient")
    return [
        Panel(
            key="4.3-casimir", title="Rigid body: Casimir", source="Figure 4.3, left",
            x=TIME_AXIS, y=Axis("Casimir C = |y|²"), series=tuple(runs.curve(r, r.casimir) for r in shown),
            parameters=_BODY_PARAMETERS,
            chosen=(
                "C = |y|², the first of the two definitions in §4.2; the second is half of it",
                "splitting, which the paper names and does not show, is added",
            ),
            statements=tuple(runs.statements(long_runs, "Casimir", set(BODY_SCHEMES) - set(BODY_LOSERS),
                "§4.2", **places)),
            description="The energy-preserving scheme and splitting keep the Casimir at 1; Euler-Maruyama, "
            "Euler-Heun, Milstein and the discrete gradient scheme do not.",
        ),
        Panel(
            key="4.3-hamiltonian", title="Rigid body: energy", source="§4.2, in words only",
            x=TIME_AXIS, y=Axis("energy H"), series=tuple(runs.curve(r, r.energy) for r in shown),
            parameters=_BODY_PARAMETERS, chosen=("the paper describes this panel and does not show it",),
            statements=tuple(runs.statements(long_runs, "energy", keep, "§4.2")),
            description="Energy-preserving and discrete gradient scheme keep the energy; the explicit schemes do not, "
            "and splitting stays near it.",
        ),
        order.panel(BODY_ORDER, results, extra=(_casimir_formula(),)),
    ]  # fmt: skip


def _casimir_formula() -> Statement:
    """The statement that §4.2's two functions called the Casimir, which differ by a factor,
    are both Casimirs.
    """
    problem = problems.by_name(BODY_RUNS.problem)
    y0 = np.array(problem.initial)
    # Each component is a difference of two equal products.
    largest = float(np.max(np.abs(problem.structure(y0) @ (2 * y0))))
    return Statement(
        "C(y) = ‖y‖² and C(y) = ½(y₁² + y₂² + y₃²) are Casimirs of the rigid body", "§4.2",
        judge.at_most(largest, 8 * EPS, 1e3 * EPS),
        f"|B(y0) ∇‖y‖²| = {largest:.1g}; Figure 4.3 shows ‖y‖², which is {y0 @ y0:g} at y0",
        "B(y)∇C(y) = 0; the two differ by a factor",
    )  # fmt: skip
