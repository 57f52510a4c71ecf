"""The open Toda chain, H = ½Σp_i² + Σ exp(q_i − q_{i+1}), with B = J⁻¹ as in (1.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sepv.errors import ProblemError
from sepv.fields import dot
from sepv.problem import Array, NamedProblem, Problem
from sepv.problems._canonical import canonical, canonical_derivative


def toda(particles: float = 3, noise: ArrayLike = 1.0) -> Problem:
    """y = (p_1 … p_n, q_1 … q_n), from p = 0 and q = 0.

    The averaged gradient has ∫₀¹ exp(x + τδ)dτ = exp(x + δ/2) sinh(δ/2)/(δ/2) in closed form.
    """
    n = int(particles)
    if n != particles or n < 2:
        raise ProblemError(
            expected="an integer number of particles ≥ 2", received=repr(particles), remedy="give particles=3"
        )
    c = np.atleast_1d(np.asarray(noise, dtype=np.float64))

    def forces(links: Array) -> Array:
        """∂H/∂q from the exponentials of the links, (n − 1, ...)."""
        edge = np.zeros_like(links[:1])
        return np.concatenate([links, edge]) - np.concatenate([edge, links])

    def links(y: Array) -> Array:
        return y[n:-1] - y[n + 1 :]

    def hessian(y: Array) -> Array:
        H, e = np.zeros((2 * n, 2 * n, *y.shape[1:]), dtype=y.dtype), np.exp(links(y))
        for i in range(n):
            H[i, i] = 1.0
        for i in range(n - 1):
            for a, b, sign in ((i, i, 1), (i + 1, i + 1, 1), (i, i + 1, -1), (i + 1, i, -1)):
                H[n + a, n + b] = H[n + a, n + b] + sign * e[i]
        return H

    def mean_gradient(y0: Array, y1: Array) -> Array:
        x0, half = links(y0), 0.5 * (links(y1) - links(y0))
        moves = half != 0
        ratio = np.where(moves, np.sinh(half) / np.where(moves, half, 1.0), 1.0)
        return np.concatenate([y0[:n] + 0.5 * (y1[:n] - y0[:n]), forces(np.exp(x0 + half) * ratio)])

    return Problem(
        dimension=2 * n,
        structure=lambda y: canonical(n, y),
        hamiltonian=lambda y: 0.5 * dot(y[:n], y[:n]) + sum(np.exp(links(y))),
        gradient=lambda y: np.concatenate([y[:n], forces(np.exp(links(y)))]),
        noise=c,
        hessian=hessian,
        structure_derivative=lambda y: canonical_derivative(n, y),
        mean_gradient=mean_gradient,
        initial=np.zeros(2 * n),
        name="toda",
        data=NamedProblem("toda", (("particles", (float(n),)), ("noise", tuple(c.tolist())))),
        check=False,
    )
