"""Damped Newton steps for F(z) = 0 from z = 0, for lanes whose full steps did not converge."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sepv.core.arrays import Array, Flags, Lanes, linear_solve
from sepv.core.newton import Inside, Root, Status

# The most damped iterations, and the smallest factor λ of a correction.
MAX_DAMPED = 100
DAMPING_MIN_SHARE = 2.0**-20

# The functions F(z, lanes), (n, M), and ∂F/∂z at z, (n, n, M), where F has the given value.
Residual = Callable[[Array, Lanes], Array]
Derivative = Callable[[Array, Lanes, Array], Array]


def approach(F: Residual, derivative: Derivative, inside: Inside | None, n: int, numbers: Lanes) -> Root:
    """Iterate from z = 0 by damped Newton steps until Newton's method can go on with full ones.

    The status is then CONVERGED, although z is not yet a solution to rounding. `numbers` are the
    numbers of the paths. With small damping factors λ the iteration follows the curve on which all
    components of F shrink by the same factor. This curve ends at a solution or a singular Jacobian.
    """
    count = numbers.size
    none = np.zeros(count, dtype=np.int64)
    root = Root(np.zeros((n, count)), np.full(count, np.inf), none, none + Status.NO_CONVERGENCE)
    share, active = np.ones(count), np.arange(count)
    with np.errstate(all="ignore"):
        for _ in range(MAX_DAMPED):
            z = root.value[:, active]
            residual = F(z, numbers[active])
            A = derivative(z, numbers[active], residual)
            root.residual[active] = np.abs(residual).max(axis=0)
            root.iterations[active] += 1
            correction = linear_solve(A, residual)
            regular = np.isfinite(correction).all(axis=0)
            finite = np.isfinite(root.residual[active]) & np.isfinite(A).all(axis=(0, 1))
            failed = np.where(finite, Status.SINGULAR, Status.OVERFLOW)
            root.status[active[~regular]] = failed[~regular]
            active, A, correction = active[regular], A[:, :, regular], correction[:, regular]
            share[active] = np.minimum(1.0, 4 * share[active])
            moved = take_share(F, inside, numbers, root, share, active, A, correction)
            active = active[moved & (root.status[active] != Status.CONVERGED)]
            if not active.size:
                break
    return root


def take_share(
    F: Residual, inside: Inside | None, numbers: Lanes, root: Root, share: Array, active: Lanes, A: Array, p: Array
) -> Flags:  # fmt: skip
    """Move active paths to z − λp, where p = A⁻¹F is Newton's correction; True where moved.

    A is the derivative of F. The factor λ is halved until z − λp is in the domain, F is finite
    there, and the simplified correction A⁻¹F(z − λp) is at most (1 − λ/4)|p|. A matrix times F
    passes the same test (P. Deuflhard, Newton Methods for Nonlinear Problems, 2004, §3.3).
    """
    z, length = root.value[:, active], np.abs(p).max(axis=0)
    moved = np.zeros(active.size, dtype=bool)
    pending = np.arange(active.size)
    while pending.size:
        where = active[pending]
        trial = z[:, pending] - share[where] * p[:, pending]
        stays = np.ones(pending.size, dtype=bool) if inside is None else inside(trial, numbers[where])
        after = np.abs(linear_solve(A[:, :, pending], F(trial, numbers[where]))).max(axis=0)
        good = stays & (after <= (1 - share[where] / 4) * length[pending])
        root.value[:, where[good]] = trial[:, good]
        moved[pending[good]] = True
        arrived = good & (share[where] == 1.0) & (after <= 0.25 * length[pending])
        root.status[where[arrived]] = Status.CONVERGED
        obstacle = np.where(np.isfinite(after), Status.NO_CONVERGENCE, Status.OVERFLOW)
        obstacle = np.where(stays, obstacle, Status.LEFT_DOMAIN)
        share[where[~good]] *= 0.5
        blocked = ~good & (share[where] < DAMPING_MIN_SHARE)
        root.status[where[blocked]] = obstacle[blocked]
        pending = pending[~good & ~blocked]
    return moved
