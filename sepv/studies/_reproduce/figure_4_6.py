"""§4.4, Figure 4.6: the stochastic Lotka-Volterra system."""

from __future__ import annotations

import numpy as np

from sepv import problems, schemes
from sepv.studies._picture import Axis
from sepv.studies._reproduce import fine_step, invariants, order, runs
from sepv.studies._reproduce.job import Job, Results, Size
from sepv.studies._reproduce.record import Panel, Statement, decide
from sepv.verification._orders.convergence import StrongErrors

PROBLEM = "lotka-volterra"
STEPS, H = 1280, 2.0**-8
KEEP = ("energy-preserving", "discrete-gradient")
SHOWN = (*schemes.PAPER, *order.OURS)
# At h ≥ 2⁻⁶ some steps of implicit schemes have no solution, and explicit schemes leave the octant.
ORDER = order.Setting(
    "4.6", PROBLEM, T=0.5, steps=(128, 256, 512, 1024), samples=1000, schemes=(*order.STATED, *order.OURS)
)
# The interval of the energy plot, and the reference that the text names.
FINE = order.Setting(
    "4.6",
    PROBLEM,
    T=5.0,
    steps=(1280, 2560, 5120, 10240, 20480),
    samples=128,
    schemes=("midpoint", "milstein"),
)
COST = {"energy-preserving": 1.2e-3, "midpoint": 1.2e-3, "discrete-gradient": 2.3e-3}

_PARAMETERS = {
    "a": -2.0, "b": -1.0, "d": -0.5, "nu": 1.0, "mu": 2.0, "c": 0.5, "y0": [1.0, 1.9, 0.5], "h": H, "T": STEPS * H,
}  # fmt: skip


def jobs(size: Size) -> list[Job]:
    """Runs, and the errors, of the paper's six schemes and of splitting."""
    found = [*order.jobs(ORDER, size), *fine_step.jobs(FINE, size)]
    for name in SHOWN:
        seconds = STEPS * COST.get(name, 150e-6)
        found.append(runs.job("4.6", name, PROBLEM, size, h=H, steps=STEPS, seconds=seconds))
    return found


def panels(results: Results) -> list[Panel]:
    """Figure 4.6: the Hamiltonian along one sample, and the order."""
    found: dict[str, runs.Run] = {name: results["4.6", "run", name] for name in SHOWN}
    return [
        _hamiltonian(found),
        _order(order.collect(ORDER, results)),
        fine_step.panel(
            FINE, results, source="Figure 4.6, right, on the interval of its left plot", stated="§4.4"
        ),
    ]


def _hamiltonian(found: dict[str, runs.Run]) -> Panel:
    statements = [
        invariants.statement(
            found[n], PROBLEM, "energy", constant=n in KEEP, source=order.stated_in(n, "§4.4")
        )
        for n in SHOWN
    ]
    statements.append(_domain(found["splitting"]))
    return Panel(
        key="4.6-hamiltonian",
        title="Lotka-Volterra: energy",
        source="Figure 4.6, left",
        x=Axis("time t"),
        y=Axis("energy H"),
        series=tuple(invariants.curve(found[n], found[n].energy) for n in SHOWN),
        parameters=dict(_PARAMETERS),
        chosen=("splitting, which the paper names and does not show, is added",),
        statements=tuple(statements),
        description="Energy-preserving and discrete gradient scheme keep the energy; the others do not, and splitting "
        "stays near it.",
    )


def _domain(run: runs.Run) -> Statement:
    """What splitting is for: y > 0, and the Casimir, which is not quadratic."""
    system = problems.by_name(PROBLEM)
    assert system.nambu is not None
    y = run.y
    smallest = float(np.min(y))
    with np.errstate(invalid="ignore"):
        casimir = system.nambu.casimir(y)
        # An ulp of each y_i moves C by |∂C/∂ln y_i| eps; a step multiplies each component a few times.
        size = float(np.max(np.sum(np.abs(system.nambu.gradient(y) * y), axis=0)))
    moved, limit = float(np.max(np.abs(casimir - casimir[0]))), runs.rounding_bound(run.steps) * size
    return Statement(
        text=f"{order.sentence(run.scheme)} remains in the domain y > 0, and keeps the Casimir",
        source="[23] in §1",
        verdict=decide(smallest > 0 and moved <= limit, not smallest > 0 or moved > invariants.FAR * limit),
        measured=f"smallest component {smallest:.3g}, largest change of C {moved:.1e} over {run.steps} steps",
        criterion=f"positive; rounding can do {limit:.1e} to C",
    )


def _order(errors: dict[str, StrongErrors]) -> Panel:
    return order.panel(
        ORDER,
        errors,
        title="Lotka-Volterra: order",
        source="Figure 4.6, right",
        place="§4.4, Theorem 3.4",
        chosen=(
            "end time 1/2, 1000 samples and step sizes 2^-8 to 2^-11 (the paper gives none of these)",
            "the exact solution instead of the midpoint scheme with h = 2^-12",
            "splitting, which the paper does not show, is added",
        ),
    )


PANELS = {"4.6": panels}
