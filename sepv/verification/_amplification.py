"""The factor by which solving y1 = y0 + R(y0, y1) amplifies errors of R, for laws that compare two results."""

from __future__ import annotations

from sepv.problem import HamiltoniansProblem
from sepv.reference.equations_by_class import equation_for
from sepv.reference.steps import step_condition
from sepv.schemes import Scheme
from sepv.verification._cases.case import Case
from sepv.verification._contraction import CONTRACTION, has_majorants


def amplification(scheme: Scheme, case: Case) -> float:
    """A bound of ‖(I − ∂R/∂y1)⁻¹‖_∞ for a step y1 = y0 + R: 1/(1 − κ) if R is known to contract by a factor κ."""
    # For several Hamiltonians that are functions, R contracts inside a measured radius; no reference has the equation.
    if has_majorants(case) or isinstance(case.build()[0], HamiltoniansProblem):
        return 1 / (1 - CONTRACTION)
    method = equation_for(scheme.systems, scheme.stages)
    rows = step_condition(method, case.problem, case.y, case.h, case.dW, CONTRACTION)
    return max(sum(row) for row in rows)
