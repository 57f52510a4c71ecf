"""Damped Newton steps from z = 0, for a lane whose full steps lead nowhere."""

from __future__ import annotations

import numpy as np

from sepv.problem import Array, linear_solve
from sepv.solve._differences import slopes
from sepv.solve._solution import Equations, Flags, Lanes, Solution, Status

# The most damped iterations, for a solve that failed undamped, and the smallest share of a correction that they take.
MAX_DAMPED = 100
SMALLEST_SHARE = 2.0**-20


def approach(equations: Equations, numbers: Lanes) -> Solution:
    """Damped Newton from z = 0 until full steps contract; then the status is CONVERGED.

    In the limit of small shares it follows the path on which all of F shrinks alike, which ends in a solution or
    where the Jacobian is singular.
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
    """Move the active lanes by a share λ of the correction p = A⁻¹F, halved until it passes; True where one passed.

    A share passes if z − λp is in the domain, R is finite there, and the simplified correction A⁻¹F(z − λp) is at most
    (1 − λ/4)|p|. Linear changes of the equations do not change this test (P. Deuflhard, Newton Methods for Nonlinear
    Problems, 2004, §3.3).
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
