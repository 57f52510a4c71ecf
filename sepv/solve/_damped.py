"""Damped Newton steps for z = R(z) from z = 0, for lanes (paths of a batch) whose full steps did not converge."""

from __future__ import annotations

import numpy as np

from sepv.problem import Array, linear_solve
from sepv.solve._differences import slopes
from sepv.solve._solution import Equations, Flags, Lanes, Solution, Status

# The most damped iterations, and the smallest factor λ of a correction.
MAX_DAMPED = 100
SMALLEST_SHARE = 2.0**-20


def approach(equations: Equations, numbers: Lanes) -> Solution:
    """Iterate from z = 0 by damped Newton steps until full steps shrink fast, so that Newton's method can go on.

    The status is then CONVERGED, although z is not yet a solution to rounding. `numbers` are the numbers of the paths
    in `equations`. With small damping factors λ the iteration follows the curve on which all components of F = z − R
    shrink by the same factor. This curve ends at a solution, or at a point where the Jacobian is singular.
    """
    n, count = equations.size.shape[0], numbers.size
    none = np.zeros((4, count), dtype=np.int64)
    state = Solution(np.zeros((n, count)), np.full(count, np.inf), *none)
    state.status[:] = Status.NO_CONVERGENCE
    share, active = np.ones(count), np.arange(count)
    with np.errstate(all="ignore"):
        for _ in range(MAX_DAMPED):
            z = state.value[:, active]
            R, _ = equations.evaluate(z, numbers[active])
            K, further = slopes(equations, z, numbers[active], R.value)
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
    equations: Equations, numbers: Lanes, state: Solution, share: Array, active: Lanes, A: Array, p: Array
) -> Flags:
    """Move the active paths to z − λp, with Newton's correction p = A⁻¹F, and return True for paths that moved.

    A is the derivative of F = z − R(z). The factor λ is halved until z − λp is in the domain, R is finite there, and
    the simplified correction A⁻¹F(z − λp) is at most (1 − λ/4)|p|. A product of F with a matrix does not change this
    test (P. Deuflhard, Newton Methods for Nonlinear Problems, 2004, §3.3).
    """
    z, length = state.value[:, active], np.abs(p).max(axis=0)
    moved = np.zeros(active.size, dtype=bool)
    pending = np.arange(active.size)
    while pending.size:
        where = active[pending]
        trial = z[:, pending] - share[where] * p[:, pending]
        inside = np.ones(pending.size, dtype=bool)
        if equations.inside is not None:
            inside = equations.inside(trial, numbers[where])
        R, _ = equations.evaluate(trial, numbers[where])
        state.gradient_evaluations[where] += R.gradients
        state.structure_evaluations[where] += R.structures
        after = np.abs(linear_solve(A[:, :, pending], trial - R.value)).max(axis=0)
        good = inside & (after <= (1 - share[where] / 4) * length[pending])
        state.value[:, where[good]] = trial[:, good]
        moved[pending[good]] = True
        arrived = good & (share[where] == 1.0) & (after <= 0.25 * length[pending])
        state.status[where[arrived]] = Status.CONVERGED
        obstacle = np.where(np.isfinite(after), Status.NO_CONVERGENCE, Status.OVERFLOW)
        obstacle = np.where(inside, obstacle, Status.LEFT_DOMAIN)
        share[where[~good]] *= 0.5
        blocked = ~good & (share[where] < SMALLEST_SHARE)
        state.status[where[blocked]] = obstacle[blocked]
        pending = pending[~good & ~blocked]
    return moved
