"""Statements about an invariant along one sample: constant up to rounding, or not."""

from __future__ import annotations

import numpy as np

from sepv import problems
from sepv.problem import Array
from sepv.studies._picture import Series
from sepv.studies._reproduce.order import sentence
from sepv.studies._reproduce.record import Statement, decide, series
from sepv.studies._reproduce.runs import Run, rounding_bound

# A drift this many times the rounding bound is no rounding.
FAR = 1e3


def curve(run: Run, values: Array) -> Series:
    """An invariant along the first sample, at no more than about 600 steps, the last one among them."""
    kept = np.unique(np.append(np.arange(0, values.size, max(1, values.size // 600)), values.size - 1))
    return series(run.scheme, kept * run.h, values[kept], scheme=run.scheme)


def bound(run: Run, problem: str, what: str, *, constant: bool = True) -> float:
    """What rounding does to an invariant, relative to its value at the start.

    Rounding moves y_i by eps |y_i|, hence H by Σ|∂_iH y_i| of that: at most along the path where the scheme is
    said to keep H, at the start where it is not.
    """
    system = problems.by_name(problem)
    if what == "Casimir":
        return rounding_bound(run.steps)
    y = run.y if constant else run.y[:, :1]
    start = abs(float(system.hamiltonian(run.y[:, 0])))
    size = np.max(np.sum(np.abs(system.gradient(y) * y), axis=0)) + start
    return rounding_bound(run.steps) * float(size) / start


def drift(values: Array) -> float:
    """Largest relative distance from the value at the start."""
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.nanmax(np.abs(values - values[0])) / abs(values[0]))


def statement(run: Run, problem: str, what: str, *, constant: bool, source: str) -> Statement:
    """Whether `what` ("energy" or "Casimir") is constant, or not, as the paper says of this scheme."""
    values = run.energy if what == "energy" else run.casimir
    moved, limit = drift(values), bound(run, problem, what, constant=constant)
    kept, lost = moved <= limit, moved > FAR * limit or run.stopped > 0
    stopped = f"; the sample left the domain at step {run.stopped}" if run.stopped > 0 else ""
    return Statement(
        text=f"{sentence(run.scheme)} {'keeps' if constant else 'does not keep'} the {what}",
        source=source,
        verdict=decide(kept, lost) if constant else decide(lost, kept),
        measured=f"largest relative change {moved:.2g} over {run.steps} steps{stopped}",
        criterion=f"rounding can do {limit:.1e} (8 eps √N); "
        + ("at most that" if constant else f"more than {FAR:g} times that"),
    )
