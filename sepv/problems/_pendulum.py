"""The stochastic mathematical pendulum with two noises, §4.3."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sepv.problem import Problem
from sepv.problems._canonical import structure
from sepv.problems._sum_of_parts import flows, named, total

# ½p² and −cos q.
_PARTS = (lambda y: 0.5 * y[0] * y[0], lambda y: -np.cos(y[1]))


def pendulum(noise: ArrayLike = (1.0, 0.5)) -> Problem:
    """dp = −sin q (dt + Σ c_j∘dW_j), dq = p(…); y = (p, q), H = p²/2 − cos q, from (0.2, 1).

    The defaults are those of Figure 4.4: c = (1, 0.5).
    """
    return named(
        "pendulum",
        noise,
        {},
        dimension=2,
        structure=structure,
        hamiltonian=total(_PARTS),
        initial=(0.2, 1.0),
        flows=flows(2, structure, _PARTS),
        # Solved from 10⁵ states near the initial one, and led back by −Δ.
        longest_step=0.5,
    )
