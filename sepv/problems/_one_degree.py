"""The oscillator and the pendulum of Cohen and Dujardin's paper,
with H given as a sum of two parts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from sepv.problem import Function, Problem
from sepv.problems._common import flows, named, structure, total

# The parts ½p² and ½x² of the oscillator, ½p² and −cos q of the pendulum.
_OSCILLATOR = (lambda y: 0.5 * y[0] * y[0], lambda y: 0.5 * y[1] * y[1])
_PENDULUM = (lambda y: 0.5 * y[0] * y[0], lambda y: -np.cos(y[1]))


def harmonic_oscillator(noise: ArrayLike = 1.0) -> Problem:
    """The stochastic harmonic oscillator, from §4.1 of Cohen and Dujardin's paper.

    dp = −x(dt + c∘dW), dx = p(dt + c∘dW), with y = (p, x), H = (p² + x²)/2 and the initial state
    (0.2, 0.1). The paper's Figure 4.1 has the default noise c = 1.
    """
    return _of_parts("harmonic-oscillator", noise, _OSCILLATOR, (0.2, 0.1))


def pendulum(noise: ArrayLike = (1.0, 0.5)) -> Problem:
    """The stochastic mathematical pendulum with two noises,
    from §4.3 of Cohen and Dujardin's paper.

    dp = −sin q (dt + Σ c_j∘dW_j), dq = p (dt + Σ c_j∘dW_j), with y = (p, q), H = p²/2 − cos q and
    the initial state (0.2, 1). The paper's Figure 4.4 has the default noise c = (1, 0.5).
    """
    return _of_parts("pendulum", noise, _PENDULUM, (0.2, 1.0))


def _of_parts(
    name: str, noise: ArrayLike, parts: Sequence[Function], initial: tuple[float, float]
) -> Problem:
    return named(
        name, noise, {}, dimension=2, structure=structure, hamiltonian=total(parts), initial=initial,
        flows=flows(2, structure, parts),
        # Steps Δ of this size were solved from 10⁵ states near the initial one, and steps −Δ led
        # back to these states.
        longest_step=0.5,
    )  # fmt: skip
