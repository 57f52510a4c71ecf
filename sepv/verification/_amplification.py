"""How far an error of the right side may move the solution of a step, for the laws that compare two answers."""

from __future__ import annotations

from sepv.problem import HamiltoniansProblem, PolynomialSystem
from sepv.reference.equations_by_class import equation_for
from sepv.reference.steps import step_condition
from sepv.schemes import Scheme
from sepv.verification._cases.case import Case
from sepv.verification.strategies import CONTRACTION


def amplification(scheme: Scheme, case: Case) -> float:
    """A bound of ‖(I − ∂R/∂y1)⁻¹‖_∞: 1/(1 − κ) inside the contraction radius, computed for the paper's problems."""
    several = isinstance(case.build()[0], HamiltoniansProblem)
    if (
        isinstance(case.problem, PolynomialSystem) or several
    ):  # cases of functions stay inside a measured radius
        return 1 / (1 - CONTRACTION)
    method = equation_for(scheme.systems, scheme.stages)
    rows = step_condition(method, case.problem, case.y, case.h, case.dW, CONTRACTION)
    return max(sum(row) for row in rows)
