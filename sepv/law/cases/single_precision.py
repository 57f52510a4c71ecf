"""Cases for schemes in single precision: their numbers are rounded,
and must lie in the range of single precision.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from sepv.law.cases.case import Case
from sepv.law.tolerance import gradient_majorant, structure_majorant
from sepv.problem import PolynomialSystem

# The largest error of B and ∇H in single precision, relative to the sum of their terms: a few
# thousand roundings. A larger error means that powers overflow or underflow, which no order of
# summation avoids.
SINGLE_PRECISION_MAX_ERROR = 2.0**-12
# The range in which single precision represents coefficients with all digits, and in which their
# sums do not overflow.
SINGLE_MIN, SINGLE_MAX = 2.0**-126, 2.0**120


def single(case: Case) -> Case:
    """The case with y, h and dW rounded to single precision."""
    with np.errstate(all="ignore"):
        y, dW = (tuple(float(np.float32(v)) for v in values) for values in (case.y, case.dW))
        return replace(case, y=y, h=float(np.float32(case.h)), dW=dW)


def in_range(case: Case) -> bool:
    """True if B and ∇H at y and 2y, evaluated in single precision, have no error beyond rounding,
    such as overflow.
    """
    if isinstance(case.problem, PolynomialSystem) and not all(
        SINGLE_MIN <= abs(value) <= SINGLE_MAX
        for p in (case.problem.hamiltonian, *(entry for _, _, entry in case.problem.structure))
        for _, value in p.terms
    ):
        return False
    problem, y, h, dW = case.build()
    if not np.all(np.isfinite([*y, h, *dW])):
        return False
    with np.errstate(all="ignore"):
        for state in (y, 2 * y):
            given: Any = state.astype(np.float32)
            for function, size in (
                (problem.gradient, gradient_majorant),
                (problem.structure, structure_majorant),
            ):
                exact, found = function(state), np.float32(function(given))
                if not np.all(np.abs(found - exact) <= SINGLE_PRECISION_MAX_ERROR * size(problem, state)):
                    return False
    return True
