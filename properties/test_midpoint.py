"""§3.3 of Cohen and Dujardin (2014): if H = ½yᵀDy + eᵀy, the scheme (2.1)
is the stochastic midpoint rule (3.4).

The s-stage scheme (Cohen and Hairer, BIT 51, 2011) is then the s-stage Gauss method: for linear ∇H,
the collocation polynomial u and the Gauss nodes c_i, weights b_i and Lagrange basis ℓ_i satisfy
b_i⁻¹∫ℓ_i ∇H(u) = ∇H(u(c_i)).
"""

from __future__ import annotations

from sepv.properties._exact_step import exact_step

from sepv.law import Case, Cases, Effort, Measurement, require, searched
from sepv.law.cases.of_law import only
from sepv.law.tolerance import state_error
from sepv.problem import Problem, one_field
from sepv.schemes import Scheme, ask


def quadratic(problem: Problem) -> bool:
    """True if H, and C in a Nambu system, have degree ≤ 2:
    then averaged gradients equal gradients at the midpoint.
    """
    C = problem.nambu
    return problem.degree in (1, 2) and (C is None or (C.degree or 2) <= 2)


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure the distance of y1 from the midpoint rule, or the s-stage Gauss method,
    solved to 30 digits.
    """
    problem, y, h, dW = case.build()
    y1 = ask(scheme, problem, y, h, dW)
    method = "midpoint" if scheme.stages == 1 else f"gauss-{scheme.stages}"
    exact, condition = exact_step(method, case.problem, case.y, h, case.dW)
    error, bound = state_error(exact, condition, problem, y, y1, h, dW, scheme)
    name = "the midpoint rule" if scheme.stages == 1 else f"the {scheme.stages}-stage Gauss method"
    return Measurement(error, bound, f"y1 = {y1.tolist()}, {error:.3g} ulp from {name}")


_ABOUT_ONE_FIELD = "it is about the equation of (2.1), which several fields do not have"
law = searched(
    name="midpoint",
    statement="for quadratic H the step is that of the midpoint rule, or with s stages that of the Gauss method",
    source="§3.3",
    unit="ulp of y",
    cost=0.5,
    steps=69,
    cases=Cases(
        where={"degree of H": ("1–2",), "degree of C": ("1", "2")},
        blind={"degree of B": ("0",)},
        adapt=only(quadratic, data=True),
        why="the problems have no quadratic H given as data",
        needs={one_field: _ABOUT_ONE_FIELD},
    ),
    check=check,
)


def test_midpoint(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
