"""The rigid body with damping, dy = (B(y)∇H − γy)dt + c B(y)∇H ∘dW;
|y|² and H decay as e^{−2γt} along each path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sepv.problem import PolynomialSystem, Problem
from sepv.problems._common import hat
from sepv.problems._polynomial_system import started
from sepv.record import poly


def damped_top(
    damping: float = 0.5, inertia: Sequence[float] = (0.345, 0.653, 1.0), noise: Sequence[float] = (1.0,)
) -> Problem:
    """The rigid body with B(y)v = y × v, H = ½ Σ y_i²/I_i and the damping −γy dt,
    from the state (0.8, 0.6, 0).
    """
    identity = tuple(tuple(float(i == j) for j in range(3)) for i in range(3))
    data = PolynomialSystem(3, poly.squares([1 / I for I in inertia]), hat(), tuple(noise), (identity,))
    return started(replace(data, damping=float(damping)), "damped-top", (0.8, 0.6, 0.0))
