"""The Euler-Maruyama scheme on the Itô form of (1.1): y1 = y0 + (f + ½Σ_j c_j² f′f) h + f Σ_j c_j ΔŴ_j.

The correction ½Σ_j c_j² f′f from Stratonovich to Itô is derived here, not asked for.
"""

from __future__ import annotations

import numpy as np

from sepv.fields import derivative_along, vector_field
from sepv.problem import Array, Problem
from sepv.scheme import Scheme, as_lanes


def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """One step, for y of shape (d,) or (d, M) and dW of shape (m,) or (m, M)."""
    y0, noise = as_lanes(problem, y, h, dW)
    f0 = vector_field(problem, y0)
    ito_drift = f0 + 0.5 * float(np.sum(problem.c**2)) * derivative_along(problem, y0, f0)
    y1 = y0 + ito_drift * h + f0 * problem.random_step(0.0, noise)
    return y1.reshape(np.shape(y))


scheme = Scheme(
    name="euler-maruyama",
    step=step,
    claims=(
        "contract",
        "reproducibility",
        "equivariance",
        "truncation",
    ),
    mean_square_order=0.5,
    weak_order=1.0,
    source="Cohen and Dujardin (2014), §4; on the Itô form",
    batched=True,
)
