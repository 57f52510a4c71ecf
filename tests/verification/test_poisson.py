"""Jacobi's identity, the derivative of a step with its bound, and the laws about the structure."""

from dataclasses import replace

import numpy as np
import pytest
from doors import measured, verdicts
from drawn import drawn_systems
from hypothesis import given
from hypothesis import strategies as st
from sepv.properties import test_reduction as reduction
from sepv.properties import test_symplecticity as symplecticity
from sepv.properties import test_volume as volume
from sepv.properties._structures import is_constant, is_poisson

import sepv
from sepv import problems, schemes
from sepv.problem import Array, PolynomialSystem, Problem, Systems, jacobi_defect
from sepv.problem import _poisson as poisson
from sepv.record import _polynomial as poly
from sepv.schemes import Scheme, midpoint
from sepv.verification import Case
from sepv.verification._contraction import contraction_ball

QUICK = {"examples": 10, "shrink_checks": 0}
LAWS = ("symplecticity", "poisson-map", "positivity", "energy")


@given(drawn_systems(Systems.SINGLE, Jacobi=("Poisson",)), st.integers(0, 9))
def test_structures_of_the_strategies_satisfy_jacobis_identity(system: PolynomialSystem, seed: int) -> None:
    problem = problems.build(system)
    y = np.random.default_rng(seed).uniform(-1, 1, system.dimension)
    terms = np.abs(problem.structure(y)).max() * np.abs(problem.structure_derivative(y)).max()
    assert np.abs(jacobi_defect(problem, y)).max() <= 1e-13 * system.dimension * terms
    assert is_poisson(problem, y)
    assert is_poisson(replace(problem, structure_derivative=None, data=None, check=False), y)


def test_a_structure_without_the_identity_is_told() -> None:
    # B_12 = y3 and B_13 = 1: w = (0, −1, y3), w · curl w = 0 · 0 + …; with B_23 = y1 it is not zero.
    x = [poly.variable(3, k) for k in range(3)]
    B = ((0, 1, x[2]), (0, 2, poly.constant(3, 1.0)), (1, 2, x[1]))
    problem = problems.build(PolynomialSystem(3, poly.multiply(x[0], x[0]), B))
    y = np.array([0.5, 1.0, 2.0])
    # By hand: Σ over cycles of Σ_l B_il ∂_lB_jk = B_12 ∂_2B_23 + B_32 ∂_2B_12 + B_23 ∂_3B_12 … = y3 + B_33·1 = y3 here.
    w, curl = np.array([y[1], -1.0, y[2]]), np.array([0.0, 0.0, -1.0])
    assert np.abs(jacobi_defect(problem, y)).max() == pytest.approx(abs(w @ curl))
    assert not is_poisson(problem, y)


def test_a_condition_on_b_that_holds_at_one_state_alone_is_not_taken_for_it() -> None:
    """With y1 = 0: B_12 = 1 + y1² y2 is not constant, and its flow changes volume elsewhere."""
    B = ((0, 1, poly.polynomial(2, {(0, 0): 1.0, (2, 1): 1.0})),)
    system = PolynomialSystem(2, poly.polynomial(2, {(0, 1): 1.0, (2, 0): 1.0}), B, (2.0,))
    case = Case(system, (0.0, -0.5), 0.125, (0.25,))
    problem, y, _, _ = case.build()
    assert not np.any(problem.structure_derivative(y))
    assert not is_constant(problem, y)
    assert symplecticity.constant(case) is volume.volume_kept(case) is None
    quiet = reduction.reduced(case)
    assert quiet is not None
    assert quiet.problem.noise == (0.0,)
    # B_12 = y1, B_13 = B_23 = 0 but for y3 y1: Jacobi's identity is y1² = 0.
    x = [poly.variable(3, k) for k in range(3)]
    B = ((0, 1, x[0]), (0, 2, poly.multiply(x[0], x[2])), (1, 2, x[0]))
    broken = problems.build(PolynomialSystem(3, poly.multiply(x[0], x[0]), B))
    for first in (0.0, 0.5):
        assert not is_poisson(broken, np.array([first, 1.0, 2.0]))


@given(st.integers(0, 99))
def test_the_derivative_of_a_step_is_within_its_bound(seed: int) -> None:
    # Against the exact derivative of the midpoint rule: (I − ½ΔS)⁻¹(I + ½ΔS), S the slope of the field at the middle.
    rng = np.random.default_rng(seed)
    problem = problems.build(
        PolynomialSystem(2, poly.polynomial(2, {(2, 0): 0.5, (0, 2): 0.5, (3, 0): 0.5, (1, 2): -0.25}),
                         ((0, 1, poly.constant(2, -1.0)),), ())
    )  # fmt: skip
    y = rng.uniform(-1, 1, 2)
    radius, ball = contraction_ball(problem, y)
    h, rho = radius / 2, ball / 2
    widths = np.full(2, 2.0 ** np.floor(np.log2(poisson.WIDTH * rho)))
    states = poisson.shifted(y, widths)
    answers = midpoint.step(problem, states, h, np.zeros((0, states.shape[1])))
    D, fourth = poisson.derivative(answers, widths)
    J = np.array([[0.0, -1.0], [1.0, 0.0]])
    assert problem.hessian is not None
    S = 0.5 * h * J @ problem.hessian((y + answers[:, 0]) / 2)
    exact = np.linalg.solve(np.eye(2) - S, np.eye(2) + S)
    bound = poisson.TRUNCATION * (widths[0] / rho) ** 6 + poisson.ROUNDING * 8e-16 / widths[0]
    assert np.abs(D - exact).max() <= bound
    # That of order four errs by more.
    assert np.all(np.abs(D - exact) <= fourth + bound)


def _moved(step: sepv.schemes._scheme.Step, by: float) -> sepv.schemes._scheme.Step:
    return lambda problem, y, h, dW: step(problem, y, h, dW) + by


def test_structure_and_energy_are_different_laws() -> None:
    # A translation is symplectic, and keeps no energy. (2.1) keeps the energy, and is not symplectic.
    moved = replace(midpoint, step=_moved(midpoint.step, 2.0**-20), solve=None)
    asked = verdicts(moved, "symplecticity,energy,casimir", **QUICK)
    assert asked == {"symplecticity": "holds", "energy": "violated", "casimir": "violated"}
    asked = verdicts("energy-preserving", "energy,poisson-map,symplecticity", **QUICK)
    assert asked == {"energy": "holds", "poisson-map": "violated", "symplecticity": "violated"}


def test_a_solver_of_few_digits_is_not_accused_for_it() -> None:
    # Fixed-point iteration that stops at 1e-9, and says so.
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        delta, z = problem.random_step(h, dW), np.zeros_like(y)
        for _ in range(200):
            middle, before = y + z / 2, z
            z = delta * (problem.structure(middle) @ problem.gradient(middle))
            if np.max(np.abs(z - before)) <= 1e-9 * np.max(np.abs(y)):
                return y + z
        raise ArithmeticError("no convergence")

    rough = Scheme("rough", step, claims=["symplecticity"], solver_tolerance=1e-9)
    assert verdicts(rough, "symplecticity", **QUICK) == {"symplecticity": "holds"}
    silent = replace(rough, solver_tolerance=0.0)
    assert verdicts(silent, "symplecticity", **QUICK) == {"symplecticity": "violated"}


def test_problems_without_the_identity_are_not_asked_about() -> None:
    report = measured("midpoint", "symplecticity,positivity", "rigid-body", **QUICK)
    assert "B of the problems is not constant" in report.finding("symplecticity").message
    assert "no domain" in report.finding("positivity").message


def test_stormer_verlet_is_symplectic_on_the_systems_that_it_is_for() -> None:
    expected = ("holds", "holds", "not applicable", "violated")
    assert verdicts(schemes.leapfrog, LAWS, **QUICK) == dict(zip(LAWS, expected, strict=True))


def test_compositions_whose_substeps_leave_the_step_are_not_accused() -> None:
    """Shares of 4.4 |Δ| in all make the disc of Cauchy's estimate smaller than assumed: H. Yoshida (1990).

    The bound has room for that: defects are below a twentieth of it.
    """
    found = measured("yoshida-4", "symplecticity").finding("symplecticity")
    assert found.verdict.text == "holds"
    assert found.defect < found.bound / 20
