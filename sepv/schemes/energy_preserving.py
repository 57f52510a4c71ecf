"""The energy-preserving scheme (2.1); for constant B it is (2.2), the averaged vector field method.

y1 = y0 + B((y0 + y1)/2) ∫₀¹ ∇H(y0 + τ(y1 − y0)) dτ · Δ,  Δ = h + Σ_j c_j ΔŴ_j.
"""

from __future__ import annotations

from typing import Any

from sepv.average import average_gradient, average_hessian
from sepv.fields import contract, matmul, matvec
from sepv.formula import Fields
from sepv.one_step import ENERGY_PRESERVING, implicit, one_step
from sepv.problem import Array, Problem


def formula(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    """Δ B(ȳ) ∇̄H, ȳ = y + z/2: the right side of (2.1) without y0, for z = y1 − y0."""
    return step[0] * matvec(fields.structure(y + 0.5 * z), fields.mean_gradient(y, z))


def jacobian(
    problem: Problem,
    y0: Array,
    y1: Array,
    step: Array,
    mean: Array | None = None,
    B: Array | None = None,
) -> Array | None:
    """∂/∂y1 of `increment`: Δ(½ B′(ȳ)[·]∇̄H + B(ȳ) ∫τH″dτ), from ∇̄H and B(ȳ) where they are known."""
    if problem.structure_derivative is None or problem.hessian is None:
        return None
    middle = y0 + 0.5 * (y1 - y0)
    slope = average_hessian(problem, y0, y1)
    assert slope is not None  # the problem has a Hessian
    mean = average_gradient(problem, y0, y1).value if mean is None else mean
    B = problem.structure(middle) if B is None else B
    turned = contract(problem.structure_derivative(middle), mean)
    return step[0] * (0.5 * turned + matmul(B, slope))


step = implicit(formula, jacobian)
scheme = one_step("energy-preserving", step, ENERGY_PRESERVING, "Cohen and Dujardin (2014), equation (2.1)")
