"""(2.1) is symmetric: exchanging y0 with y1 and Δ with −Δ gives the same equation, so −Δ leads back."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from sepv.reference.more_equations import equation_for
from sepv.reference.steps import step_condition

from sepv.candidate import ask
from sepv.case import Case
from sepv.corners import corners
from sepv.law import Effort, Measurement, require
from sepv.problem import PolynomialSystem
from sepv.scheme import Scheme
from sepv.search import searched
from sepv.strategies import CONTRACTION, casimir_systems, paper_steps, poisson_systems, steps
from sepv.tolerance import state_ulp, step_residual


def cases() -> st.SearchStrategy[Case]:
    """Problems with noise. Polynomial ones get c_1 = 1, so that the way back has an exact increment."""

    def noisy(s: PolynomialSystem) -> PolynomialSystem:
        noise = (1.0, *s.noise[1:])
        return PolynomialSystem(s.dimension, s.hamiltonian, s.structure, noise, s.casimirs, s.linear_casimirs)

    return st.one_of(steps(poisson_systems().map(noisy)), steps(casimir_systems().map(noisy)), paper_steps())


def check(scheme: Scheme, case: Case) -> Measurement:
    """|y0′ − y0| after a step with Δ and one with −Δ.

    h stays positive on the way back: the noise alone turns Δ around, c_1 ΔW_1′ = −2h − c_1 ΔW_1 and the
    other increments change sign. With residuals r1 and r2 of the two steps, y0′ − y0 solves
    (I + Δ ∂R/∂y0)(y0′ − y0) = −(r1 + r2), whose inverse is that of the way back.
    """
    problem, y, h, dW = case.build()
    back, h_back = -dW, h
    if scheme.systems == "several":
        h_back = -h  # no noise turns the drift around
    else:
        back[0] = -dW[0] - 2 * h / problem.c[0]
    y1 = ask(scheme, problem, y, h, dW)
    returned = ask(scheme, problem, y1, h_back, back)
    residual = step_residual(problem, y, y1, h, dW, scheme.solver_tolerance, scheme.stages)
    residual = residual + step_residual(
        problem, y1, returned, h_back, back, scheme.solver_tolerance, scheme.stages
    )
    method = equation_for(scheme.systems, scheme.stages)
    condition = step_condition(method, case.problem, y1.tolist(), h_back, back.tolist(), CONTRACTION)
    bound = np.array(condition) @ residual
    error = np.abs(returned - y)
    k = int(np.argmax(error / bound))
    unit = state_ulp(y, y1)
    detail = f"y1 = {y1.tolist()}, back at {returned.tolist()}"
    return Measurement(float(error[k]) / unit, float(bound[k]) / unit, detail)


law = searched(
    name="symmetry",
    statement="the step with −Δ from y1 returns to y0",
    source="(2.1)",
    unit="ulp of y",
    cases=cases,
    check=check,
    corners=corners,
)


def test_symmetry(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
