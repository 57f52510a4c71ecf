"""One path of a large problem: the state at the end, and the largest defects of the invariants along the path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sepv.errors import StepFailure, UsageError
from sepv.large._problem import LargeProblem
from sepv.large._schemes import LargeStep
from sepv.problem import Array
from sepv.simulate import step_count, wiener
from sepv.simulate import truncation as bounded
from sepv.solve import Status


@dataclass(frozen=True)
class LargePath:
    """The end of a path of a large problem, with the largest defects of its invariants along the path.

    Attributes
    ----------
    y : (d,)
    W : (m,)
        W(T), the sums of the untruncated Wiener increments.
    energy_defect : float
        Largest |H(y_n) − H(y_0)| over the steps, with the terms of H summed exactly.
    energy_scale : float
        Σ|terms of H| at y_0, the scale of an energy defect. H(y_0) is no scale: its terms may cancel to zero.
    casimir_defect, other_casimir_defect : float
        Largest |C(y_n) − C(y_0)|: the first of quadratic and linear Casimirs C, the second of all other Casimirs.
    iterations : int
        The number of Newton iterations in all steps together.
    """

    y: Array
    W: Array
    energy_defect: float
    energy_scale: float
    casimir_defect: float
    other_casimir_defect: float
    iterations: int


def integrate(
    step: LargeStep,
    problem: LargeProblem,
    *,
    h: float,
    steps: int,
    seed: int = 0,
    dW: ArrayLike | None = None,
    y0: ArrayLike | None = None,
    truncation: int | None = 2,
) -> LargePath:
    """Run one path of N steps of a large problem from y0 (by default the problem's initial state).

    Parameters
    ----------
    step : `sepv.large.energy_preserving` or `sepv.large.midpoint`
    dW : (N, m), optional
        Untruncated increments, by default those of path 0 of `sepv.simulate.increments(seed, …)`.
    truncation : int or None
        The k with which increments are truncated as in Remark 2.1 of Cohen and Dujardin; None for no truncation.

    Raises
    ------
    StepFailure
        If the implicit equation of a step was not solved; raised at the first such step.
    UsageError
        If the arguments do not describe a path.
    """
    m, steps = len(problem.noise), step_count(h, None, steps)
    if dW is None:
        dW = wiener.increments(seed, T=h * steps, steps=steps, noises=m)[:, :, 0]
    raw = np.asarray(dW, dtype=np.float64)
    y = np.array(problem.initial if y0 is None else y0, dtype=np.float64)
    for name, array, shape in (("dW", raw, (steps, m)), ("y0", y, (problem.dimension,))):
        if array.shape != shape or not np.all(np.isfinite(array)):
            raise UsageError(
                expected=f"{name} finite, of shape {shape}",
                received=f"shape {array.shape}",
                remedy="one row of dW for each step, one number of y0 for each component",
            )
    used = bounded.truncate(raw, h, truncation)
    start, first = y, _casimirs(problem, y)
    scale = float(np.sum(np.abs(problem.terms(y))))
    worst, iterations = np.zeros(3), 0
    for n in range(steps):
        delta = problem.random_step(h, used[n])
        solution = step(problem, y, delta)
        iterations += solution.iterations
        if solution.status is not Status.CONVERGED:
            raise StepFailure(
                problem=f"{problem.name} at step {n + 1}",
                y=y[:4],
                delta=delta,
                residual=solution.residual,
                status=solution.status.text,
                iterations=solution.iterations,
            )
        y = solution.value
        now = _casimirs(problem, y)
        drift = [float(np.max(np.abs(a - b), initial=0.0)) for a, b in zip(now, first, strict=True)]
        worst = np.maximum(worst, [abs(problem.energy_difference(y, start)), *drift])
    return LargePath(y, raw.sum(axis=0), float(worst[0]), scale, float(worst[1]), float(worst[2]), iterations)


def _casimirs(problem: LargeProblem, y: Array) -> tuple[Array, Array]:
    """The values at y of the quadratic and linear Casimirs, and of the other Casimirs."""
    one, other = (np.zeros(0) if C is None else C(y) for C in (problem.casimirs, problem.other_casimirs))
    return one, other
