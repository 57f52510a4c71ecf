"""The implicit schemes by name: (2.1), (2.2) and (3.4), each as a function of one step."""

from __future__ import annotations

from collections.abc import Sequence

from sepv.reference.problem import Description
from sepv.reference.steps import ReferenceStep, reference_step


def energy_preserving(
    data: Description, y: Sequence[float], h: float, dW: Sequence[float], digits: int = 50
) -> ReferenceStep:
    """Equation (2.1): y1 = y0 + B((y0 + y1)/2) ∫₀¹∇H(y0 + τ(y1 − y0))dτ Δ."""
    return reference_step("energy-preserving", data, y, h, dW, digits)


def averaged_vector_field(
    data: Description, y: Sequence[float], h: float, dW: Sequence[float], digits: int = 50
) -> ReferenceStep:
    """Equation (2.2), for constant B: y1 = y0 + B ∫₀¹∇H(y0 + τ(y1 − y0))dτ Δ, B taken once, at y0."""
    return reference_step("averaged-vector-field", data, y, h, dW, digits)


def midpoint(
    data: Description, y: Sequence[float], h: float, dW: Sequence[float], digits: int = 50
) -> ReferenceStep:
    """Equation (3.4): y1 = y0 + f((y0 + y1)/2) Δ."""
    return reference_step("midpoint", data, y, h, dW, digits)
