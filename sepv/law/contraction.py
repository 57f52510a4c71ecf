"""The contraction radius of a problem: a bound of |h| + Σ|c_jΔW_j| under which implicit steps are
contractions.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sepv._kept import kept, key_of
from sepv.law.cases.case import Case
from sepv.law.tolerance import CONTRACTION, majorants, pushes
from sepv.problem import Array, PolynomialSystem, Problem, matmul, matvec, one_hamiltonian
from sepv.problems import build
from sepv.record import PolynomialMap

# The number of powers of AᵀA that make x near to the largest eigenvector, in `_spectral_norm`.
NORM_POWERS = 8


def has_majorants(case: Case) -> bool:
    """True if a case's radius is derived: for polynomial data,
    unless every noise has an H_j that commutes with H_0.
    """
    data = case.problem
    if not isinstance(data, PolynomialSystem):
        return False
    return not data.noise_hamiltonians or not one_hamiltonian(build(data))


def shortened(case: Case) -> Case:
    """Shorten a step by a power of two to at most half its contraction radius;
    without polynomial data, do nothing.

    The law poisson-map needs this, because its Cauchy estimate takes the step from all states in a
    ball around y.
    """
    problem, y, h, dW = case.build()
    if not isinstance(problem.gradient, PolynomialMap):
        return case
    length, most = abs(h) + float(np.sum(np.abs(problem.c * dW))), contraction_radius(problem, y) / 2
    if length <= most:
        return case
    share = 2.0 ** np.floor(np.log2(most / length))
    return replace(case, h=float(share * h), dW=tuple(float(share * w) for w in dW))


def contraction_radius(problem: Problem, y: Array) -> float:
    """A radius for |h| + Σ|c_jΔW_j| inside which the steps of the schemes named below are
    contractions from y.

    Let y1 = y0 + R(z) be the step's equation, z = y1 − y0, |Δ| = |h| + Σ|c_jΔW_j| and κ =
    CONTRACTION. M_B ≥ |B|, M_g ≥ |∇H|, |B′| and D ≥ |H″| are bounds on the ball |z|_∞ ≤ r, and G =
    |M_B M_g|_∞. If |Δ| ≤ radius, y0 + R maps this ball into itself and contracts, so that it has
    one solution there:

    - by κ in |·|_∞, for schemes that evaluate B and ∇H between y0 and y1 or at coordinate
      increments: then |R| ≤ |Δ|G, and R has the Lipschitz constant |Δ|L, L = |(|B′|M_g + M_B D)|_∞.
      (2.1) needs half of L.
    - by κ times the Lebesgue constant max_j b_j⁻¹∫|ℓ_j| ≤ 1.57, for s ≤ 6 stages of Gauss
      collocation: their stages are y0 + Σ_j (∫₀^τ ℓ_j) z_j, where the sums Σ_j |∫₀^τ ℓ_j| are at
      most 1.
    - by κ in |·|_2, for the midpoint discrete gradient of Gonzalez, (I − P)m + Pa with m = ∇H(ȳ), a
      = ∇̄H, P = eeᵀ and e = z/|z|_2. Its derivative along w is ½(I − P)H″w + P∫τH″w + (w⊥eᵀ + e
      w⊥ᵀ)(a − m)/|z|_2, w⊥ = (I − P)w. With |a − m|_2 ≤ ¼|D|_2|z|_2 the norm is at most (√½ +
      ¼)|D|_2, so |Δ|(½|N|_2 + |M_B|_2|D|_2) bounds the Lipschitz constant, N = |B′|(M_g + ¼|D|_2
      r). Also |P(a − m)|_i = |e_i||eᵀ(a − m)| ≤ ¼|D|_2|z_i|, so |R|_∞ ≤ |Δ|(G + ¼|M_B|_∞|D|_2 r).

    For these |Δ| ≤ min(r/(G + ¼|M_B|_∞|D|_2 r), κ/max(L, ½|N|_2 + |M_B|_2|D|_2)) is enough.
    `problem` must be polynomial data.
    """
    return contraction_ball(problem, y)[0]


def contraction_ball(problem: Problem, y: Array) -> tuple[float, float]:
    """A pair (radius, r): for |Δ| ≤ radius, Δ real or complex, the solution stays within r of y.

    Each r > 0 gives a radius, and the largest radius is returned. The values tried for r are |y|,
    the scale of the system near y, and for states at or near the origin 1 + |y|, each multiplied by
    powers of two.
    """
    return kept("balls").get(key_of(problem.data, y), lambda: _ball(problem, y))


def _ball(problem: Problem, y: Array) -> tuple[float, float]:
    largest = float(np.max(np.abs(y)))
    sizes = [(1 + largest) * 2.0**-k for k in range(6)] + [largest * 2.0**-k for k in range(-1, 6) if largest]
    balls = np.array(sizes)
    reach = np.abs(y)[:, None] + balls
    with np.errstate(all="ignore"):
        B, g, dB, H = majorants(problem, reach)
        curved = _spectral_norm(H)
        tilt = 0.25 * curved * balls
        field = np.max(np.maximum(matvec(B, g), pushes(problem)[:, None]), axis=0)
        field = field + np.max(np.sum(B, axis=1), axis=0) * tilt
        turns = matvec(dB, g)
        slope = np.max(np.sum(turns + matmul(B, H), axis=1), axis=0)
        euclidean = 0.5 * _spectral_norm(turns + np.sum(dB, axis=1) * tilt) + _spectral_norm(B) * curved
        slope = np.maximum(slope, euclidean)
        # If the fields vanish, every step is short enough. If majorants overflow, no step is.
        radii = np.minimum(
            np.where(field > 0, balls / field, np.inf), np.where(slope > 0, CONTRACTION / slope, np.inf)
        )
    best = int(np.argmax(np.nan_to_num(radii, nan=0.0, posinf=np.inf)))
    return float(radii[best]), float(balls[best])


def _spectral_norm(A: Array) -> Array:
    """An upper bound (K,) of |A|_2 of K matrices (d, d, K) without negative entries.

    |A|_2² is the spectral radius of AᵀA, and at most max_i (AᵀAx)_i/x_i for each x > 0 (L. Collatz,
    Math. Z. 48, 1942).
    """
    size = A.max(axis=(0, 1))
    unit = A / np.where(size > 0, size, 1.0)
    x = np.ones(A.shape[1:])
    for _ in range(NORM_POWERS):
        x = matvec(unit.swapaxes(0, 1), matvec(unit, x))
        x = x / np.where(size > 0, x.max(axis=0), 1.0)
    ratio = matvec(unit.swapaxes(0, 1), matvec(unit, x)) / np.where(x > 0, x, np.inf)
    return np.asarray(size * np.sqrt(ratio.max(axis=0)))
