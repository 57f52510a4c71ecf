"""A step from y0 to y1 and a step back: the measurement of the laws "symmetry" and "reversibility", and its bound.

Write the equation (2.1) of the scheme as y1 = y0 + Δ R(y0, y1) with the random step Δ = h + Σ c_jΔW_j. If the two steps
have residuals r1 and r2, the state y0′ after both satisfies (I + Δ ∂R/∂y0)(y0′ − y0) = −(r1 + r2). The inverse of this
matrix is the condition of the step from y1 with −h and −ΔW. Other symmetric schemes have other functions R. These
differ from the R of (2.1) by O(Δ²). The bounds of r1 and r2 contain a factor of 4, which covers this difference inside
the contraction radius.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from sepv.reference.equations_by_class import equation_for
from sepv.reference.steps import step_condition

from sepv.problem import Array, DampedProblem, HamiltoniansProblem
from sepv.schemes import Scheme, ask
from sepv.verification._amplification import amplification
from sepv.verification._cases.case import Case
from sepv.verification._contraction import CONTRACTION
from sepv.verification._law import Measurement
from sepv.verification._tolerance import state_ulp, step_residual


def measured(scheme: Scheme, case: Case, back: Callable[[Array], Array]) -> Measurement:
    """Measure |y0′ − y0| after the step of the case from y0 to y1 and the step back y0′ = back(y1)."""
    problem, y, h, dW = case.build()
    y1 = ask(scheme, problem, y, h, dW)
    returned = back(y1)
    residual = step_residual(problem, y, y1, h, dW, scheme)
    residual = residual + step_residual(problem, y1, returned, -h, -dW, scheme)
    if isinstance(problem, (HamiltoniansProblem, DampedProblem)):
        # For several Hamiltonians and damping the reference solver has no condition number.
        bound = np.full(y.size, amplification(scheme, case) * float(residual.max()))
    else:
        method = equation_for(scheme.systems, scheme.stages)
        condition = step_condition(method, case.problem, y1.tolist(), -h, (-dW).tolist(), CONTRACTION)
        bound = np.array(condition) @ residual
    error = np.abs(returned - y)
    k = int(np.argmax(error / bound))
    unit = state_ulp(y, y1)
    detail = f"y1 = {y1.tolist()}, back at {returned.tolist()}"
    return Measurement(float(error[k]) / unit, float(bound[k]) / unit, detail)
