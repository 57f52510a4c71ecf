"""Proposition 3.1 of Cohen and Dujardin (2014): H(y1) = H(y0) for every skew B,
polynomial H and step of a path.

The last step of a tested path has no noise (ΔW = 0), because a scheme may have separate code for
this case.
"""

from __future__ import annotations

import mpmath
import numpy as np
from sepv.properties._long_steps import for_energy
from sepv.reference.problem import exact_problem

from sepv.errors import StepFailure
from sepv.law import (
    Case,
    Cases,
    Effort,
    Measurement,
    energy_bound,
    energy_ulp,
    require,
    searched,
    step_residual,
)
from sepv.law.cases.fixed_cases import may_be_refused
from sepv.law.cases.of_law import NOT_KEPT
from sepv.law.contraction import contraction_radius
from sepv.problem import PolynomialSystem, Systems, one_hamiltonian
from sepv.schemes import Scheme, ask_next

PATH_STEPS_KEPT = 3


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure the largest defect of H over a few steps,
    evaluated at the binary64 states in extended precision.

    The bound follows from the step's residual alone, whether or not its equation is a contraction.
    So long steps are tested too: those of `sepv.properties._long_steps` and simplified ones. A
    scheme may refuse long steps.
    """
    problem, y, h, increments = case.build()
    exact = exact_problem(case.problem, 40)
    worst, state = Measurement(0.0, 0.0), None
    for n in range(PATH_STEPS_KEPT):
        dW = increments if n + 1 < PATH_STEPS_KEPT else np.zeros_like(increments)
        try:
            y1, state = ask_next(scheme, problem, y, state, h, dW)
        except StepFailure:
            if n and may_be_refused(case):  # the search counts a refused first step as skipped
                break
            raise
        before, after = exact.hamiltonian(exact.state(y)), exact.hamiltonian(exact.state(y1))
        unit = energy_ulp(problem, y, y1)
        bound = energy_bound(problem, y, y1, step_residual(problem, y, y1, h, dW, scheme))
        bound = bound + exact.uncertainty(y, y1)
        measurement = Measurement(
            abs(float(after - before)) / unit,
            bound / unit,
            f"step {n + 1}: H(y1) − H(y0) = {mpmath.nstr(after - before, 6)}, H(y0) = {mpmath.nstr(before, 6)}, "
            f"y1 = {y1.tolist()}"
            + (f", from y0 = {y.tolist()} after {n} step{'s' * (n > 1)}" if n else "")
            + (" with ΔW = 0" if n + 1 == PATH_STEPS_KEPT and dW.size else ""),
        )
        worst = measurement if n == 0 or measurement.ratio > worst.ratio else worst
        y = y1
        if n + 1 == PATH_STEPS_KEPT:
            break
        length = abs(h) + float(abs(problem.c * dW).sum())
        # A step from y1 that is longer than its contraction radius need not have a solution.
        if isinstance(case.problem, PolynomialSystem) and contraction_radius(problem, y) < length:
            break
    return worst


law = searched(
    name="energy",
    statement="H(y1) = H(y0) for every skew-symmetric B, every polynomial H and every step",
    source="Prop. 3.1",
    unit="ulp of H",
    preserves=True,
    cost=0.8,
    steps=310,
    cases=Cases(
        blind={"degree of H": ("1–2",)},
        needs={one_hamiltonian: NOT_KEPT},
        fixed={Systems.SINGLE: for_energy},
    ),
    check=check,
)


def test_energy(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
