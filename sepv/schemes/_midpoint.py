"""The stochastic midpoint rule (3.4), §4 of the paper: y1 = y0 + f((y0 + y1)/2)(h + Σ_j c_j ΔŴ_j)
with f = B∇H.
"""

from __future__ import annotations

from sepv.core.formula import Fields, Values, derivative
from sepv.schemes._one_step import SYMMETRIC, implicit, one_step
from sepv.schemes._picture_look import Look


def formula(fields: Fields, y: Values, z: Values, step: Values) -> Values:
    """R of the step y1 = y + R: Δ f(ȳ) with z = y1 − y, ȳ = y + z/2, Δ = step[0] and f = B∇H."""
    return step[0] * fields.field(y + 0.5 * z)


step = implicit(formula, derivative(formula))
scheme = one_step(
    "midpoint",
    step,
    SYMMETRIC | {"poisson-map:constant", "long-time-energy"},
    "Cohen and Dujardin (2014), equation (3.4)",
    look=Look("#009E73", "#2CC79A", "^", "6 2"),
)
