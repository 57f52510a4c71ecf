"""The stochastic midpoint rule of §4: y1 = y0 + f((y0 + y1)/2)(h + Σ_j c_j ΔŴ_j), f = B∇H, equation (3.4)."""

from __future__ import annotations

from typing import Any

from sepv.fields import field_jacobian
from sepv.formula import Fields
from sepv.one_step import SYMMETRIC, implicit, one_step
from sepv.problem import Array, Problem


def formula(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    """Δ f(ȳ), ȳ = y + z/2."""
    return step[0] * fields.field(y + 0.5 * z)


def jacobian(problem: Problem, y0: Array, y1: Array, step: Array, *_: Array) -> Array | None:
    """∂/∂y1: ½ Δ f′(ȳ)."""
    slope = field_jacobian(problem, y0 + 0.5 * (y1 - y0))
    return None if slope is None else 0.5 * step[0] * slope


step = implicit(formula, jacobian)
scheme = one_step(
    "midpoint", step, SYMMETRIC | {"symplecticity"}, "Cohen and Dujardin (2014), equation (3.4)"
)
