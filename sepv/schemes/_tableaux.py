"""Gauss collocation with s nodes: coefficients, Lagrange polynomials and their integrals.

All are computed from shifted Legendre polynomials, because s Gauss nodes integrate and interpolate
these polynomials without cancellation: ℓ_i(τ) = b_i Σ_{k<s} (2k + 1) P_k(2c_i − 1) P_k(2τ − 1).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from sepv.problem import Array
from sepv.record import gauss_legendre, legendre_values

MAX_STAGES = 6


@dataclass(frozen=True)
class GaussTableau:
    """The Gauss method with s stages: nodes c (s,), weights b (s,), and A (s, s)
    with a_ij = ∫₀^{c_i} ℓ_j.
    """

    c: Array
    b: Array
    A: Array


@lru_cache(maxsize=8)
def gauss_tableau(stages: int) -> GaussTableau:
    """The tableau of the Gauss method with s stages, of order 2s.

    Quadratic invariants are kept because b_i a_ij + b_j a_ji = b_i b_j. If b_i = b_j, the rounded
    coefficients satisfy this too: otherwise their roundings would move a quadratic H in the same
    direction in every step.
    """
    c, b = gauss_legendre(stages)
    A = np.tril(lagrange_integrals(stages, c), -1)
    return GaussTableau(c, b, A + np.triu(b - b / b[:, None] * A.T, 1) + np.diag(b / 2))


def lagrange(stages: int, tau: Array) -> Array:
    """The Lagrange polynomials of the s Gauss nodes at the points τ_n: ℓ_i(τ_n), of shape
    (s, N).
    """
    c, b = gauss_legendre(stages)
    return np.asarray(_series(stages, c, b) @ np.stack(legendre_values(2 * tau - 1, stages - 1)))


def lagrange_integrals(stages: int, tau: Array) -> Array:
    """The integrals ∫₀^{τ_n} ℓ_j of the Lagrange polynomials of the s Gauss nodes, of shape
    (N, s).
    """
    c, b = gauss_legendre(stages)
    P = legendre_values(2 * tau - 1, stages)
    # For k > 0, ∫₀^τ P_k(2t − 1) dt = (P_{k+1} − P_{k−1})(2τ − 1)/(2(2k + 1)), and for k = 0 it is
    # τ.
    parts = [tau] + [(P[k + 1] - P[k - 1]) / (2 * (2 * k + 1)) for k in range(1, stages)]
    return np.asarray((_series(stages, c, b) @ np.stack(parts)).T)


@lru_cache(maxsize=256)
def moments(stages: int, nodes: int) -> tuple[Array, Array]:
    """Two matrices W and P, for the averages of the s-stage method by a quadrature with N Gauss
    nodes τ_n, weights w_n.

    W (s, N) has the entries w_n ℓ_i(τ_n)/b_i, so that b_i⁻¹ ∫ ℓ_i g = Σ_n W_in g(τ_n), exact for g
    of degree ≤ 2N − s. P (N, s) has the entries ∫₀^{τ_n} ℓ_j, so that the collocation polynomial is
    y0 + Σ_j P_nj z_j at τ_n.
    """
    if nodes == stages:  # the nodes τ_n are those of the method
        return np.eye(stages), gauss_tableau(stages).A
    tau, w = gauss_legendre(nodes)
    return lagrange(stages, tau) * w / gauss_legendre(stages)[1][:, None], lagrange_integrals(stages, tau)


def exact_nodes(stages: int, degree: int) -> int:
    """The number of Gauss nodes that make the averages b_i⁻¹∫ℓ_i∇H(u) exact for H of this degree.

    For H of degree ν and u of degree s, ℓ_i∇H(u) has degree s − 1 + s(ν − 1) = sν − 1, which needs
    ⌈sν/2⌉ nodes.
    """
    return max(1, -(-stages * max(degree, 1) // 2))


@lru_cache(maxsize=8)
def amplification(stages: int) -> float:
    """The largest factor by which the averages b_i⁻¹∫ℓ_i∇H(u) multiply errors of ∇H:
    max_i b_i⁻¹∫|ℓ_i|.
    """
    W, _ = moments(stages, 64)
    return float(np.max(np.sum(np.abs(W), axis=1)))


def _series(stages: int, c: Array, b: Array) -> Array:
    """The coefficients (s, s) of the Gauss nodes' Lagrange polynomials ℓ_i in shifted Legendre
    polynomials.
    """
    return np.asarray(
        b[:, None] * (2 * np.arange(stages) + 1) * np.stack(legendre_values(2 * c - 1, stages - 1)).T
    )
