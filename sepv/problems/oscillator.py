"""The stochastic harmonic oscillator, §4.1."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sepv.problem import Array, NamedProblem, Problem
from sepv.problems._canonical import kinetic_flow, structure, structure_derivative


def harmonic_oscillator(noise: ArrayLike = 1.0) -> Problem:
    """dp = −x(dt + c∘dW), dx = p(dt + c∘dW); y = (p, x), H = (p² + x²)/2, from (p, x) = (0.2, 0.1).

    The defaults are those of Figure 4.1: c = 1.
    """
    c = np.atleast_1d(np.asarray(noise, dtype=np.float64))
    return Problem(
        dimension=2,
        structure=structure,
        hamiltonian=lambda y: 0.5 * (y[0] * y[0] + y[1] * y[1]),
        gradient=lambda y: np.stack([y[0], y[1]]),
        noise=c,
        hessian=_hessian,
        structure_derivative=structure_derivative,
        mean_gradient=lambda y0, y1: y0 + 0.5 * (y1 - y0),
        degree=2,
        initial=(0.2, 0.1),
        flows=(kinetic_flow, lambda y, t: np.stack([y[0] - t * y[1], y[1]])),
        name="harmonic-oscillator",
        data=NamedProblem("harmonic-oscillator", (("noise", tuple(c.tolist())),)),
        check=False,
    )


def _hessian(y: Array) -> Array:
    zero, one = np.zeros_like(y[0]), np.ones_like(y[0])
    return np.stack([np.stack([one, zero]), np.stack([zero, one])])
