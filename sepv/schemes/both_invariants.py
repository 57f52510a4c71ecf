"""H and any Casimir together in dimension three: y1 = y0 + Δ g((y0 + y1)/2) (∇̄H × ∇̄C).

For B(y)v = g(y)(v × ∇C(y)), with both gradients averaged along the segment, ∇̄F = ∫₀¹∇F(y0 + τ(y1 − y0))dτ:
H(y1) − H(y0) = ∇̄Hᵀ(y1 − y0) = 0 and C(y1) − C(y0) = ∇̄Cᵀ(y1 − y0) = 0, because the vector product is orthogonal to both
its factors. C may be any function: this is the last open question of Cohen and Dujardin (2014), §5, in dimension three.
For quadratic C the average is ∇C at the midpoint, and the scheme is (2.1). Symmetric, of mean-square and weak order 1.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from sepv.average import average_gradient, average_hessian
from sepv.errors import Skipped
from sepv.formula import Fields
from sepv.nambu import Nambu, cross
from sepv.one_step import ENERGY_PRESERVING, implicit, one_step
from sepv.problem import Array, Problem


def required(problem: Problem) -> Nambu:
    """The problem's Casimir and factor.

    Raises
    ------
    Skipped
        For a problem that does not give them.
    """
    if problem.nambu is None:
        raise Skipped(
            f"{problem.name} is not given as B(y)v = g(y)(v × ∇C(y)) in dimension 3 (Problem.nambu)"
        )
    return problem.nambu


def formula(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    """Δ g(ȳ)(∇̄H × ∇̄C), ȳ = y + z/2."""
    normal = cross(fields.mean_gradient(y, z), fields.mean_casimir_gradient(y, z))
    return step[0] * fields.factor(y + 0.5 * z) * normal


def jacobian(problem: Problem, y0: Array, y1: Array, step: Array, *_: Array) -> Array | None:
    """∂/∂y1: Δ(½(∇̄H × ∇̄C)∇gᵀ + g(∫τH″ × ∇̄C + ∇̄H × ∫τC″))."""
    if problem.hessian is None:
        return None
    nambu, middle = required(problem), y0 + 0.5 * (y1 - y0)
    H, C = average_gradient(problem, y0, y1).value, average_gradient(cast(Any, nambu), y0, y1).value
    dH, dC = average_hessian(problem, y0, y1), average_hessian(cast(Any, nambu), y0, y1)
    assert dH is not None
    assert dC is not None
    # (∂H × C)_k column by column, and the same for C.
    turned = np.stack([cross(dH[:, k], C) + cross(H, dC[:, k]) for k in range(3)], axis=1)
    outer = cross(H, C)[:, None] * nambu.factor_gradient(middle)[None]
    return step[0] * (0.5 * outer + nambu.factor(middle) * turned)


step = implicit(formula, jacobian, requires=required)
scheme = one_step(
    "both-invariants",
    step,
    ENERGY_PRESERVING | {"any-casimir"},
    "(2.1) with ∇C averaged too",
    systems="nambu",
)
