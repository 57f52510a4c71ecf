"""§3.3: for quadratic H = ½yᵀDy + eᵀy the scheme is the stochastic midpoint rule (3.4).

For s stages (Cohen and Hairer, BIT 51, 2011) it is the s-stage Gauss method: b_i⁻¹∫ℓ_i ∇H(u) = ∇H(u(c_i)).
"""

from __future__ import annotations

from hypothesis import strategies as st
from sepv.reference.steps import reference_step

from sepv.schemes import Scheme, ask
from sepv.verification import Case, Effort, Measurement, require, searched
from sepv.verification._cases.fixed_cases import with_quadratic_hamiltonian
from sepv.verification._tolerance import DIGITS, state_error
from sepv.verification.strategies import casimir_systems, poisson_systems, steps


def cases() -> st.SearchStrategy[Case]:
    """H of degree 1 or 2, any B(y)."""
    return st.one_of(steps(poisson_systems(degree=2)), steps(casimir_systems(degree=2)))


def check(scheme: Scheme, case: Case) -> Measurement:
    """Distance from the midpoint rule solved to 30 digits, or from the s-stage Gauss method."""
    problem, y, h, dW = case.build()
    y1 = ask(scheme, problem, y, h, dW)
    method = "midpoint" if scheme.stages == 1 else f"gauss-{scheme.stages}"
    exact = reference_step(method, case.problem, case.y, h, case.dW, DIGITS)
    error, bound = state_error(exact.y1, exact.condition, problem, y, y1, h, dW, scheme)
    name = "the midpoint rule" if scheme.stages == 1 else f"the {scheme.stages}-stage Gauss method"
    return Measurement(error, bound, f"y1 = {y1.tolist()}, {error:.3g} ulp from {name}")


law = searched(
    name="midpoint",
    statement="for quadratic H the step is that of the midpoint rule (s stages: Gauss)",
    source="§3.3",
    unit="ulp of y",
    cost=0.5,
    steps=69,
    cases=cases,
    check=check,
    fixed_cases=with_quadratic_hamiltonian,
    admits=lambda case: (case.build()[0].degree or 3) <= 2,
)


def test_midpoint(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
