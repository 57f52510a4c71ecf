"""The step is the solution of (2.1), as found in extended precision by code that owes nothing to the core.

For s stages, of the collocation equations of Cohen and Hairer (2011) with the random step.
"""

from __future__ import annotations

from sepv.reference.more_equations import equation_for
from sepv.reference.steps import reference_step

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
    method = equation_for(scheme.systems, scheme.stages)
    exact = reference_step(method, case.problem, case.y, h, case.dW)
    error, bound = state_error(
        exact.y1, exact.condition, problem, y, y1, h, dW, scheme.solver_tolerance, scheme.stages
    )
    equation = method if isinstance(method, str) else method.name
    name = "the solution of (2.1)" if equation == "energy-preserving" else equation
    return Measurement(error, bound, f"y1 = {y1.tolist()}, {error:.3g} ulp from {name}")


law = searched(
    name="reference",
    statement="the step solves (2.1) (s stages: its collocation equations)",
    source="(2.1)",
    unit="ulp of y",
    cases=any_steps,
    check=check,
    corners=corners,
)


def test_reference(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
