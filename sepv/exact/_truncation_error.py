"""The rms error from clipping the normal increments at √h A_h (Remark 2.1),
which ordinary samples do not show.

A step with ζ = clip(ξ, ±A_h) in place of a normal ξ ends on the exact flow at the time
θ + c√h(ζ − ξ). Over a path these shifts have mean 0 and variance T|c|²E(ξ − ζ)². With
A = A_h, Q(A) = P(ξ > A) and the normal density φ,

    E(ξ − ζ)² = 2∫_A^∞ (x − A)² φ(x) dx = 2((1 + A²)Q(A) − Aφ(A)) ≈ 4φ(A)/A³ = O(h^k |ln h|^(−3/2)).

So the rms error of clipping, for the field f, is |f| |c| √(T E(ξ − ζ)²) = O(h^{k/2}|ln
h|^(−3/4)). If a scheme has the order p and k = 2p, its own error and the error of clipping both
have the order p. For collocation with three or more stages the error of clipping is larger. If
k = 4p, it is O(h^{2p}), at most a few per cent of the scheme's error for h ≤ ¼
(`sepv.schemes._scheme.truncation_for`).

A path of N steps has a clipped increment with probability 2NQ(A_h), below 10⁻⁶ for k ≥ 4 and
N = 64. A sample therefore shows the error of unclipped paths. The square of the error of
clipping must be added to the square of this error.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from sepv.exact._flow import exact_flow
from sepv.problem import Problem, vector_field
from sepv.simulate import truncation_bound

# The number of trapezoidal nodes for E|f|², and their range in standard deviations of θ(T): exact
# to 1e-8 for smooth f.
THETA_NODES, THETA_REACH = 49, 6.0


def lost_mean_square(A: float) -> float:
    """The mean square E(ξ − clip(ξ, ±A))² that clipping cuts off, for ξ ~ N(0, 1) and A ≥ 0.

    The terms of the formula cancel, so that the relative error is about A⁴ eps.
    """
    from scipy.special import erfcx

    density = math.exp(-0.5 * A * A)
    # The tail probability is Q(A) = ½ e^{−A²/2} erfcx(A/√2).
    return density * ((1 + A * A) * float(erfcx(A / math.sqrt(2))) - A * math.sqrt(2 / math.pi))


def clipping_error(
    problem: Problem, *, T: float, steps: int, k: int | None, y0: ArrayLike | None = None
) -> float:
    """The rms error √E|y(θ̂) − y(θ)|² at T, if θ̂ has clipped increments and θ normal ones,
    to first order in θ̂ − θ.

    The factor E|f(y(T))|² of the result is a mean over paths with one increment at ±√h A_h, and the
    others normal.

    Parameters
    ----------
    problem : a system (1.1)
    steps : int
        The number N = T/h of steps.
    k : int or None
        The k of Remark 2.1; None for untruncated increments, for which the result is zero.
    y0 : (d,), optional
        The initial state, by default the problem's.

    Raises
    ------
    UsageError
        For h ≥ 1 (see `sepv.simulate.truncation_bound`), and for several structures.
    """
    if k is None or not problem.noises:
        return 0.0
    h, c = T / steps, problem.c
    A = truncation_bound(h, k)
    variance = 0.0
    for cj in c[c > 0]:
        rest = math.sqrt(max(T * float(c @ c) - cj * cj * h, 0.0))
        middle = [T - cj * math.sqrt(h) * A, T + cj * math.sqrt(h) * A]
        variance += (
            cj * cj * T * lost_mean_square(A) * float(np.mean([_speed(problem, m, rest, y0) for m in middle]))
        )
    return math.sqrt(variance)


def _speed(problem: Problem, mean: float, deviation: float, y0: ArrayLike | None) -> float:
    """The mean E|f(y)|², where y is the exact flow at a random time ~ N(`mean`, `deviation`²)."""
    x = np.linspace(-THETA_REACH, THETA_REACH, THETA_NODES)
    weights = np.exp(-0.5 * x * x)
    y = exact_flow(problem, mean + deviation * x, y0).y
    f = vector_field(problem, y)
    return float(weights @ np.sum(f * f, axis=0) / weights.sum())
