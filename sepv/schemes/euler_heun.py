"""The Euler-Heun scheme of §4: y1 = y0 + h f(y0) + ½(f(ŷ) + f(y0)) S with ŷ = y0 + h f(y0) + f(y0) S.

S = Σ_j c_j ΔŴ_j, because every noise drives the same field f = B∇H.
"""

from __future__ import annotations

import numpy as np

from sepv.fields import vector_field
from sepv.problem import Array, Problem
from sepv.scheme import Scheme, as_lanes


def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """One step, for y of shape (d,) or (d, M) and dW of shape (m,) or (m, M)."""
    y0, noise = as_lanes(problem, y, h, dW)
    S = problem.random_step(0.0, noise)
    f0 = vector_field(problem, y0)
    predicted = y0 + h * f0 + f0 * S
    y1 = y0 + h * f0 + 0.5 * (vector_field(problem, predicted) + f0) * S
    return y1.reshape(np.shape(y))


scheme = Scheme(
    name="euler-heun",
    step=step,
    claims=(
        "contract",
        "reproducibility",
        "noise-sum",
        "equivariance",
        "truncation",
    ),
    mean_square_order=1.0,
    weak_order=1.0,
    source="Cohen and Dujardin (2014), §4",
    batched=True,
)
