"""The implicit equation of a step, y1 = y0 + R(y0, y1), by Newton's method iterated to stagnation.

A solver stopped at a tolerance leaves a residual that acts as a force: stopped at 1e-12 it makes the
energy drift linearly, where stagnation leaves the random walk of rounding. Convergence is a result,
never an assumption: every lane of a batch carries its status.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sepv.errors import StepFailure
from sepv.fields import linear_solve, matvec
from sepv.polynomial import PolynomialMap
from sepv.problem import Array, Problem

_EPS = float(np.finfo(np.float64).eps)
_TINY = float(np.finfo(np.float64).tiny)
# A residual of a few of the smallest numbers there are is none.
_QUANTA = 4 * float(np.finfo(np.float64).smallest_subnormal)
# Newton needs 3 to 5 iterations for steps that make sense; 40 leave room for damped starts.
MAX_ITERATIONS = 40
MAX_HALVINGS = 40
# Damped iterations of a solve that failed undamped, and the smallest share of a correction that they take.
MAX_DAMPED = 100
SMALLEST_SHARE = 2.0**-20
# Corrections that stop shrinking are rounding, not divergence, only when they are small: √eps.
STAGNATION = float(np.sqrt(_EPS))
# … and when the residual is rounding too: a few hundred operations stand behind R, each rounded at the scale of y.
# Without this, corrections that shrink slowly (Newton's matrix is approximate for some H) pass for stagnation.
ROUNDING = 256 * _EPS
# Differences of R are taken for so many lanes at a time: beyond, memory grows and nothing is gained.
LANES = 256
# The rounding of a sum of a dozen terms, beside their absolute values: far below the K of `sepv.tolerance`.
TERMS = 16 * _EPS


class Status(IntEnum):
    """How a solve ended."""

    CONVERGED = 0
    NO_CONVERGENCE = 1
    LEFT_DOMAIN = 2
    OVERFLOW = 3
    SINGULAR = 4
    QUADRATURE = 5
    UNDEFINED = 6

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
    Status.UNDEFINED: "a structure is undefined: ∇H_0 vanishes or nearly so, and B∇H_j does not",
}


class Increment(NamedTuple):
    """R(y0, y1) of shape (d, M), evaluations of ∇H and of B (M,), and where the quadrature is reliable.

    `parts` are what the Jacobian takes over instead of computing it again, as further arguments.
    """

    value: Array
    gradients: np.ndarray
    structures: np.ndarray
    reliable: np.ndarray
    parts: tuple[Array, ...] = ()


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
    divisions : (M,), optional
        Steps and parts of steps that were divided, for schemes that do (`sepv.division.divided`).
    continuations : (M,), optional
        Shares of steps that were solved on the way to failed ones (`sepv.continuation.continued`).
    """

    value: Array
    residual: Array
    iterations: NDArray[np.int64]
    gradient_evaluations: NDArray[np.int64]
    structure_evaluations: NDArray[np.int64]
    status: NDArray[np.int64]
    change: Array | None = None
    divisions: NDArray[np.int64] | None = None
    continuations: NDArray[np.int64] | None = None


IncrementFunction = Callable[[Problem, Array, Array, Array], Increment]
JacobianFunction = Callable[..., Array | None]


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
    exact : bool
        Whether the Jacobian is that of R, and not of R with H″ averaged by a few nodes.
    magnitude : (z, lanes) -> (M,), optional
        The sum of the absolute values of the terms of R, to which its rounding is relative whatever cancels.
    """

    size: Array
    evaluate: Callable[[Array, NDArray[np.intp]], Evaluation]
    inside: Callable[[Array, NDArray[np.intp]], NDArray[np.bool_]] | None = None
    exact: bool = False
    magnitude: Callable[[Array, NDArray[np.intp]], Array] | None = None


def solve(
    problem: Problem,
    y0: Array,
    step: Array,
    increment: IncrementFunction,
    jacobian: JacobianFunction,
    start: Array | None = None,
) -> Solution:
    """Solve y1 = y0 + R(y0, y1) for every lane.

    Parameters
    ----------
    y0 : (d, M)
    step : (k, M)
        What R needs of the step, lane by lane, such as Δ.
    increment : (problem, y0, y1, step) -> Increment
        R.
    jacobian : (problem, y0, y1, step, *parts) -> (d, d, M) or None
        ∂R/∂y1; None has it formed from differences of R.
    start : (d, M), optional
        A guess of y1 − y0; by default 0.

    Notes
    -----
    The unknown is δ = y1 − y0. The iteration stops where the next correction is below half an ulp of
    every component, or where corrections no longer shrink. That correction is not applied: the
    residual returned is the one at the value returned, at no further evaluation.
    """

    def evaluate(z: Array, lanes: NDArray[np.intp]) -> Evaluation:
        y, s = (y0, step) if lanes is everything else (y0[:, lanes], step[:, lanes])
        y1 = y + z
        R = increment(problem, y, y1, s)

        def slope() -> tuple[Array, int]:
            K = jacobian(problem, y, y1, s, *R.parts)
            if K is not None:
                return K, 0
            return _difference_jacobian(problem, y, y1, s, increment, R.value), y.shape[0]

        return Evaluation(R, slope)

    def inside(z: Array, lanes: NDArray[np.intp]) -> NDArray[np.bool_]:
        assert problem.domain is not None
        return np.asarray(problem.domain(y0[:, lanes] + z), dtype=bool)

    def magnitude(z: Array, lanes: NDArray[np.intp]) -> Array:
        reach = np.maximum(np.abs(y0[:, lanes]), np.abs(y0[:, lanes] + z))
        flow = matvec(_majorant(problem.structure, reach), _majorant(problem.gradient, reach))
        terms: Array = sum(np.abs(step[:, lanes])) * flow.max(axis=0)
        return terms

    everything = np.arange(y0.shape[1])
    exact = None not in (problem.degree, problem.hessian, problem.structure_derivative)
    equations = Equations(np.abs(y0), evaluate, None if problem.domain is None else inside, exact, magnitude)
    solution = iterate(equations, np.zeros_like(y0) if start is None else start, everything)
    return replace(solution, value=y0 + solution.value, change=solution.value)


def _majorant(function: Callable[[Array], Array], y: Array) -> Array:
    """Absolute coefficients for polynomials, else |value|."""
    return function.majorant(y) if isinstance(function, PolynomialMap) else np.abs(function(y))


def iterate(equations: Equations, start: Array, lanes: NDArray[np.intp] | None = None) -> Solution:
    """Newton's iteration for z = R(z) to stagnation, from `start` (n, M) in the given lanes (default: all M).

    A lane that is close when it ends, but not at rounding, goes on from there with a Jacobian from differences of
    R: analytic ones may average H″ with a few nodes, which does not suffice for long steps of every H. A lane
    that fails is approached once more from z = 0 by damped steps and then goes on in the same way. Lanes that
    converge at once see nothing of this. The fields of the solution have one entry for each lane, `value` being z.
    """
    numbers = np.arange(start.shape[1]) if lanes is None else lanes
    solution = _newton(equations, start, numbers, differences=False)
    failed = np.flatnonzero((solution.status != Status.CONVERGED) & (solution.status != Status.QUADRATURE))
    if failed.size:
        z, size = solution.value[:, failed], equations.size[:, numbers[failed]]
        near = solution.residual[failed] <= STAGNATION * (size + np.abs(z)).max(axis=0)
        _finish(equations, solution, numbers, failed[near])
        failed = failed[solution.status[failed] != Status.CONVERGED]
        merge(solution, _approach(equations, numbers[failed]), failed)
        _finish(equations, solution, numbers, failed[solution.status[failed] == Status.CONVERGED])
    return solution


def _finish(
    equations: Equations, solution: Solution, numbers: NDArray[np.intp], lanes: NDArray[np.intp]
) -> None:
    """Go on from where the given lanes are, with the Jacobian of R itself."""
    if lanes.size:
        merge(
            solution,
            _newton(equations, solution.value[:, lanes], numbers[lanes], differences=True),
            lanes,
        )


def merge(whole: Solution, part: Solution, lanes: NDArray[np.intp]) -> None:
    """Write lanes that were solved anew into a solution; counts add up."""
    whole.value[:, lanes], whole.residual[lanes], whole.status[lanes] = part.value, part.residual, part.status
    whole.iterations[lanes] += part.iterations
    whole.gradient_evaluations[lanes] += part.gradient_evaluations
    whole.structure_evaluations[lanes] += part.structure_evaluations
    if whole.continuations is not None and part.continuations is not None:
        whole.continuations[lanes] += part.continuations


def _newton(equations: Equations, start: Array, numbers: NDArray[np.intp], *, differences: bool) -> Solution:
    """Newton's iteration with full steps, cut only where they leave the domain.

    With `differences` the Jacobian is that of R itself, and not of an approximation of R. Only with a Jacobian of
    R itself are corrections that do not shrink a sign of rounding, whatever the residual.
    """
    newton = _newton_of_one if start.shape[1] == 1 else _newton_of_many
    return newton(equations, start, numbers, differences=differences)


def _newton_of_many(
    equations: Equations, start: Array, numbers: NDArray[np.intp], *, differences: bool
) -> Solution:
    """`_newton` for a batch: each lane goes on until it is done, whatever the others do.

    What is seldom needed is asked for only where some lane needs it, and nothing is copied while all lanes go on.
    """
    exact = differences or equations.exact
    n, count = start.shape
    z_all, size_all = start.copy(), equations.size[:, numbers]
    # Where y1 is 2^52 times y0 or more, an ulp of it says nothing about the components that stayed small. Where
    # y0 = 0 nothing says what small is: a component that cancels to zero would never settle.
    before = size_all.max(axis=0)
    vast_all = np.where(before > 0, before / _EPS, np.inf)
    residual = np.full(count, np.inf)
    iterations, gradients, structures = np.zeros((3, count), dtype=np.int64)
    status = np.full(count, Status.NO_CONVERGENCE, dtype=np.int64)
    last_size = last_move = np.full(count, np.inf)
    active, identity = np.arange(count), np.eye(n)[..., None]
    with np.errstate(all="ignore"):
        for _ in range(MAX_ITERATIONS):
            z, lanes, y = z_all, numbers, size_all
            at: Any = slice(None)
            if active.size < count:
                z, lanes, y, at = z[:, active], lanes[active], y[:, active], active
            R, jacobian = equations.evaluate(z, lanes)
            F = z - R.value
            residual[at] = rest = np.abs(F).max(axis=0)
            iterations[at] += 1
            K, further = _slopes(equations, z, lanes, R.value) if differences else jacobian()
            gradients[at] += (1 + further) * R.gradients
            structures[at] += (1 + further) * R.structures
            correction = linear_solve(identity - K, F)
            reach, moves = y + np.abs(z), np.abs(correction)
            scale, move = reach.max(axis=0), moves.max(axis=0)
            size = (moves / (reach + _EPS * scale + _TINY)).max(axis=0)
            solved, broken, singular = _stopped(rest, move, K)
            # Stagnation needs both measures to stop shrinking: a component near zero moves by a large share of
            # itself long before the others have arrived.
            stuck = (size >= 0.5 * last_size) & (move >= 0.5 * last_move)
            still = _small(size, moves, reach, scale > vast_all[at]) | ((move <= STAGNATION * scale) & stuck)
            if still.any():
                still &= _is_rounding(equations, lanes, rest, z, scale, still & exact)
            ended = broken | singular | solved | still
            if ended.any():
                outcome = np.where(R.reliable, Status.CONVERGED, Status.QUADRATURE)
                outcome[broken], outcome[singular] = Status.OVERFLOW, Status.SINGULAR
                status[active[ended]] = outcome[ended]
                if ended.all():
                    break
                go_on = ~ended
                z, correction, size, move = z[:, go_on], correction[:, go_on], size[go_on], move[go_on]
                active, lanes = active[go_on], lanes[go_on]
            last_size, last_move = size, move
            moved, inside = into_domain(equations, z, correction, lanes)
            z_all[:, active] = moved
            if not inside.all():
                status[active[~inside]] = Status.LEFT_DOMAIN
                active, last_size, last_move = active[inside], size[inside], move[inside]
            if not active.size:
                break
    return Solution(z_all, residual, iterations, gradients, structures, status)


def _small(size: Array, moves: Array, reach: Array, vast: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where the correction is below half an ulp of every component, and no share of those that a vast one hides."""
    small: NDArray[np.bool_] = size <= 0.5 * _EPS
    if vast.any():
        small &= ~(vast & (moves > STAGNATION * reach).any(axis=0))
    return small


def _stopped(
    rest: Array, move: Array, K: Array
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
    """Which lanes are solved exactly, which overflow, and which have a singular Jacobian.

    A state at rest is a solution, also where the Jacobian is singular.
    """
    solved: NDArray[np.bool_] = rest <= _QUANTA
    broken = ~np.isfinite(rest)
    singular = ~(broken | solved | np.isfinite(move))
    if singular.any():
        overflowing = singular & ~np.isfinite(K).all(axis=(0, 1))
        broken, singular = broken | overflowing, singular & ~overflowing
    return solved, broken, singular


def _newton_of_one(
    equations: Equations, start: Array, number: NDArray[np.intp], *, differences: bool
) -> Solution:
    """`_newton` for one lane, to the bits of `_newton_of_many`: decided over numbers, without a call of NumPy each."""
    exact = differences or equations.exact
    z, y = start, equations.size[:, number].ravel().tolist()
    before = _largest(y)
    residual, iterations, gradients, structures = math.inf, 0, 0, 0
    identity = np.eye(len(start))[..., None]
    status, last_size, last_move = Status.NO_CONVERGENCE, math.inf, math.inf
    with np.errstate(all="ignore"):
        for _ in range(MAX_ITERATIONS):
            R, jacobian = equations.evaluate(z, number)
            F = z - R.value
            rest = residual = _largest(F.ravel().tolist())
            iterations += 1
            K, further = _slopes(equations, z, number, R.value) if differences else jacobian()
            gradients += (1 + further) * int(R.gradients[0])
            structures += (1 + further) * int(R.structures[0])
            if not math.isfinite(rest):
                status = Status.OVERFLOW
                break
            correction = linear_solve(identity - K, F)
            reach = [a + abs(b) for a, b in zip(y, z.ravel().tolist(), strict=True)]
            moves = [abs(v) for v in correction.ravel().tolist()]
            scale, move = _largest(reach), _largest(moves)
            solved = rest <= _QUANTA
            if not solved and not math.isfinite(move):
                status = Status.SINGULAR if np.isfinite(K).all() else Status.OVERFLOW
                break
            size = _largest([a / (b + _EPS * scale + _TINY) for a, b in zip(moves, reach, strict=True)])
            stuck = size >= 0.5 * last_size and move >= 0.5 * last_move
            vast = before > 0 and scale > before / _EPS
            small = size <= 0.5 * _EPS and not (
                vast and any(a > STAGNATION * b for a, b in zip(moves, reach, strict=True))
            )
            still = small or (move <= STAGNATION * scale and stuck)
            if still and not rest <= ROUNDING * scale + _QUANTA:
                least = np.array([rest]), z, np.array([scale]), np.array([exact])
                still = bool(_is_rounding(equations, number, *least)[0])
            if solved or still:
                status = Status.CONVERGED if R.reliable[0] else Status.QUADRATURE
                break
            last_size, last_move = size, move
            z, inside = into_domain(equations, z, correction, number)
            if not inside[0]:
                status = Status.LEFT_DOMAIN
                break
    counted = np.array([[iterations], [gradients], [structures], [status]], dtype=np.int64)
    return Solution(z.copy(), np.array([residual]), *counted)


def _largest(values: list[float]) -> float:
    """The largest absolute value; NaN where there is one, as with NumPy."""
    if math.isnan(sum(values)) and any(map(math.isnan, values)):
        return math.nan
    return max(map(abs, values))


def _is_rounding(
    equations: Equations,
    numbers: NDArray[np.intp],
    residual: Array,
    z: Array,
    scale: Array,
    asked: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Where a residual is no larger than the rounding of R: that of y, of R's terms, and what a rounding of y does.

    The last, |K||y0| with K = ∂R/∂y1, is what stiff equations need, whose R cancels. It is taken at y1 = y0,
    sixteenfold for what changes along the step: at y1 itself it would excuse any residual next to a singularity
    of ∇H, where R can no longer be computed. Both are asked for only where the first does not suffice.
    """
    rounding = residual <= ROUNDING * scale + _QUANTA
    open_ = np.flatnonzero(asked & ~rounding)
    if open_.size:
        K, _ = equations.evaluate(np.zeros_like(z[:, open_]), numbers[open_]).jacobian()
        through = matvec(np.abs(K), equations.size[:, numbers[open_]]).max(axis=0)
        allowed = ROUNDING * (scale[open_] + 16 * through)
        if equations.magnitude is not None:
            allowed = np.fmax(allowed, TERMS * equations.magnitude(z[:, open_], numbers[open_]))
        rounding[open_] = residual[open_] <= allowed
    return rounding


def _approach(equations: Equations, numbers: NDArray[np.intp]) -> Solution:
    """Damped Newton from z = 0 up to where full steps contract; CONVERGED means that they do.

    In the limit of small shares it follows the path on which all of F shrinks alike, which ends in a solution
    or where the Jacobian is singular.
    """
    n, count = equations.size.shape[0], numbers.size
    none = np.zeros(count, dtype=np.int64)
    state = Solution(
        np.zeros((n, count)), np.full(count, np.inf), none, none.copy(), none.copy(),
        np.full(count, Status.NO_CONVERGENCE, dtype=np.int64),
    )  # fmt: skip
    share, active = np.ones(count), np.arange(count)
    with np.errstate(all="ignore"):
        for _ in range(MAX_DAMPED):
            z = state.value[:, active]
            R, _ = equations.evaluate(z, numbers[active])
            K, further = _slopes(equations, z, numbers[active], R.value)
            F, A = z - R.value, np.eye(n)[..., None] - K
            state.residual[active] = np.abs(F).max(axis=0)
            state.iterations[active] += 1
            state.gradient_evaluations[active] += (1 + further) * R.gradients
            state.structure_evaluations[active] += (1 + further) * R.structures
            correction = linear_solve(A, F)
            regular = np.isfinite(correction).all(axis=0)
            finite = np.isfinite(state.residual[active]) & np.isfinite(K).all(axis=(0, 1))
            failed = np.where(finite, Status.SINGULAR, Status.OVERFLOW)
            state.status[active[~regular]] = failed[~regular]
            active, A, correction = active[regular], A[:, :, regular], correction[:, regular]
            share[active] = np.minimum(1.0, 4 * share[active])
            moved = _take_share(equations, numbers, state, share, active, A, correction)
            active = active[moved & (state.status[active] != Status.CONVERGED)]
            if not active.size:
                break
    return state


def _take_share(
    equations: Equations,
    numbers: NDArray[np.intp],
    state: Solution,
    share: Array,
    active: NDArray[np.intp],
    A: Array,
    p: Array,
) -> NDArray[np.bool_]:
    """Move the active lanes by a share λ of the correction p = A⁻¹F, halved until it passes; whether it did.

    A share passes where z − λp is in the domain, R is finite there, and the simplified correction A⁻¹F(z − λp)
    is at most (1 − λ/4)|p|: a test that no linear change of the equations changes (P. Deuflhard, Newton
    Methods for Nonlinear Problems, 2004, §3.3).
    """
    z, length = state.value[:, active], np.abs(p).max(axis=0)
    moved = np.zeros(active.size, dtype=bool)
    open_ = np.arange(active.size)
    while open_.size:
        where = active[open_]
        trial = z[:, open_] - share[where] * p[:, open_]
        inside = np.ones(open_.size, dtype=bool)
        if equations.inside is not None:
            inside = equations.inside(trial, numbers[where])
        R, _ = equations.evaluate(trial, numbers[where])
        state.gradient_evaluations[where] += R.gradients
        state.structure_evaluations[where] += R.structures
        after = np.abs(linear_solve(A[:, :, open_], trial - R.value)).max(axis=0)
        good = inside & (after <= (1 - share[where] / 4) * length[open_])
        state.value[:, where[good]] = trial[:, good]
        moved[open_[good]] = True
        arrived = good & (share[where] == 1.0) & (after <= 0.25 * length[open_])
        state.status[where[arrived]] = Status.CONVERGED
        obstacle = np.where(np.isfinite(after), Status.NO_CONVERGENCE, Status.OVERFLOW)
        obstacle = np.where(inside, obstacle, Status.LEFT_DOMAIN)
        share[where[~good]] *= 0.5
        blocked = ~good & (share[where] < SMALLEST_SHARE)
        state.status[where[blocked]] = obstacle[blocked]
        open_ = open_[~good & ~blocked]
    return moved


def require_converged(problem: Problem, y: Array, h: float, dW: Array, solution: Solution) -> Array:
    """The value of a solution whose lanes all converged; y (d, M) and dW (m, M) are what was solved for.

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
            delta=float(h + problem.c @ dW[:, lane]),
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


def _slopes(equations: Equations, z: Array, numbers: NDArray[np.intp], base: Array) -> tuple[Array, int]:
    """∂R/∂z by differences, and their n evaluations."""
    reach, domain = (equations.size[:, numbers] + np.abs(z)).max(axis=0), equations.inside
    inside = None if domain is None else lambda at, lanes: domain(at, numbers[lanes])
    R = lambda at, lanes: equations.evaluate(at, numbers[lanes]).right_side.value  # noqa: E731
    return _differences(R, inside, z, base, reach), z.shape[0]


def _difference_jacobian(
    problem: Problem, y0: Array, y1: Array, step: Array, increment: IncrementFunction, base: Array
) -> Array:
    """∂R/∂y1 by differences. Their error of about √eps costs Newton one iteration, not accuracy.

    Their width follows the larger of y and the step: from y0 = 0 a width of nothing would divide roundings of R by it.
    """
    reach, domain = np.max([np.abs(y0), np.abs(y1), np.abs(base)], axis=0).max(axis=0), problem.domain
    inside = None if domain is None else lambda at, _: domain(at)
    R = lambda at, lanes: increment(problem, y0[:, lanes], at, step[:, lanes]).value  # noqa: E731
    return _differences(R, inside, y1, base, reach)


def _differences(
    R: Callable[[Array, NDArray[np.intp]], Array],
    inside: Callable[[Array, NDArray[np.intp]], Any] | None,
    z: Array,
    base: Array,
    reach: Array,
) -> Array:
    """∂R/∂z by forward differences, backward ones where those leave the domain; `reach` (M,) is the size of z.

    R and `inside` are asked for several components at once, as lanes, for few lanes; they are told the lanes' numbers.
    """
    n, M = z.shape
    width = STAGNATION * np.maximum(reach, _TINY)
    found = np.empty((len(base), n, M))
    together = max(1, LANES // max(M, 1))
    for first in range(0, n, together):
        columns = np.arange(first, min(first + together, n))
        count = len(columns)
        own, lanes = (columns, np.arange(count)), np.tile(np.arange(M), count)
        shifted = np.repeat(z[:, None], count, axis=1)
        shifted[own] += width
        if inside is not None:
            within = np.reshape(inside(shifted.reshape(n, count * M), lanes), (count, M))
            shifted[own] = np.where(within, shifted[own], z[columns] - width)
        values = R(shifted.reshape(n, count * M), lanes).reshape(len(base), count, M)
        found[:, columns] = (values - base[:, None]) / (shifted[own] - z[columns])
    return found
