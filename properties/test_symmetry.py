"""(2.1) is symmetric: exchanging y0 with y1, h with −h and ΔW with −ΔW gives the same equation, so the step leads back.

The dependence on h and ΔW through Δ alone is the law "random-step".
"""

from __future__ import annotations

import numpy as np
from sepv.reference.equations_by_class import equation_for
from sepv.reference.steps import step_condition

from sepv.errors import SchemeFault, Skipped, StepFailure
from sepv.problem import Array, HamiltoniansProblem, Problem
from sepv.schemes import Scheme, ask
from sepv.schemes._guard import SchemeCrash
from sepv.verification import Case, Cases, Effort, Measurement, require, searched, state_ulp, step_residual
from sepv.verification._amplification import amplification
from sepv.verification._contraction import CONTRACTION


def check(scheme: Scheme, case: Case) -> Measurement:
    """|y0′ − y0| after a step with (h, ΔW) and one with (−h, −ΔW).

    With residuals r1 and r2 of the two steps, y0′ − y0 solves (I + Δ ∂R/∂y0)(y0′ − y0) = −(r1 + r2), whose inverse is
    that of the way back. R is assumed to be that of (2.1): that of another symmetric scheme differs from it by O(Δ²),
    which is less than the factors of 4 in r inside the contraction radius.
    """
    problem, y, h, dW = case.build()
    y1 = ask(scheme, problem, y, h, dW)
    returned = _back(scheme, problem, y1, h, dW)
    residual = step_residual(problem, y, y1, h, dW, scheme)
    residual = residual + step_residual(problem, y1, returned, -h, -dW, scheme)
    if isinstance(problem, HamiltoniansProblem):  # its equation is not among the references
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


def _back(scheme: Scheme, problem: Problem, y1: Array, h: float, dW: Array) -> Array:
    """The step with (−h, −ΔW) from y1.

    Raises
    ------
    Skipped
        Where the scheme refuses h < 0: this step and a hundred thousandth of it.
    """
    try:
        return ask(scheme, problem, y1, -h, -dW)
    except (StepFailure, SchemeFault, SchemeCrash) as error:
        if h > 0 and not _solves(scheme, problem, y1, -(2.0**-17) * h, 0 * dW):
            raise Skipped(f"the scheme makes no step with h < 0 ({_first_line(error)})") from error
        raise


def _solves(scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array) -> bool:
    try:
        ask(scheme, problem, y, h, dW)
    except (StepFailure, SchemeFault, SchemeCrash):
        return False
    return True


def _first_line(error: Exception) -> str:
    """The first line of an error: equal lines are counted together."""
    cause = error.__cause__
    return f"{type(cause).__name__}: {cause}" if cause is not None else type(error).__name__


law = searched(
    name="symmetry",
    statement="Φ(−h, −ΔW) ∘ Φ(h, ΔW) = id: the step with −h and −ΔW from y1 returns to y0",
    source="(2.1)",
    unit="ulp of y",
    cost=0.6,
    steps=174,
    cases=Cases(blind={"degree of B": ("0",)}),
    check=check,
)


def test_symmetry(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
