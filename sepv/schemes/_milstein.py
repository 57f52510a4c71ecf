"""Milstein's scheme on the Itô form of dy = f(dt + Σ_j c_j∘dW_j), f = B∇H, equation (1.1).

The Itô drift is f + ½ Σ_j c_j² f′f, which the scheme computes itself. All noises drive the same
field f, so that Milstein's scheme needs no Lévy areas: with S = Σ_j c_j ΔŴ_j and truncated
increments ΔŴ_j,

y1 = y0 + (f + ½Σc_j² f′f) h + f S + ½ f′f (S² − Σc_j² h) = y0 + f (h + S) + ½ f′f S².
"""

from __future__ import annotations

from sepv.core.formula import Fields, Values
from sepv.schemes._one_step import CLAIMS_OF_ALL, Explicit, drift_and_noise, one_step
from sepv.schemes._picture_look import Look


def formula(fields: Fields, y: Values, z: Values, step: Values) -> Values:  # noqa: ARG001 - an explicit scheme
    """The increment y1 − y0 of a Milstein step from y0 = y, for `step` = (h, S)
    with S = Σ c_j ΔŴ_j.

    The increment is f (h + S) + ½ f′f S², with the field f = B∇H and its derivative f′ at y0.
    """
    h, S = step
    f = fields.field(y)
    return f * (h + S) + 0.5 * fields.derivative_along(y, f) * (S * S)


step = Explicit(formula, drift_and_noise)
scheme = one_step(
    "milstein",
    step,
    CLAIMS_OF_ALL | {"noise-sum", "equivariance"},
    "Cohen and Dujardin (2014), §4; on the Itô form",
    look=Look("#6A5ACD", "#B5A8FF", "*", "5 1 1 1"),
)
