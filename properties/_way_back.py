"""A step and its way back to y0: the check of the laws "symmetry" and "reversibility", with the bound of both.

With residuals r1 and r2 of the two steps, the state y0′ that comes back solves (I + Δ ∂R/∂y0)(y0′ − y0) = −(r1 + r2),
whose inverse is that of the step from y1 with −h and −ΔW. R is assumed to be that of (2.1): that of another symmetric
scheme differs from it by O(Δ²), which is less than the factors of 4 in r inside the contraction radius.
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
    """|y0′ − y0| for y0′ = back(y1)."""
    problem, y, h, dW = case.build()
    y1 = ask(scheme, problem, y, h, dW)
    returned = back(y1)
    residual = step_residual(problem, y, y1, h, dW, scheme)
    residual = residual + step_residual(problem, y1, returned, -h, -dW, scheme)
    if isinstance(problem, (HamiltoniansProblem, DampedProblem)):  # its equation is not among the references
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
