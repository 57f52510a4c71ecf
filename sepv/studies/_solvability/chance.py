"""The probability that Δ = h + Σ_j c_j ΔŴ_j of one step falls outside an interval."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sepv.problem import Array
from sepv.record import gauss_legendre
from sepv.simulate import truncation_bound

# Gauss nodes for each noise beyond the first: the integrand is smooth but for two jumps of size P(|ξ| > A_h).
NODES = 128


def chance_outside(h: float, noise: ArrayLike, low: ArrayLike, high: ArrayLike, k: int | None = 2) -> Array:
    """P(Δ ≤ low or Δ ≥ high) for increments truncated with k (Remark 2.1), untruncated for k = None.

    Parameters
    ----------
    h : float > 0, below 1 where k is given
    noise : (m,)
        The c_j.
    low, high : (M,), low < 0 < high.

    Notes
    -----
    One noise: the tails of a normal law, and nothing beyond √h A_h. Several truncated ones: the law of each but the
    first is integrated by Gauss nodes on (−A_h, A_h) and two atoms.
    """
    c = np.asarray(noise, dtype=np.float64).reshape(-1)
    c = c[c > 0] * np.sqrt(h)
    below, above = np.asarray(low) - h, np.asarray(high) - h
    if not c.size:
        return ((below >= 0) | (above <= 0)).astype(np.float64)
    if k is None:
        spread = float(np.sqrt(np.sum(c * c)))
        return _tail(above / spread) + _tail(-below / spread)
    return _truncated(c, below, above, truncation_bound(h, k))


def _truncated(c: Array, below: Array, above: Array, bound: float) -> Array:
    """The same for Σ c_j ζ_j."""
    if c.size == 1:
        up, down = above / c[0], -below / c[0]
        return np.where(up <= bound, _tail(up), 0.0) + np.where(down <= bound, _tail(down), 0.0)
    atom = float(_tail(np.array(bound)))
    points, weights = gauss_legendre(NODES)
    x = bound * (2 * points - 1)
    weights = 2 * bound * weights * np.exp(-0.5 * x * x) / np.sqrt(2 * np.pi)
    total = np.zeros(np.broadcast(below, above).shape)
    for value, weight in [(-bound, atom), *zip(x, weights, strict=True), (bound, atom)]:
        total = total + weight * _truncated(c[1:], below - c[0] * value, above - c[0] * value, bound)
    return total


def _tail(x: Array) -> Array:
    """P(ξ ≥ x) for ξ ~ N(0, 1)."""
    from scipy.special import ndtr

    tail: Array = ndtr(-np.asarray(x, dtype=np.float64))
    return tail
