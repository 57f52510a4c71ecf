"""The Euler-Heun scheme (the paper's §4): y1 = y0 + h f(y0) + ½(f(ŷ) + f(y0))
S with ŷ = y0 + h f(y0) + f(y0) S.

S = Σ_j c_j ΔŴ_j, because every noise drives the same field f = B∇H; ΔŴ_j is the truncated ΔW_j.
"""

from __future__ import annotations

from sepv.core.formula import Fields, Values
from sepv.schemes._one_step import CLAIMS_OF_ALL, Explicit, drift_and_noise, one_step
from sepv.schemes._picture_look import Look


def formula(fields: Fields, y: Values, z: Values, step: Values) -> Values:  # noqa: ARG001 - an explicit scheme
    """The increment y1 − y0 of an Euler-Heun step from y0 = y, for `step` = (h, S)
    with S = Σ c_j ΔŴ_j.

    The increment is h f(y0) + ½(f(ŷ) + f(y0)) S, where ŷ = y0 + h f(y0) + f(y0) S is a step of
    Euler's method.
    """
    h, S = step
    f = fields.field(y)
    return h * f + 0.5 * (fields.field(y + h * f + f * S) + f) * S


step = Explicit(formula, drift_and_noise)
scheme = one_step(
    "euler-heun",
    step,
    CLAIMS_OF_ALL | {"noise-sum", "equivariance"},
    "Cohen and Dujardin (2014), §4",
    look=Look("#C47F00", "#E69F00", "s"),
)
