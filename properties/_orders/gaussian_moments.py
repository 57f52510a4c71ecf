"""E[y_i] and E[y_i y_j] after N affine steps, against the exact Gaussian solution: no paths are
sampled.

A step y1 = b + Φy + Nξ, where ξ has mean 0 and covariance v times the unit matrix, changes the mean
m and the covariance S of y to

    b + Φm,    ΦSΦᵀ + vNNᵀ.                                                                      (M)

From m = y0 and S = 0 this gives the mean and covariance of y_N. Those of y(T) are known, as the
exact step is Gaussian (`gaussian_step`). They are compared in standard deviations of y(T). Since
E[y_i y_j] = S_ij + m_i m_j, the errors of m and S are O(h^q) if and only if those of E[y_i] and
E[y_i y_j] are. If increments are truncated as in Remark 2.1, v is the variance of clip(ξ, ±A_h),
else 1.

**Roundings.** Let e bound the error of a computed step (`sepv.properties._stationary`). Then b errs
by e, and Φ and N, differences of steps, by 2e. With |m| and |S| the sums of absolute values, (M)
errs by e(1 + 2|m|) in m, and by 4e(‖Φ‖|S| + ‖N‖) in S, in the norm of row sums. Later steps
multiply these errors by ‖Φⁿ‖ and ‖Φⁿ‖². With P the largest of 1 and ‖Φⁿ‖, N steps err by at most

    N P² e max(1 + 2|m|, 4(‖Φ‖|S| + ‖N‖)).

The exact step over T has fewer roundings than N steps of a scheme, so this is doubled.
"""

from __future__ import annotations

import numpy as np
from sepv.properties._orders.gaussian import rule
from sepv.properties._orders.gaussian_step import affine_slope, gaussian_step, is_gaussian
from sepv.properties._orders.local_errors import LocalErrors
from sepv.properties._setups import Setup
from sepv.properties._stationary import AffineStep, affine

from sepv.errors import Unasked
from sepv.problem import Array, drift
from sepv.record import EPS
from sepv.schemes import Scheme, has_memory, point_law

# T is 1/|λ| for the fastest eigenvalue λ of the drift's slope, and at most AFFINE_T_FACTOR times
# the T of sampled paths. The A_h of truncated increments needs shorter steps: then T is that of
# these paths.
AFFINE_T_FACTOR = 64
# The numbers N of steps, and the least number of them at which a step is affine.
AFFINE_STEPS = (4, 8, 16, 32, 64, 128, 256)
LEAST_SIZES = 4


def moment_errors_at(scheme: Scheme, setup: Setup) -> LocalErrors | None:
    """The errors of mean and covariance at T; None if y(T) is not Gaussian,
    or a step not affine in y and normal numbers.
    """
    problem, clipped = setup.build(), scheme.truncation is not None
    other = point_law(scheme.increments) or scheme.eps > EPS or (clipped and scheme.asks)
    if other or has_memory(scheme) or not is_gaussian(problem):
        return None
    A = affine_slope(problem)
    assert A is not None
    longest = setup.T if clipped else AFFINE_T_FACTOR * setup.T
    T = float(1 / max(np.max(np.abs(np.linalg.eigvals(A))), 1 / longest))
    y0, exact = np.array(problem.initial), gaussian_step(problem, T, "")
    noise = np.concatenate([np.sqrt(T) * exact.gain, exact.rest], axis=1)
    sizes = np.sqrt(np.sum(noise**2, axis=1))
    if not np.all(sizes > 0):
        return None
    noise, mean = noise / sizes[:, None], exact.E @ drift(problem, y0) / sizes
    rows, steps = list[tuple[float, ...]](), 0
    for count in AFFINE_STEPS:
        h = T / count
        try:
            step = affine(scheme, problem, h, y0, sizes, A)
        except Unasked:
            return None
        if isinstance(step, str):
            continue
        v = 1.0
        if clipped:
            nodes = rule(1, h / setup.unit, scheme.truncation, 4)
            v = float(nodes.weights @ nodes.zeta[0, nodes.index] ** 2)
        m, S, rounding = moments_of_steps(step, count, v)
        off = np.max(np.abs(m - mean)), np.max(np.abs(S - noise @ noise.T))
        rows.append((count, h, *map(float, off), rounding))
        steps += 4 + sum(step.N.shape)
    if len(rows) < LEAST_SIZES:
        return None
    counts, h, means, covariances, roundings = np.array(rows).T
    scale, unknown = counts * np.max(np.abs(y0 / sizes), initial=1.0), np.full_like(h, np.nan)
    return LocalErrors(
        problem.name, h, means, unknown, np.maximum(means, covariances), 0, scale, 0.0, steps, (), "additive",
        2 * roundings,
    )  # fmt: skip


def moments_of_steps(step: AffineStep, count: int, v: float) -> tuple[Array, Array, float]:
    """The mean and covariance of y_N by (M), and the bound of their roundings."""
    d = len(step.rest)
    m, S, power, growth, largest = np.zeros(d), np.zeros((d, d)), np.eye(d), 1.0, 1.0
    of_Phi, of_N = (float(np.linalg.norm(part, np.inf)) for part in (step.Phi, step.N))
    for _ in range(count):
        m, S, power = (
            step.rest + step.Phi @ m,
            step.Phi @ S @ step.Phi.T + v * step.N @ step.N.T,
            step.Phi @ power,
        )
        growth = max(growth, float(np.linalg.norm(power, np.inf)))
        spread = 4 * (of_Phi * float(np.sum(np.abs(S))) + of_N)
        largest = max(largest, 1 + 2 * float(np.sum(np.abs(m))), spread)
    return m, S, count * growth**2 * step.error * largest
