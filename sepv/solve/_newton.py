"""The implicit equation of a step, y1 = y0 + R(y0, y1), by Newton's method iterated until corrections stagnate.

A solver that stops at a tolerance leaves a residual that acts as a force: with a tolerance of 1e-12 the energy drifts
linearly. After iteration to stagnation the energy makes only a random walk of roundings. Each lane (a path of a batch)
has its own status, so that convergence is reported and never assumed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from sepv.problem import Algebra, Array, Problem, matvec
from sepv.record import EPS, majorant
from sepv.solve import _stop_rule as stop
from sepv.solve._damped import approach
from sepv.solve._differences import difference_jacobian, slopes
from sepv.solve._from_record import Corrections
from sepv.solve._solution import (
    Counts,
    Equations,
    Evaluation,
    Flags,
    IncrementFunction,
    JacobianFunction,
    Lanes,
    Solution,
    Status,
    merge,
)
from sepv.solve._stop_rule import QUANTA, ROUNDING, STAGNATION

# The most iterations. Newton's method needs 3 to 5 for usual steps, and more after a damped start.
MAX_ITERATIONS = 40
MAX_HALVINGS = 40
# The most iterations by straight-line code (`_from_record`), which also needs 3 to 5 for usual steps.
MOST = 7
# The number of halvings that are tested in one call of the domain, if a correction leaves the domain.
SHARES = 8
# The most unknowns of a single path for which Python's numbers are faster than arrays.
FEW = 64
# The rounding of a sum of a dozen terms, relative to the sum of their absolute values: far below the constant K of
# `sepv.verification._tolerance`.
TERMS = 16 * EPS


def solve(
    problem: Problem,
    y0: Array,
    step: Array,
    increment: IncrementFunction,
    jacobian: JacobianFunction,
    start: Array | None = None,
    corrections: Corrections | None = None,
) -> Solution:
    """Solve the equation y1 = y0 + R(y0, y1) of a step for each of M paths.

    Parameters
    ----------
    y0 : (d, M)
    step : (k, M)
        The numbers of the step that R uses, such as Δ = h + Σ c_j ΔW_j.
    increment : (problem, y0, y1, step) -> Increment
        The right side R with counts of its evaluations.
    jacobian : (problem, y0, y1, step, *parts) -> (d, d, M) or None
        ∂R/∂y1, with the `parts` of `Increment`. If it returns None, differences of R are taken.
    start : (d, M), optional
        A guess of y1 − y0; by default 0.
    corrections : Corrections, optional
        Straight-line code that computes R and Newton's correction.

    Notes
    -----
    The unknown is z = y1 − y0. The iteration stops if the error after a correction is only rounding, or if
    corrections no longer shrink.
    """

    def evaluate(z: Array, lanes: Lanes) -> Evaluation:
        y, s = (y0, step) if lanes is everything else (y0[:, lanes], step[:, lanes])
        y1 = y + z
        R = increment(problem, y, y1, s)

        def slope() -> tuple[Array, int]:
            K = jacobian(problem, y, y1, s, *R.parts)
            if K is not None:
                return K, 0
            return difference_jacobian(problem, y, y1, s, increment, R.value), y.shape[0]

        return Evaluation(R, slope)

    def inside(z: Array, lanes: Lanes) -> Flags:
        assert problem.domain is not None
        return np.asarray(problem.domain(y0[:, lanes] + z), dtype=bool)

    def magnitude(z: Array, lanes: Lanes) -> Array:
        reach = np.maximum(np.abs(y0[:, lanes]), np.abs(y0[:, lanes] + z))
        flow = matvec(majorant(problem.structure, reach), majorant(problem.gradient, reach))
        terms: Array = sum(np.abs(step[:, lanes])) * flow.max(axis=0)
        return terms

    everything = np.arange(y0.shape[1])
    exact = None not in (problem.degree, problem.hessian, problem.structure_derivative)
    domain = None if problem.domain is None else inside
    equations = Equations(np.abs(y0), evaluate, domain, exact, magnitude, corrections=corrections)
    solution = iterate(equations, np.zeros_like(y0) if start is None else start, everything)
    change = solution.value
    costs = solution.iterations, solution.gradient_evaluations, solution.structure_evaluations
    return Solution(y0 + change, solution.residual, *costs, solution.status, change=change)


def iterate(equations: Equations, start: Array, lanes: Lanes | None = None) -> Solution:
    """Solve z = R(z) by Newton's method to stagnation, from `start` (n, M), with further attempts for lanes that fail.

    `lanes` are the numbers of the M lanes (paths) in `equations`, by default 0 … M − 1. `Solution.value` is z.

    A lane may end close to a solution, but not at rounding: an analytic Jacobian may average H″ with too few nodes for
    a long step. Such a lane goes on with a Jacobian from differences of R. A lane that still fails starts again from
    z = 0 by damped steps (`_damped`), and then also goes on with differences.

    A lane that does not converge by straight-line code in MOST iterations starts again without the code. So if there
    are several solutions, the one that is found does not depend on whether a problem has such code.
    """
    numbers = np.arange(start.shape[1]) if lanes is None else lanes
    solution = newton(equations, start, numbers, differences=False)
    if not solution.status.any():
        return solution
    if equations.corrections is not None:
        left = np.flatnonzero(solution.status)
        part = iterate(replace(equations, corrections=None), start[:, left], numbers[left])
        for key, values in vars(part).items():
            if values is not None:
                getattr(solution, key)[..., left] = values
        return solution
    failed = np.flatnonzero((solution.status != Status.CONVERGED) & (solution.status != Status.QUADRATURE))
    if failed.size:
        z, size = solution.value[:, failed], equations.size[:, numbers[failed]]
        near = solution.residual[failed] <= STAGNATION * (size + np.abs(z)).max(axis=0)
        _finish(equations, solution, numbers, failed[near])
        failed = failed[solution.status[failed] != Status.CONVERGED]
        merge(solution, approach(equations, numbers[failed]), failed)
        _finish(equations, solution, numbers, failed[solution.status[failed] == Status.CONVERGED])
    return solution


def _finish(equations: Equations, solution: Solution, numbers: Lanes, lanes: Lanes) -> None:
    """Iterate the paths `lanes` from their current z with a Jacobian from differences, and merge the results."""
    if lanes.size:
        finished = newton(equations, solution.value[:, lanes], numbers[lanes], differences=True)
        merge(solution, finished, lanes)


def newton(equations: Equations, start: Array, numbers: Lanes, *, differences: bool) -> Solution:
    """Newton's iteration for z = R(z) from `start` (n, M), by full steps, shortened only to stay in the domain.

    `numbers` are the numbers of the M lanes (paths) in `equations`. With `differences` the Jacobian comes from
    differences of R, and not from a formula, which may be approximate.
    """
    rule = _newton_of_one if start.shape[1] == 1 and len(start) <= FEW else _newton_of_many
    return rule(equations, start, numbers, differences=differences)


def _newton_of_many(equations: Equations, start: Array, numbers: Lanes, *, differences: bool) -> Solution:
    """`newton` for a batch: each lane (path) is iterated until it has ended, independently of the other lanes.

    Quantities that few lanes need are computed on demand. Arrays are not copied while all lanes are active.
    """
    count, algebra = start.shape[1], equations.algebra
    exact, recorded = differences or equations.exact, not differences and equations.corrections is not None
    z_all, size_all = start.copy(), equations.size[:, numbers]
    # If |y1| is 2^52 |y0| or more, a change below an ulp of |y1| may still be large for components that stayed small.
    # For y0 = 0 this test is off, because a component that cancels to zero would never pass it.
    before = size_all.max(axis=0)
    outgrown_at = np.where(before > 0, before / EPS, np.inf)
    residual = np.full(count, np.inf)
    iterations, gradients, structures = np.zeros((3, count), dtype=np.int64)
    status = np.full(count, Status.NO_CONVERGENCE, dtype=np.int64)
    last_size = last_move = np.full(count, np.inf)
    active = np.arange(count)
    # Flags of the lanes that use their matrix once more, and the matrices of all lanes.
    reuse, last_matrix = np.zeros(count, dtype=bool), np.empty((0, 0, count))
    with np.errstate(all="ignore"):
        for _ in range(MOST if recorded else MAX_ITERATIONS):
            at: Any = slice(None) if active.size == count else active
            z, y, lanes = _entries(at, z_all, size_all, numbers)
            F, correction, stays, K, costs, reliable = _corrections(
                equations, z, lanes, differences, reuse, last_matrix
            )
            iterations[at] += 1
            gradients[at] += costs[0]
            structures[at] += costs[1]
            residual[at] = residual_norm = np.abs(F).max(axis=0)
            magnitude, moves = y + np.abs(z), np.abs(correction)
            scale, move = magnitude.max(axis=0), moves.max(axis=0)
            near = move <= STAGNATION * scale
            size = _relative_move(moves, magnitude, move, scale, near if recorded else None)
            outgrown = scale > outgrown_at[at]
            reuse, last_matrix = stop.may_reuse_matrix(size, last_size) & ~(outgrown | recorded), K
            stagnated = near
            if near.any():
                last = stop.is_last(size, last_size, residual_norm, scale)
                stagnated = _unless_hidden(last, moves, magnitude, outgrown) | stop.is_stuck(
                    size, move, scale, last_size, last_move
                )
            if stagnated.any():
                stagnated &= _is_rounding(equations, lanes, residual_norm, z, scale, stagnated & exact)
            goes_on = np.ones(lanes.size, dtype=bool)
            # These comparisons are False for a residual or a correction that is NaN, so that the branch is taken.
            if stagnated.any() or not (
                residual_norm.min(initial=np.inf) > QUANTA and move.max(initial=0) < np.inf
            ):
                outcome = _outcome(residual_norm, move, stagnated, reliable, K, algebra)
                goes_on = outcome < 0
                status[active[~goes_on]] = outcome[~goes_on]
                correction = np.where(goes_on | stagnated & (residual_norm > QUANTA), correction, 0.0)
            z_all[:, at], inside = _moved(equations, recorded, z, correction, lanes, stays)
            status[active[goes_on & ~inside]] = Status.LEFT_DOMAIN
            goes_on &= inside
            if not goes_on.any():
                break
            if not goes_on.all():
                active, size, move, reuse, last_matrix = _entries(
                    np.flatnonzero(goes_on), active, size, move, reuse, last_matrix
                )
            last_size, last_move = size, move
    return Solution(z_all, residual, iterations, gradients, structures, status)


def _corrections(
    equations: Equations, z: Array, lanes: Lanes, differences: bool, reuse: Flags, last_matrix: Any
) -> tuple[Array, Array, Flags, Any, tuple[Any, Any], Flags]:
    """Evaluate F = z − R and Newton's correction for some paths, with the last matrix for paths flagged in `reuse`.

    Returned are F, the correction, flags of paths that surely stay in the domain, the matrix, the evaluations of ∇H
    and of B, and flags of paths with a reliable quadrature.
    """
    recorded, every = None if differences else equations.corrections, np.ones(lanes.size, dtype=bool)
    if recorded is not None:
        return *recorded.of_lanes(z, lanes), last_matrix, recorded.record[1:], every
    R, jacobian = equations.evaluate(z, lanes)
    F, count, K = z - R.value, np.ones(lanes.size, dtype=np.int64), last_matrix
    if not reuse.all():
        K, further = slopes(equations, z, lanes, R.value) if differences else jacobian()
        K, count = np.where(reuse, last_matrix, K) if reuse.any() else K, count + further * ~reuse
    stays = every if equations.inside is None else ~every
    costs = count * R.gradients, count * R.structures
    return F, equations.algebra.correction(K, F), stays, K, costs, R.reliable


def _moved(
    equations: Equations, recorded: bool, z: Array, correction: Array, lanes: Lanes, stays: Flags
) -> tuple[Array, Flags]:
    """Return z minus the correction, and True, for each path that stays in the domain; for others z and False.

    A correction that leaves the domain is shortened first, except if straight-line code made it (`recorded`).
    """
    if stays.all():
        return z - correction, stays
    moved, inside = (z - correction, stays) if recorded else into_domain(equations, z, correction, lanes)
    return np.where(inside, moved, z), inside


def _entries(lanes: Any, *values: Any) -> Any:
    """The entries of each array for the paths `lanes`, as contiguous arrays: v[..., lanes] would not be contiguous."""
    return values if isinstance(lanes, slice) else [v.take(lanes, axis=-1) for v in values]


def _relative_move(moves: Array, magnitude: Array, move: Array, scale: Array, near: Flags | None) -> Array:
    """The largest relative change of a component of the state by Newton's correction, for each of M paths.

    If flags `near` are given, paths without this flag get move/scale instead: this lower bound is enough for them.
    """
    if near is None:
        return np.asarray(stop.relative(moves, magnitude, scale).max(axis=0))
    size = stop.relative(move, scale, scale)
    if near.any():
        np.copyto(size, stop.relative(moves, magnitude, scale).max(axis=0), where=near)
    return np.asarray(size)


def _unless_hidden(last: Flags, moves: Array, magnitude: Array, outgrown: Flags) -> Flags:
    """The flags `last` (the error is only rounding), set to False for `outgrown` paths if a component still moves.

    In an outgrown path |y1| is 2^52 times |y0| or more: an ulp of y1 hides changes of components that stayed small.
    """
    if last.any() and outgrown.any():
        last = last & ~(outgrown & (moves > STAGNATION * magnitude).any(axis=0))
    return last


def _outcome(
    residual_norm: Array, move: Array, stagnated: Flags, reliable: Flags, K: Any, algebra: Algebra
) -> Counts:
    """The status of each lane (path) whose iteration ends, and −1 for a lane that goes on.

    A lane with residual zero is solved even if its Jacobian is singular, as at a rest point.
    """
    solved = residual_norm <= QUANTA
    good = np.where(reliable, int(Status.CONVERGED), int(Status.QUADRATURE))
    outcome: Counts = np.where(stagnated | solved, good, -1)
    singular = ~(solved | np.isfinite(move))
    if singular.any():
        finite = algebra.finite(K)
        outcome[singular & finite] = Status.SINGULAR
        outcome[singular & ~finite | ~np.isfinite(residual_norm)] = Status.OVERFLOW
    return outcome


def _newton_of_one(equations: Equations, start: Array, number: Lanes, *, differences: bool) -> Solution:
    """`newton` for one lane (path): the bits are those of `_newton_of_many`, but comparisons use Python's numbers."""
    exact, recorded = differences or equations.exact, not differences and equations.corrections is not None
    z, y = start.ravel().tolist(), equations.size[:, number].ravel().tolist()
    before = _largest(y)
    residual, iterations, gradients, structures = math.inf, 0, 0, 0
    status, last_size, last_move = Status.NO_CONVERGENCE, math.inf, math.inf
    corrected, K = _corrections_of_one(equations, number, differences), None
    with np.errstate(all="ignore"):
        for _ in range(MOST if recorded else MAX_ITERATIONS):
            F, correction, stays, K, costs, reliable = corrected(z, K)
            iterations, gradients, structures = iterations + 1, gradients + costs[0], structures + costs[1]
            residual_norm = residual = _largest(F)
            if not math.isfinite(residual_norm):
                status = Status.OVERFLOW
                break
            magnitude = [a + abs(b) for a, b in zip(y, z, strict=True)]
            moves = [abs(v) for v in correction]
            scale, move = max(magnitude), _largest(moves)
            solved = residual_norm <= QUANTA
            if not solved and not math.isfinite(move):
                singular = K is None or np.all(equations.algebra.finite(K))
                status = Status.SINGULAR if singular else Status.OVERFLOW
                break
            size, outgrown = stop.relative(move, scale, scale), before > 0 and scale > before / EPS
            if not recorded or move <= STAGNATION * scale:
                size = _largest([stop.relative(a, b, scale) for a, b in zip(moves, magnitude, strict=True)])
            hidden = outgrown and any(a > STAGNATION * b for a, b in zip(moves, magnitude, strict=True))
            last = stop.is_last(size, last_size, residual_norm, scale) and not hidden
            stagnated = last or stop.is_stuck(size, move, scale, last_size, last_move)
            if stagnated and not stop.is_rounding(residual_norm, scale):
                least = np.array([residual_norm]), np.array(z)[:, None], np.array([scale]), np.array([exact])
                stagnated = bool(_is_rounding(equations, number, *least)[0])
            ended = solved or stagnated
            if ended:
                status = Status.CONVERGED if reliable else Status.QUADRATURE
            if solved:
                break
            K = K if stop.may_reuse_matrix(size, last_size) and not outgrown else None
            last_size, last_move = size, move
            if stays:
                z = [a - b for a, b in zip(z, correction, strict=True)]
            elif not recorded:
                arrays = np.array(z)[:, None], np.array(correction)[:, None]
                moved, inside = _moved(equations, False, *arrays, number, np.array([False]))
                z, stays = moved.ravel().tolist(), bool(inside[0])
            if not (stays or ended):
                status = Status.LEFT_DOMAIN
            if ended or not stays:
                break
    counted = np.array([[iterations], [gradients], [structures], [status]], dtype=np.int64)
    return Solution(np.array(z)[:, None], np.array([residual]), *counted)


def _corrections_of_one(
    equations: Equations, number: Lanes, differences: bool
) -> Callable[[list[float], Any], Any]:
    """The function (z, matrix to reuse or None) that returns the results of `_corrections` for one path."""
    recorded, inside = None if differences else equations.corrections, equations.inside is None
    if recorded is not None:
        of_record, costs = recorded.of_one(number), recorded.record[1:]
        return lambda z, _: (*of_record(z), None, costs, True)

    def corrected(values: list[float], K: Any) -> Any:
        z, further = np.array(values)[:, None], 0
        R, jacobian = equations.evaluate(z, number)
        F = z - R.value
        if K is None:
            K, further = slopes(equations, z, number, R.value) if differences else jacobian()
        costs = (1 + further) * int(R.gradients[0]), (1 + further) * int(R.structures[0])
        residual, regular = F.ravel().tolist(), bool(np.isfinite(F).all())
        correction = equations.algebra.correction(K, F).ravel().tolist() if regular else residual
        return residual, correction, inside, K, costs, bool(R.reliable[0])

    return corrected


def _largest(values: list[float]) -> float:
    """The largest absolute value; NaN if there is a NaN, as in NumPy."""
    if math.isnan(sum(values)) and any(map(math.isnan, values)):
        return math.nan
    return max(map(abs, values))


def _is_rounding(
    equations: Equations, numbers: Lanes, residual: Array, z: Array, scale: Array, closely: Flags
) -> Flags:
    """True for paths whose residual is as small as the rounding of y or, for paths flagged in `closely`, of R.

    The rounding of R has two parts: that of its terms, and the effect |K||y0|, K = ∂R/∂y1, of a rounding of y. The
    second part matters for stiff equations, in which terms of R cancel. Both are computed only if the residual exceeds
    the rounding of y. K is taken at y1 = y0, and a factor 16 allows for its change along the step. K at y1 would allow
    any residual next to a singularity of ∇H, although R can no longer be computed there.
    """
    rounding: Flags = stop.is_rounding(residual, scale)
    larger = np.flatnonzero(closely & ~rounding)
    if larger.size:
        K, _ = equations.evaluate(np.zeros_like(z[:, larger]), numbers[larger]).jacobian()
        through = equations.algebra.through(K, equations.size[:, numbers[larger]]).max(axis=0)
        allowed = ROUNDING * (scale[larger] + 16 * through)
        if equations.magnitude is not None:
            allowed = np.fmax(allowed, TERMS * equations.magnitude(z[:, larger], numbers[larger]))
        rounding[larger] = residual[larger] <= allowed
    return rounding


def into_domain(equations: Equations, z: Array, correction: Array, lanes: Lanes) -> tuple[Array, Flags]:
    """z − λ·correction with the largest λ = 2⁻ⁿ for which it lies in the domain, and True for paths with such a λ."""
    moved = z - correction
    inside = np.ones(z.shape[1], dtype=bool)
    if equations.inside is None or not z.shape[1]:
        return moved, inside
    inside = equations.inside(moved, lanes)
    for first in range(1, MAX_HALVINGS + 1, SHARES):
        outside = np.flatnonzero(~inside)
        if not outside.size:
            break
        # Several λ of each lane are tested at once, because a domain takes as long for one state as for a few.
        factors = 0.5 ** np.arange(first, min(first + SHARES, MAX_HALVINGS + 1))
        tried = z[:, outside, None] - factors * correction[:, outside, None]
        fits = equations.inside(tried.reshape(len(z), -1), np.repeat(lanes[outside], factors.size))
        fits = fits.reshape(outside.size, factors.size)
        inside[outside] = fits.any(axis=1)
        largest = np.where(inside[outside], np.argmax(fits, axis=1), -1)
        moved[:, outside] = tried[:, np.arange(outside.size), largest]
    return moved, inside
