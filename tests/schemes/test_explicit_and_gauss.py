"""Explicit and Gauss Runge-Kutta methods with the random step."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sepv.reference.steps import reference_step

from sepv import problems, schemes
from sepv.exact import exact_flow
from sepv.schemes._explicit_tableaux import TABLEAUX
from sepv.verification import Case, state_ulp, strategies


@given(strategies.any_steps(), st.integers(1, 6))
def test_gauss_methods_solve_their_equations(case: Case, s: int) -> None:
    problem, y, h, dW = case.build()
    exact = np.array(reference_step(f"gauss-{s}", case.problem, case.y, h, case.dW, 25).y1, dtype=float)
    assert np.max(np.abs(schemes.gauss(s).step(problem, y, h, dW) - exact)) <= 8 * state_ulp(y, exact)


@pytest.mark.parametrize("order", TABLEAUX)
def test_explicit_tableaux_integrate_powers(order: int) -> None:
    """Σ b_i c_i^k = 1/(k + 1) for k < order and not for k = order: the quadrature conditions."""
    tableau = TABLEAUX[order]
    c = [sum(row.values()) for row in tableau.A]
    defects = [abs(sum(b * c[i] ** k for i, b in tableau.b.items()) - 1 / (k + 1)) for k in range(order + 1)]
    assert max(defects[:order]) < 1e-14
    assert defects[order] > 1e-6


@pytest.mark.parametrize("order", TABLEAUX)
def test_an_explicit_method_has_its_order_in_the_random_step(order: int) -> None:
    """Against the exact flow at Δ: the error of a step falls like Δ^{p+1}, whatever h and ΔW make up Δ."""
    scheme, problem = schemes.explicit(order), problems.pendulum()
    states, errors = 1.2 * np.random.default_rng(0).standard_normal((2, 8)), []
    for delta in (0.5, 0.25):
        exact = np.stack([exact_flow(problem, delta, y).y for y in states.T], axis=1)
        for h, dW in ((delta, (0.0, 0.0)), (0.1, (delta - 0.1, 0.0)), (0.1, (0.3, 2 * (delta - 0.4)))):
            off = scheme.step(problem, states, h, np.repeat(np.array(dW)[:, None], 8, axis=1)) - exact
            errors.append(float(np.sqrt(np.mean(off**2))))
        assert np.ptp(errors[-3:]) < 1e-15
    # Next to Δ^{p+1} stands Δ^{p+2} with a constant of the same size.
    assert abs(np.log2(errors[0] / errors[-1]) - (order + 1)) < 0.4


@pytest.mark.parametrize("s", range(1, 7))
def test_a_gauss_method_keeps_quadratic_invariants_and_no_other_energy(s: int) -> None:
    """Its solver is its step, and neither takes averages: those keep the energy of the pendulum, it does not."""
    scheme, problem = schemes.gauss(s), problems.pendulum()
    y, dW = np.array([0.2, 2.0]), np.array([0.5, 0.2])
    y1 = scheme.step(problem, y, 0.4, dW)
    assert np.array_equal(scheme.solve(problem, y, 0.4, dW).value[:, 0], y1)
    drift = abs(problem.hamiltonian(y1) - problem.hamiltonian(y))
    # One step with Δ = 1: of the order of Δ^{2s+1}, far above rounding for all s here.
    assert 1e-12 < drift < 0.1
    averaged = schemes.collocation(s).step(problem, y, 0.4, dW)
    assert abs(problem.hamiltonian(averaged) - problem.hamiltonian(y)) < 1e-14
    body, state = problems.rigid_body(), np.array([0.8, 0.6, 0.3])
    turned = scheme.step(body, state, 0.4, np.array([0.2]))
    assert abs(turned @ turned - state @ state) < 1e-14
    assert abs(body.hamiltonian(turned) - body.hamiltonian(state)) < 1e-14
