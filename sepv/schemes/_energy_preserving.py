"""The energy-preserving scheme (2.1); for constant B it is (2.2), the averaged vector field method.

y1 = y0 + B((y0 + y1)/2) ∫₀¹ ∇H(y0 + τ(y1 − y0)) dτ · Δ,
Δ = h + Σ_j c_j ΔŴ_j   (ΔŴ_j: truncated ΔW_j).
"""

from __future__ import annotations

from sepv.core.formula import Fields, Values, derivative
from sepv.schemes._one_step import ENERGY_PRESERVING, implicit, one_step
from sepv.schemes._picture_look import Look


def formula(fields: Fields, y: Values, z: Values, step: Values) -> Values:
    """R of the step y1 = y + R, equation (2.1): Δ B(ȳ) ∇̄H with z = y1 − y,
    ȳ = y + z/2 and Δ = step[0].

    ∇̄H is the average of ∇H along the segment from y to y + z.
    """
    return step[0] * fields.apply(y + 0.5 * z, fields.mean_gradient(y, z))


jacobian = derivative(formula)
step = implicit(formula, jacobian)
scheme = one_step(
    "energy-preserving",
    step,
    ENERGY_PRESERVING,
    "Cohen and Dujardin (2014), equation (2.1)",
    look=Look("#0072B2", "#56B4E9", "o"),
)
