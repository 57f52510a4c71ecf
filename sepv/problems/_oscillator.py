"""The stochastic harmonic oscillator, §4.1."""

from __future__ import annotations

from numpy.typing import ArrayLike

from sepv.problem import Problem
from sepv.problems._canonical import structure
from sepv.problems._sum_of_parts import flows, named, total

# ½p² and ½x².
_PARTS = (lambda y: 0.5 * y[0] * y[0], lambda y: 0.5 * y[1] * y[1])


def harmonic_oscillator(noise: ArrayLike = 1.0) -> Problem:
    """dp = −x(dt + c∘dW), dx = p(dt + c∘dW); y = (p, x), H = (p² + x²)/2, from (p, x) = (0.2, 0.1).

    The defaults are those of Figure 4.1: c = 1.
    """
    return named(
        "harmonic-oscillator",
        noise,
        {},
        dimension=2,
        structure=structure,
        hamiltonian=total(_PARTS),
        initial=(0.2, 0.1),
        flows=flows(2, structure, _PARTS),
        # Solved from 10⁵ states near the initial one, and led back by −Δ.
        longest_step=0.5,
    )
