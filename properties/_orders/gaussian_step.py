"""The exact step of dy = f(y) dt + G dW with an affine drift, f′ = −A: Gaussian,
given the increments that a scheme gets.

The exact solution after a step is (C. W. Gardiner, Handbook of Stochastic Methods, 2004, §4.5.4)

    y(h) = y0 + E f(y0) + ζ,    E = ∫₀ʰ e^{−As}ds,    ζ = ∫₀ʰ e^{−A(h−s)}G dW(s).

ζ and ΔW are jointly Gaussian, but ΔW does not determine ζ. Let P_k be the Legendre polynomials.
The vectors ξ_k = √((2k+1)/h) ∫₀ʰ P_k(2s/h − 1) dW(s) are independent and standard normal, because
the P_k are orthogonal, and they are a basis. With ∫₀¹ uⁿP_k(1 − 2u)du = (−1)^k n!²/((n−k)!
(n+k+1)!) for n ≥ k, else 0, the series of e^{−A(h−s)} in h − s = hu gives

    ζ = Σ_k a_k ξ_k,    a_k = (−1)^k √((2k+1)h) Σ_{n≥k} n!/((n−k)!(n+k+1)!) (−Ah)ⁿG.            (Z)

ΔW = √h ξ_0, and the space-time area is H = −√(h/12) ξ_1. So a scheme that gets ΔW knows the first
term of ζ, one that gets H knows two, and the other terms are independent of what it gets. Their
covariance Σ a_k a_kᵀ is that of ζ given ΔW, without the cancellation in Var ζ − K Var(ΔW) Kᵀ,
which at small h has lost all digits of the blocks of C. Van Loan's exponential
(IEEE Trans. Automat. Control 23, 1978). Two half steps give ζ for a scheme that gets the
increments of the halves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import factorial

import numpy as np

from sepv.errors import Skipped
from sepv.problem import Array, Problem, channel_slope, drift, noise_vectors, sample_states
from sepv.record import EPS
from sepv.simulate import RoughPath, wiener

# A drift is affine if its slope changes by at most this share between states, and a step if its
# value differs by at most this share from the affine map (`_stationary`). Both are far above
# rounding, and far below the curvature of a potential.
AFFINE_TOLERANCE = 2.0**-30
# The number of terms of (Z), and the largest number of powers of Ah. With |Ah| ≤ 2 the first term
# that is left out is below 1e-17 |G|√h, and 25 powers reach rounding.
SERIES_TERMS, SERIES_MAX_POWERS = 14, 100
# The seed of what increments do not determine is that of the increments plus this number.
_STREAM = 2**41


def is_gaussian(problem: Problem) -> bool:
    """True for constant noise vectors and an affine drift."""
    return len(noise_vectors(problem)) == problem.noises > 0 and affine_slope(problem) is not None


def affine_slope(problem: Problem) -> Array | None:
    """The matrix A (d, d) of an affine drift, f′ = −A, or None if the drift is not affine."""
    slopes = [-channel_slope(problem, 0, y[:, None])[..., 0] for y in sample_states(problem)]
    largest = AFFINE_TOLERANCE * np.max(np.abs(slopes[0]))
    return slopes[0] if all(np.max(np.abs(other - slopes[0])) <= largest for other in slopes) else None


@dataclass(frozen=True, eq=False)
class GaussianStep:
    """y(h) = y0 + E f(y0) + gain · rows + rest · ξ, for the rows (m + k, n) of increments that a
    scheme gets, and standard normal numbers ξ independent of them.
    """

    problem: Problem
    E: Array
    gain: Array
    rest: Array

    def mean(self, y: Array, rows: Array) -> Array:
        """E[y(h) | rows], (d, S, n), from the states y (d, S)."""
        start = y + self.E @ drift(self.problem, y)
        return np.asarray(start[..., None] + (self.gain @ rows[: self.gain.shape[1]])[:, None])

    def variance(self) -> float:
        """E|y(h) − E[y(h) | rows]|²."""
        return float(np.sum(self.rest**2))


@lru_cache(maxsize=256)
def gaussian_step(problem: Problem, h: float, asks: str) -> GaussianStep:
    """The exact step of a problem that `is_gaussian`.

    `asks` is that of the scheme that gets the rows (`Scheme`); Lévy areas are not used.
    """
    A = affine_slope(problem)
    assert A is not None, f"the drift of {problem.name} is not affine"
    if asks == "halves":
        half = gaussian_step(problem, h / 2, "")
        flow = np.eye(problem.dimension) - A @ half.E
        gain = np.concatenate([half.gain, flow @ half.gain - half.gain], axis=1)
        return GaussianStep(
            problem, half.E + flow @ half.E, gain, np.concatenate([flow @ half.rest, half.rest], axis=1)
        )
    E, a = _series(-h * A, noise_vectors(problem).T * problem.c)
    known = 2 if asks == "space-time" else 1
    gain = np.concatenate([a[0], -np.sqrt(12.0) * a[1]][:known], axis=1)
    return GaussianStep(problem, h * E, gain, np.sqrt(h) * np.concatenate(a[known:], axis=1))


def _series(x: Array, G: Array) -> tuple[Array, list[Array]]:
    """E/h and the a_k/√h of (Z) for x = −Ah, by powers of x until they are rounding."""
    E, a = np.zeros_like(x), [np.zeros_like(G) for _ in range(SERIES_TERMS)]
    power, n = np.eye(len(x)), 0
    while n < SERIES_TERMS or np.max(np.abs(power)) > EPS * factorial(n):
        if n == SERIES_MAX_POWERS:
            raise Skipped("the step is too long for the exact solution's series")
        E = E + power / factorial(n + 1)
        for k in range(min(n + 1, SERIES_TERMS)):
            share = (-1) ** k * (2 * k + 1) ** 0.5 * factorial(n) / (factorial(n - k) * factorial(n + k + 1))
            a[k] = a[k] + share * (power @ G)
        power, n = power @ x, n + 1
    return E, a


def gaussian_path(problem: Problem, y0: Array, rough: RoughPath, seed: int, paths: range) -> Array:
    """The exact y(T) (d, M) along a rough path with these increments and space-time areas.

    What they do not determine is drawn.
    """
    step = gaussian_step(problem, rough.h, "space-time")
    N, d = len(rough.dW), problem.dimension
    _, R = np.linalg.qr(step.rest.T)  # rest · ξ has the distribution of Rᵀξ
    normals = wiener.increments(seed + _STREAM, T=float(N), steps=N, noises=d, paths=paths)
    y = np.repeat(y0[:, None], rough.dW.shape[2], axis=1)
    for increment, bridge, normal in zip(rough.dW, rough.bridges, normals, strict=True):
        moved = step.gain @ np.concatenate([increment, bridge]) + R.T @ normal[: len(R)]
        y = y + step.E @ drift(problem, y) + moved
    return y
