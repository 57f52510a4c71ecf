"""The factor by which solving y1 = y0 + R(y0, y1) amplifies errors of R,
for laws that compare two results.
"""

from __future__ import annotations

import numpy as np

from sepv.law.cases.case import Case
from sepv.law.contraction import has_majorants
from sepv.law.tolerance import CONTRACTION
from sepv.problem import one_hamiltonian
from sepv.reference.equations_by_class import equation_for
from sepv.reference.steps import step_condition
from sepv.schemes import Scheme, gauss_amplification


def amplification(scheme: Scheme, case: Case) -> float:
    """A bound of ‖(I − ∂R/∂y1)⁻¹‖_∞ for a step y1 = y0 + R,
    if R is known to contract by a factor κ.

    It is 1/(1 − κ) if R contracts in |·|_∞, and |I + R′(I − R′)⁻¹|_∞ ≤ 1 + √d κ/(1 − κ) if it
    contracts in |·|_2 (`contraction_radius`), which is the larger of both.
    """
    # For several Hamiltonians that are functions, R contracts inside a measured radius; no
    # reference has the equation.
    problem = case.build()[0]
    if has_majorants(case) or not one_hamiltonian(problem):
        factor = CONTRACTION * gauss_amplification(scheme.stages)
        return float(1 + np.sqrt(problem.dimension) * factor / (1 - factor))
    method = equation_for(scheme.systems, scheme.stages)
    rows = step_condition(method, case.problem, case.y, case.h, case.dW, CONTRACTION)
    return float(max(sum(row) for row in rows))
