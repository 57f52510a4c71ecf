"""The implicit equation of a step, y1 = y0 + R(y0, y1), by Newton's method iterated to stagnation.

A solver stopped at a tolerance leaves a residual that acts as a force: stopped at 1e-12 it makes the
energy drift linearly, where stagnation leaves the random walk of rounding. Convergence is a result,
never an assumption: every lane of a batch carries its status.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sepv.errors import StepFailure
from sepv.fields import linear_solve
from sepv.problem import Array, Problem

_EPS = float(np.finfo(np.float64).eps)
_TINY = float(np.finfo(np.float64).tiny)
# Newton needs 3 to 5 iterations for steps that make sense; 40 leave room for damped starts.
MAX_ITERATIONS = 40
MAX_HALVINGS = 40
# Corrections that stop shrinking are rounding, not divergence, only when they are small: √eps.
STAGNATION = float(np.sqrt(_EPS))
# … and when the residual is rounding too: a few hundred operations stand behind R, each rounded at the scale of y.
# Without this, corrections that shrink slowly (Newton's matrix is approximate for some H) pass for stagnation.
ROUNDING = 256 * _EPS


class Status(IntEnum):
    """How a solve ended."""

    CONVERGED = 0
    NO_CONVERGENCE = 1
    LEFT_DOMAIN = 2
    OVERFLOW = 3
    SINGULAR = 4
    QUADRATURE = 5

    @property
    def text(self) -> str:
        """The status in words."""
        return _TEXTS[self]


_TEXTS = {
    Status.CONVERGED: "converged",
    Status.NO_CONVERGENCE: "no convergence",
    Status.LEFT_DOMAIN: "left the domain of the problem",
    Status.OVERFLOW: "overflow or NaN in B or ∇H",
    Status.SINGULAR: "singular Jacobian",
    Status.QUADRATURE: "the adaptive quadrature of ∇H did not reach rounding",
}


class Increment(NamedTuple):
    """R(y0, y1) of shape (d, M), evaluations of ∇H and of B (M,), and where the quadrature is reliable."""

    value: Array
    gradients: np.ndarray
    structures: np.ndarray
    reliable: np.ndarray


@dataclass(frozen=True)
class Solution:
    """What happened in a solve, lane by lane.

    Attributes
    ----------
    value : (d, M)
        y1 where converged; the last iterate elsewhere.
    residual : (M,)
        Largest component of |y1 − y0 − R(y0, y1)|, at `value`.
    iterations, gradient_evaluations, structure_evaluations : (M,)
        Newton iterations, and evaluations of ∇H and B (those of Newton's Jacobian not counted).
    status : (M,)
        `Status` of each lane.
    change : (d, M), optional
        y1 − y0 before it was rounded into `value`: compensated summation needs it.
    """

    value: Array
    residual: Array
    iterations: NDArray[np.int64]
    gradient_evaluations: NDArray[np.int64]
    structure_evaluations: NDArray[np.int64]
    status: NDArray[np.int64]
    change: Array | None = None


IncrementFunction = Callable[[Problem, Array, Array, Array], Increment]
JacobianFunction = Callable[[Problem, Array, Array, Array], Array | None]


class Evaluation(NamedTuple):
    """R(z) for some lanes, and on demand ∂R/∂z (n, n, M) with the evaluations that cost, in units of R's."""

    right_side: Increment
    jacobian: Callable[[], tuple[Array, int]]


@dataclass(frozen=True)
class Equations:
    """z = R(z) for n unknowns in every lane; `lanes` are the numbers of the lanes asked about.

    Attributes
    ----------
    size : (n, M)
        |y| of the state that each unknown is added to: corrections are small or not beside |y| + |z|.
    evaluate : (z, lanes) -> Evaluation
    inside : (z, lanes) -> (M,) of bool, optional
        Whether the states that belong to z lie in the domain of the problem.
    """

    size: Array
    evaluate: Callable[[Array, NDArray[np.intp]], Evaluation]
    inside: Callable[[Array, NDArray[np.intp]], NDArray[np.bool_]] | None = None


def solve(
    problem: Problem,
    y0: Array,
    step: Array,
    increment: IncrementFunction,
    jacobian: JacobianFunction,
) -> Solution:
    """Solve y1 = y0 + R(y0, y1) for every lane.

    Parameters
    ----------
    y0 : (d, M)
    step : (k, M)
        What R needs of the step, lane by lane, such as Δ.
    increment : (problem, y0, y1, step) -> Increment
        R.
    jacobian : (problem, y0, y1, step) -> (d, d, M) or None
        ∂R/∂y1; None has it formed from differences of R.

    Notes
    -----
    The unknown is δ = y1 − y0. The iteration stops where the next correction is below half an ulp of
    every component, or where corrections no longer shrink. That correction is not applied: the
    residual returned is the one at the value returned, at no further evaluation.
    """

    def evaluate(z: Array, lanes: NDArray[np.intp]) -> Evaluation:
        y, s = y0[:, lanes], step[:, lanes]
        R = increment(problem, y, y + z, s)

        def slope() -> tuple[Array, int]:
            K = jacobian(problem, y, y + z, s)
            if K is not None:
                return K, 0
            return _difference_jacobian(problem, y, y + z, s, increment, R.value), y.shape[0]

        return Evaluation(R, slope)

    def inside(z: Array, lanes: NDArray[np.intp]) -> NDArray[np.bool_]:
        assert problem.domain is not None
        return np.asarray(problem.domain(y0[:, lanes] + z), dtype=bool)

    equations = Equations(np.abs(y0), evaluate, None if problem.domain is None else inside)
    solution = iterate(equations, np.zeros_like(y0))
    return replace(solution, value=y0 + solution.value, change=solution.value)


def iterate(equations: Equations, start: Array, lanes: NDArray[np.intp] | None = None) -> Solution:
    """Newton's iteration for z = R(z) to stagnation, from `start` (n, M) in the given lanes (default: all M).

    The fields of the solution have one entry for each of these lanes, `value` being z.
    """
    numbers = np.arange(start.shape[1]) if lanes is None else lanes
    n, count = start.shape
    z_all, size_all = start.copy(), equations.size[:, numbers]
    residual = np.full(count, np.inf)
    iterations = np.zeros(count, dtype=np.int64)
    gradients, structures = np.zeros_like(iterations), np.zeros_like(iterations)
    status = np.full(count, Status.NO_CONVERGENCE, dtype=np.int64)
    previous = np.full((2, count), np.inf)
    active = np.arange(count)
    with np.errstate(all="ignore"):
        for _ in range(MAX_ITERATIONS):
            z = z_all[:, active]
            R, jacobian = equations.evaluate(z, numbers[active])
            F = z - R.value
            residual[active] = np.abs(F).max(axis=0)
            iterations[active] += 1
            K, further = jacobian()
            gradients[active] += (1 + further) * R.gradients
            structures[active] += (1 + further) * R.structures
            correction = linear_solve(np.eye(n)[..., None] - K, F)
            reach, moves = size_all[:, active] + np.abs(z), np.abs(correction)
            scale = reach.max(axis=0)
            size = (moves / (reach + _EPS * scale + _TINY)).max(axis=0)
            broken = ~np.isfinite(residual[active])
            solved = (
                residual[active] == 0
            )  # a state at rest is a solution, also where the Jacobian is singular
            singular = ~broken & ~solved & ~np.isfinite(moves.max(axis=0))
            small = (moves.max(axis=0) <= STAGNATION * scale) & (residual[active] <= ROUNDING * scale)
            # Stagnation needs both measures to stop shrinking: a component near zero moves by a large share of
            # itself long before the others have arrived.
            stuck = (size >= 0.5 * previous[0, active]) & (moves.max(axis=0) >= 0.5 * previous[1, active])
            done = ~broken & ~singular & (solved | (size <= 0.5 * _EPS) | (small & stuck))
            outcome = np.where(R.reliable, Status.CONVERGED, Status.QUADRATURE)
            status[active[done]] = outcome[done]
            status[active[broken]] = Status.OVERFLOW
            status[active[singular]] = Status.SINGULAR
            previous[:, active] = size, moves.max(axis=0)
            go_on = ~(done | broken | singular)
            moved, inside = into_domain(equations, z[:, go_on], correction[:, go_on], numbers[active[go_on]])
            z_all[:, active[go_on]] = moved
            active = active[go_on]
            status[active[~inside]] = Status.LEFT_DOMAIN
            active = active[inside]
            if not active.size:
                break
    return Solution(z_all, residual, iterations, gradients, structures, status)


def require_converged(problem: Problem, y: Array, step: Array, solution: Solution) -> Array:
    """The value of a solution whose lanes all converged.

    Raises
    ------
    StepFailure
        For the first lane that did not.
    """
    failed = np.flatnonzero(solution.status != Status.CONVERGED)
    if failed.size:
        lane = int(failed[0])
        raise StepFailure(
            problem=problem.name,
            y=y[:, lane],
            delta=float(np.sum(step[:, lane])),
            residual=float(solution.residual[lane]),
            status=Status(int(solution.status[lane])).text,
            iterations=int(solution.iterations[lane]),
        )
    return solution.value


def into_domain(
    equations: Equations, z: Array, correction: Array, lanes: NDArray[np.intp]
) -> tuple[Array, NDArray[np.bool_]]:
    """z − λ·correction with the largest λ = 2⁻ⁿ that stays in the domain, and where there is one."""
    moved = z - correction
    inside = np.ones(z.shape[1], dtype=bool)
    if equations.inside is None or not z.shape[1]:
        return moved, inside
    inside = equations.inside(moved, lanes)
    factor = np.ones(z.shape[1])
    for _ in range(MAX_HALVINGS):
        if inside.all():
            break
        factor[~inside] *= 0.5
        moved = z - factor * correction
        inside = equations.inside(moved, lanes)
    return moved, inside


def _difference_jacobian(
    problem: Problem, y0: Array, y1: Array, step: Array, increment: IncrementFunction, base: Array
) -> Array:
    """∂R/∂y1 by forward differences. Its error of about √eps costs Newton one iteration, not accuracy."""
    width = STAGNATION * np.maximum(np.maximum(np.abs(y0), np.abs(y1)).max(axis=0), _TINY)
    columns = []
    for k in range(y0.shape[0]):
        shifted = y1.copy()
        shifted[k] += width
        if problem.domain is not None:
            outside = ~np.asarray(problem.domain(shifted), dtype=bool)
            shifted[k, outside] = y1[k, outside] - width[outside]
        columns.append((increment(problem, y0, shifted, step).value - base) / (shifted[k] - y1[k]))
    return np.stack(columns, axis=1)
