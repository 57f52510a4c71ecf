"""The open Toda chain, H = ½Σp_i² + Σ exp(q_i − q_{i+1}), with B = J⁻¹ as in (1.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sepv.problem import Array, Problem, dot
from sepv.problems._common import named, structure, whole_number

# The largest number of particles. It is bounded because B and H″ are dense matrices.
MAX_PARTICLES = 64


def toda(particles: float = 3, noise: ArrayLike = 1.0) -> Problem:
    """The open Toda chain, y = (p_1 … p_n, q_1 … q_n), with the initial state p = 0, q = 0."""
    n = whole_number("particles", particles, 2, MAX_PARTICLES)

    def hamiltonian(y: Array) -> Array:
        return 0.5 * dot(y[:n], y[:n]) + sum(np.exp(y[n:-1] - y[n + 1 :]))

    return named(
        "toda",
        noise,
        {"particles": (n,)},
        dimension=2 * n,
        structure=structure,
        hamiltonian=hamiltonian,
        initial=np.zeros(2 * n),
    )
