"""The stochastic mathematical pendulum with two noises, §4.3."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sepv.problem import Array, NamedProblem, Problem
from sepv.problems._canonical import kinetic_flow, structure, structure_derivative


def pendulum(noise: ArrayLike = (1.0, 0.5)) -> Problem:
    """dp = −sin q (dt + Σ c_j∘dW_j), dq = p(…); y = (p, q), H = p²/2 − cos q, from (0.2, 1).

    The defaults are those of Figure 4.4: c = (1, 0.5).
    """
    c = np.atleast_1d(np.asarray(noise, dtype=np.float64))
    return Problem(
        dimension=2,
        structure=structure,
        hamiltonian=lambda y: 0.5 * y[0] * y[0] - np.cos(y[1]),
        gradient=lambda y: np.stack([y[0], np.sin(y[1])]),
        noise=c,
        hessian=_hessian,
        structure_derivative=structure_derivative,
        mean_gradient=_mean_gradient,
        initial=(0.2, 1.0),
        flows=(kinetic_flow, lambda y, t: np.stack([y[0] - t * np.sin(y[1]), y[1]])),
        name="pendulum",
        data=NamedProblem("pendulum", (("noise", tuple(c.tolist())),)),
        check=False,
    )


def _hessian(y: Array) -> Array:
    zero, one = np.zeros_like(y[0]), np.ones_like(y[0])
    return np.stack([np.stack([one, zero]), np.stack([zero, np.cos(y[1])])])


def _mean_gradient(y0: Array, y1: Array) -> Array:
    """∫₀¹ sin(q0 + τδ)dτ = (cos q0 − cos q1)/δ = sin(q0 + δ/2) · sin(δ/2)/(δ/2): no 0/0 as δ → 0."""
    half = 0.5 * (y1 - y0)
    sinc = np.sinc(half[1] / np.pi)  # numpy's sinc(x) is sin(πx)/(πx)
    return np.stack([y0[0] + half[0], np.sin(y0[1] + half[1]) * sinc])
