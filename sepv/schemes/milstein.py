"""Milstein's scheme on the Itô form of (1.1), whose correction is derived here, not asked for.

The Itô drift is f + ½ Σ_j c_j² f′f. All noises drive the same field f, so that they commute and Milstein's
scheme needs no Lévy areas: with S = Σ_j c_j ΔŴ_j,

y1 = y0 + (f + ½Σc_j² f′f) h + f S + ½ f′f (S² − Σc_j² h) = y0 + f (h + S) + ½ f′f S².
"""

from __future__ import annotations

import numpy as np

from sepv.fields import derivative_along, vector_field
from sepv.problem import Array, Problem
from sepv.scheme import Scheme, as_lanes


def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """One step, for y of shape (d,) or (d, M) and dW of shape (m,) or (m, M)."""
    y0, noise = as_lanes(problem, y, h, dW)
    S = problem.random_step(0.0, noise)
    f0 = vector_field(problem, y0)
    y1 = y0 + f0 * (h + S) + 0.5 * derivative_along(problem, y0, f0) * (S * S)
    return y1.reshape(np.shape(y))


scheme = Scheme(
    name="milstein",
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
    source="Cohen and Dujardin (2014), §4; on the Itô form",
    batched=True,
)
