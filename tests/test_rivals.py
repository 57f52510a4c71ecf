"""Explicit and Gauss Runge-Kutta methods with the random step."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sepv.reference.steps import reference_step

from sepv import problems, schemes, strategies
from sepv.case import Case
from sepv.explicit_tableaux import TABLEAUX
from sepv.tolerance import state_ulp

RIVALS = [*schemes.MORE.values(), *(schemes.gauss(s) for s in range(1, 7))]


@given(strategies.any_steps(), st.integers(1, 6))
def test_gauss_methods_solve_their_equations(case: Case, s: int) -> None:
    problem, y, h, dW = case.build()
    exact = np.array(
        [float(v) for v in reference_step(f"gauss-{s}", case.problem, case.y, h, case.dW, 25).y1]
    )
    assert np.max(np.abs(schemes.gauss(s).step(problem, y, h, dW) - exact)) <= 8 * state_ulp(y, exact)


@given(strategies.any_steps())
def test_one_gauss_stage_is_the_midpoint_rule(case: Case) -> None:
    problem, y, h, dW = case.build()
    rule = schemes.midpoint.step(problem, y, h, dW)
    assert np.max(np.abs(schemes.gauss(1).step(problem, y, h, dW) - rule)) <= 2 * state_ulp(y, rule)


@pytest.mark.parametrize("order", TABLEAUX)
def test_explicit_tableaux_integrate_powers(order: int) -> None:
    """Σ b_i c_i^k = 1/(k + 1) for k < order and not for k = order: the quadrature conditions."""
    tableau = TABLEAUX[order]
    c = [sum(row.values()) for row in tableau.A]
    defects = [abs(sum(b * c[i] ** k for i, b in tableau.b.items()) - 1 / (k + 1)) for k in range(order + 1)]
    assert max(defects[:order]) < 1e-14
    assert defects[order] > 1e-6


@pytest.mark.parametrize("scheme", RIVALS, ids=lambda s: s.name)
def test_steps_of_a_batch_are_the_steps_of_its_states(scheme) -> None:
    problem = problems.rigid_body()
    rng = np.random.default_rng(1)
    y = np.asarray(problem.initial)[:, None] + 0.05 * rng.standard_normal((3, 6))
    dW = 0.1 * rng.standard_normal((1, 6))
    together = scheme.step(problem, y, 0.01, dW)
    for k in range(6):
        assert np.array_equal(together[:, k], scheme.step(problem, y[:, k], 0.01, dW[:, k]))
