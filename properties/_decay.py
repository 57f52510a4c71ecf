"""Decay of homogeneous invariants under damping, for the laws *conformal-casimir* and *conformal-energy*.

F(y1) = e^{−pγh}F(y0) for F of degree p. y1 = ρ(ρy0 + z) with ρ = e^{−γh/2} and a solved step z that leaves F unchanged
but for its residual r. **Bound**: r, of which |∇F|ᵀr remains, and the roundings of both products by ρ. With ρ good to
1.5 eps where |γh| ≤ 1 and one rounding in each product, a component of y is off by 4 eps |y|_∞.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sepv.errors import Skipped
from sepv.problem import Array, PolynomialSystem, Problem, damping_of
from sepv.record import EPS
from sepv.schemes import Scheme
from sepv.verification._cases.case import Case
from sepv.verification._tolerance import step_residual

# The largest |γh| of which the law speaks.
LONGEST = 1.0


def damped(case: Case) -> Case | None:
    """Keep steps of damped systems as data with |γh| ≤ LONGEST."""
    if not isinstance(case.problem, PolynomialSystem) or not case.problem.damping:
        return None
    return case if abs(case.problem.damping * case.h) <= LONGEST else None


def factor(exact: Any, problem: Problem, h: float, degree: int) -> Any:
    """e^{−pγh} in the arithmetic of the references."""
    gamma, length = exact.number(damping_of(problem)), exact.number(h)
    return exact.ctx.exp(-degree * gamma * length)


def residual(scheme: Scheme, problem: Problem, y: Array, y1: Array, h: float, dW: Array) -> Array:
    """The residual (d,) of the module's docstring. Raises Skipped for |γh| > LONGEST."""
    if abs(damping_of(problem) * h) > LONGEST:
        raise Skipped(f"the law speaks of |γh| ≤ {LONGEST:g}")
    rounding = 4 * EPS * max(float(np.max(np.abs(v))) for v in (y, y1))
    return step_residual(problem, y, y1, h, dW, scheme) + rounding
