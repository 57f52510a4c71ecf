"""H and any Casimir together in dimension three: y1 = y0 + Δ g((y0 + y1)/2) (∇̄H × ∇̄C).

Here B(y)v = g(y)(v × ∇C(y)), and both gradients are averaged along the segment: ∇̄F = ∫₀¹∇F(y0
+ τ(y1 − y0))dτ. So H(y1) − H(y0) = ∇̄Hᵀ(y1 − y0) = 0 and C(y1) − C(y0) = ∇̄Cᵀ(y1 − y0) = 0, because
a vector product is orthogonal to both factors. C may be any function: this is the last open
question of Cohen and Dujardin (2014), §5, in dimension three. For quadratic C, ∇̄C is ∇C at the
midpoint, and the scheme is (2.1). It is symmetric, of mean-square and weak order 1.
"""

from __future__ import annotations

from sepv.core.formula import Fields, Values
from sepv.errors import Skipped
from sepv.problem import Nambu, Problem, Systems, cross
from sepv.schemes._one_step import ENERGY_PRESERVING, implicit, one_step


def required(problem: Problem) -> Nambu:
    """The Casimir C and the factor g of the problem, from `Problem.nambu`.
    Raises Skipped if they are not given.
    """
    if problem.nambu is None:
        raise Skipped(
            f"{problem.name} is not given as B(y)v = g(y)(v × ∇C(y)) in dimension 3 (Problem.nambu)"
        )
    return problem.nambu


def formula(fields: Fields, y: Values, z: Values, step: Values) -> Values:
    """R of the step y1 = y + R: Δ g(ȳ)(∇̄H × ∇̄C), with averages over y + τz,
    ȳ = y + z/2 and Δ = step[0].
    """
    normal = cross(fields.mean_gradient(y, z), fields.mean_casimir_gradient(y, z))
    return step[0] * fields.factor(y + 0.5 * z) * normal


step = implicit(formula, requires=required)
scheme = one_step(
    "both-invariants",
    step,
    ENERGY_PRESERVING | {"invariant:casimir"},
    "(2.1) with ∇C averaged too",
    systems=Systems.NAMBU,
)
