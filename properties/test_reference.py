"""The step is the solution of (2.1), as found in extended precision by code that owes nothing to the core."""

from __future__ import annotations

from sepv.reference.implicit import energy_preserving

from sepv.candidate import ask
from sepv.case import Case
from sepv.corners import corners
from sepv.law import Effort, Measurement, require
from sepv.scheme import Scheme
from sepv.search import searched
from sepv.strategies import any_steps
from sepv.tolerance import state_error


def check(scheme: Scheme, case: Case) -> Measurement:
    """Distance from (2.1) solved to 50 digits, against the condition-scaled bound."""
    problem, y, h, dW = case.build()
    y1 = ask(scheme, problem, y, h, dW)
    exact = energy_preserving(case.problem, case.y, h, case.dW)
    error, bound = state_error(exact.y1, exact.condition, problem, y, y1, h, dW, scheme.solver_tolerance)
    return Measurement(error, bound, f"y1 = {y1.tolist()}, {error:.3g} ulp from the solution of (2.1)")


law = searched(
    name="reference",
    statement="the step solves (2.1)",
    source="(2.1)",
    unit="ulp of y",
    cases=any_steps,
    check=check,
    corners=corners,
)


def test_reference(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
