"""The Euler-Maruyama scheme on the Itô form of (1.1): y1 = y0 + (f + ½Σ_j c_j² f′f)
h + f Σ_j c_j ΔŴ_j.

The scheme itself computes the correction ½Σ_j c_j² f′f from Stratonovich to Itô, for f = B∇H and
its derivative f′.
"""

from __future__ import annotations

import numpy as np

from sepv.core.formula import Fields, Values
from sepv.schemes._one_step import CLAIMS_OF_ALL, Explicit, drift_and_noise, one_step
from sepv.schemes._picture_look import Look


def formula(fields: Fields, y: Values, z: Values, step: Values) -> Values:  # noqa: ARG001 - an explicit scheme
    """The increment y1 − y0 of an Euler-Maruyama step from y0 = y, for `step` = (h, S)
    with S = Σ c_j ΔŴ_j.

    The increment is (f + ½Σc_j² f′f) h + f S, with the field f = B∇H and its derivative f′ at y0.
    """
    h, S = step
    f = fields.field(y)
    correction = 0.5 * float(np.sum(fields.problem.c**2)) * fields.derivative_along(y, f)
    return (f + correction) * h + f * S


step = Explicit(formula, drift_and_noise)
scheme = one_step(
    "euler-maruyama",
    step,
    CLAIMS_OF_ALL | {"equivariance"},
    "Cohen and Dujardin (2014), §4; on the Itô form",
    mean_square_order=0.5,
    look=Look("#D55E00", "#FF8A3D", "+", "3 2"),
)
