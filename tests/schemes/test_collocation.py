"""Collocation, Gauss and explicit methods of the random step: coefficients, stages,
what they cost and reduce to.
"""

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from typing import Any

import mpmath
import numpy as np
import pytest
from doors import says
from drawn import by_hand
from hypothesis import given
from hypothesis import strategies as st
from sepv.reference.arithmetic import decimal
from sepv.reference.steps import reference_step
from sepv.reference.tableau import stage_table

import sepv
from sepv import StepFailure, exact_flow, hard_cases, problems, schemes
from sepv.core.equations import Equations
from sepv.core.newton import Status
from sepv.law import strategies
from sepv.record import EPS, gauss_legendre
from sepv.schemes._collocation import _Stages, solve_stages
from sepv.schemes._explicit_tableaux import TABLEAUX
from sepv.schemes._tableaux import amplification, exact_nodes, gauss_tableau, lagrange, moments
from sepv.verification import Case, state_ulp

STAGES = range(1, 7)


@pytest.mark.parametrize("s", STAGES)
def test_coefficients_are_right_to_two_roundings(s: int) -> None:
    table = stage_table(s, decimal(40))
    order = sorted(range(s), key=lambda i: table.c[i])
    A, b = [[table.a[i][j] for j in order] for i in order], [table.b[i] for i in order]
    found = gauss_tableau(s)
    for i in range(s):
        assert abs(float(b[i] - mpmath.mpf(float(found.b[i])))) <= EPS * found.b[i]
        for j in range(s):
            assert abs(float(A[i][j] - mpmath.mpf(float(found.A[i, j])))) <= EPS


@pytest.mark.parametrize("s", STAGES)
def test_averages_are_exact_up_to_the_degree_that_is_promised_and_not_beyond(s: int) -> None:
    """b_i⁻¹∫ℓ_i g for g of degree s(ν − 1), as ∇H∘u has, against twice as many nodes."""
    for degree in range(1, 7):
        n, power = exact_nodes(s, degree), s * (degree - 1)

        def averages(nodes: int, power: int = power) -> np.ndarray:
            return moments(s, nodes)[0] @ (2 * gauss_legendre(nodes)[0] - 0.75) ** power

        exact = averages(2 * n + s)
        # A node rounded by EPS/2 changes a power by 2·power·EPS/2; weights and sums a little more.
        size = 1.25**power
        assert np.max(np.abs(averages(n) - exact)) < (2 * power + 40) * EPS * size
        if n > s:  # with fewer nodes than stages even ℓ_i is not resolved
            assert np.max(np.abs(averages(n - 1) - exact)) > 1e-9


def test_what_averages_may_amplify_is_the_integral_of_a_lagrange_polynomial() -> None:
    """The largest b_i⁻¹∫|ℓ_i|, by 64 nodes about kinks: an error of some 64⁻²."""
    assert amplification(1) == pytest.approx(1.0, rel=1e-15)
    tau = (np.arange(100_000) + 0.5) / 100_000
    for s in STAGES:
        means = np.mean(np.abs(lagrange(s, tau)), axis=1) / gauss_tableau(s).b
        assert amplification(s) == pytest.approx(means.max(), rel=4e-3)


@given(strategies.steps(strategies.poisson_systems(degree=4, largest=4)), st.sampled_from(STAGES))
def test_newton_needs_no_derivatives_of_the_problem(case: Case, s: int) -> None:
    problem, y, h, dW = case.build()
    plain = replace(problem, hessian=None, structure_derivative=None, check=False)
    exact = np.array(reference_step(f"collocation-{s}", case.problem, case.y, h, case.dW, 30).y1, dtype=float)
    found = schemes.collocation(s).step(plain, y, h, dW)
    assert np.max(np.abs(found - exact)) <= 4 * state_ulp(y, exact)


@pytest.mark.parametrize("s", [2, 3, 6])
def test_energies_that_are_no_polynomials_are_kept_at_large_steps(s: int) -> None:
    """Adaptive quadrature: a fixed rule of eight nodes leaves 1e-5 in a logarithmic energy."""
    for name, h, allowed in (("pendulum", 0.25, 8), ("lotka-volterra", 2.0**-6, 40)):
        problem = problems.by_name(name)
        ends = sepv.ensemble(schemes.collocation(s), problem, h=h, T=1.0, paths=64, seed=3, engine="numpy")
        fine = ends.status == Status.CONVERGED
        assert fine.sum() >= 60
        assert ends.energy_defect[fine].max() <= allowed * EPS * np.sqrt(1 / h) * 4


def test_what_no_quadrature_resolves_is_reported_and_not_returned() -> None:
    """H = |y1| + …: the averages of its gradient never settle where the path crosses the kink."""
    problem = by_hand(
        hamiltonian=lambda y: abs(y[0]) + 0.5 * y[1] * y[1], gradient=lambda y: np.stack([np.sign(y[0]), y[1]]),
        noise=1.0, check=False,
    )  # fmt: skip
    with pytest.raises(StepFailure, match="not solved"):
        schemes.collocation(2).step(problem, np.array([0.1, 1.0]), 0.5, np.array([0.0]))


@pytest.mark.parametrize("s", STAGES)
def test_a_family_member_counts_its_work(s: int) -> None:
    """Rigid body: s nodes and s structures an iteration, and one of each for the start,
    which is an iteration.
    """
    for scheme in (schemes.collocation(s), schemes.gauss(s)):
        y = np.array([[0.8, 0.8, 1.0], [0.6, 0.1, 0.0], [0.1, 0.6, 0.0]])
        solution = scheme.solve(problems.rigid_body(), y, 0.01, np.array([[0.1, -0.2, 0.3]]))
        assert not solution.status.any()
        counts = solution.iterations - 1
        assert solution.gradient_evaluations.tolist() == (s * counts + 1).tolist()
        assert solution.structure_evaluations.tolist() == (s * counts + 1).tolist()
        assert np.array_equal(solution.value[:, 2], y[:, 2])  # at rest


def test_two_stages_keep_quadratic_invariants_by_their_rounded_coefficients() -> None:
    """b_i a_ij + b_j a_ji = b_i b_j exactly: rounded each by itself they moved H by 0.17 roundings
    a step.
    """
    A, b = ([[Fraction(v) for v in row] for row in np.atleast_2d(a).tolist()]
            for a in (gauss_tableau(2).A, gauss_tableau(2).b))  # fmt: skip
    assert all(b[0][i] * A[i][j] + b[0][j] * A[j][i] == b[0][i] * b[0][j] for i in (0, 1) for j in (0, 1))
    assert np.array_equal(moments(2, 2)[0], np.eye(2))
    own = replace(schemes.collocation(2), problems=(problems.harmonic_oscillator(),))
    says(own, "rounding", "holds")


LANES = np.arange(3)


def canonical(gradient: Callable[[np.ndarray], np.ndarray], **known: Any) -> sepv.Problem:
    """y′ = J∇H in the plane, one noise with c = 1."""
    return replace(
        problems.harmonic_oscillator(), gradient=gradient, hessian=None, mean_gradient=None, degree=None, data=None,
        check=False, **known,
    )  # fmt: skip


def system(problem: sepv.Problem, s: int, y0: np.ndarray, delta: np.ndarray) -> tuple[_Stages, Equations]:
    stages = _Stages(problem, s, y0, delta, exact_nodes(s, problem.degree or 4), True)
    size = np.repeat(np.abs(y0)[:, None], s, axis=1).reshape(-1, y0.shape[1])
    return stages, Equations(size, stages.evaluate, stages.inside if problem.domain else None)


def test_a_lane_whose_first_step_is_no_number_starts_from_rest_and_no_other_does() -> None:
    """∇H infinite in the first lane, a state at rest in the third."""
    body = problems.rigid_body()
    wild = replace(body, gradient=lambda y: np.where(y[0] > 5, np.inf, body.gradient(y)), check=False)
    y0 = np.array([[9.0, 0.8, 1.0], [1.0, 0.6, 0.0], [1.0, 0.1, 0.0]])
    delta = np.array([0.1, 0.1, 0.1])
    with np.errstate(all="ignore"):
        stages, equations = system(wild, 2, y0, delta)
        z = stages.start(equations)
        alone, one = system(wild, 2, y0[:, 1:2], delta[1:2])
        assert np.array_equal(z[:, 1:2], alone.start(one))
    assert not z[:, [0, 2]].any()
    assert z[:, 1].all()


def test_every_point_of_the_quadrature_must_lie_inside() -> None:
    """The polynomial dips out of y > 0 between its ends: u = 1 at both, below 0 in the middle."""
    problem = canonical(lambda y: y, domain=lambda y: y[0] > 0)
    y0 = np.ones((2, 3))
    stages, _ = system(problem, 2, y0, np.full(3, 0.1))
    z = np.zeros((2, 2, 3))
    z[0, :, 1] = [-6.0, 6.0]
    z[0, :, 2] = [-1.0, 1.0]
    assert stages.inside(z.reshape(4, 3), LANES).tolist() == [True, False, True]


@pytest.mark.parametrize("s", [2, 3])
def test_evaluations_are_those_of_the_rule_and_of_its_check(s: int) -> None:
    """One for the start, s + 4 an iteration, half as many again for the rule that confirms them;
    B at s stages.
    """
    y, dW = np.asarray(problems.pendulum().initial), np.array([0.01, 0.02])
    solution = schemes.collocation(s).solve(problems.pendulum(), y, 0.01, dW)
    iterations, nodes = int(solution.iterations[0]) - 1, s + 4
    assert 1 < iterations < 6
    assert solution.gradient_evaluations.tolist() == [1 + nodes * iterations + nodes + nodes // 2]
    assert solution.structure_evaluations.tolist() == [1 + s * iterations]
    # The mean of one stage is in closed form, and checked by nothing.
    one = schemes.collocation(1).solve(problems.pendulum(), y, 0.01, dW)
    plain = schemes.energy_preserving.solve(problems.pendulum(), y, 0.01, dW)
    per = plain.gradient_evaluations[0] / plain.iterations[0]
    assert one.gradient_evaluations[0] == 1 + per * (one.iterations[0] - 1)


@pytest.mark.parametrize("s", [1, 2, 3])
def test_increments_are_kept_beside_their_rounded_sums(s: int) -> None:
    """y1 = fl(y0 + Σ b_j z_j): compensated summation adds up what was lost."""
    for scheme in (schemes.collocation(s), schemes.gauss(s)):
        y = np.array([[0.8, 100.0], [0.6, 0.3], [0.1, 0.2]])
        solution = scheme.solve(problems.rigid_body(), y, 1e-3, np.array([[0.01, 0.02]]))
        assert solution.change.shape == y.shape
        assert np.array_equal(y + solution.change, solution.value)
        assert np.any(solution.value - y != solution.change)


@pytest.mark.parametrize("s", [2, 5])
def test_a_step_is_the_same_with_the_signs_of_state_and_time_turned_and_in_any_unit_of_energy(s: int) -> None:
    """Rigid body: f(−y) = f(y), so that −y with −Δ is the mirror image, to the bit.
    H ↦ λH with Δ ↦ Δ/λ is nothing.
    """
    y, body = np.array([0.8, 0.6, 0.1]), problems.rigid_body()
    for delta in (0.7, 1e-3):
        there = solve_stages(body, s, y[:, None], np.array([delta]))
        mirror = solve_stages(body, s, -y[:, None], np.array([-delta]))
        assert np.array_equal(mirror.value, -there.value)
        assert mirror.iterations == there.iterations
    # At q = 10⁸ a rounding of q moves sin q by 10⁻⁸: two rules agree no better, and that is enough.
    pendulum, start = problems.pendulum(), np.array([[0.2, 0.2], [1.0, 1e8]])
    plain = solve_stages(pendulum, s, start, np.full(2, 0.5))
    assert plain.status.tolist() == [Status.CONVERGED] * 2
    for unit in (2.0**30, 2.0**-30):
        scaled = replace(
            pendulum, gradient=lambda y, unit=unit: unit * pendulum.gradient(y),
            hessian=lambda y, unit=unit: unit * pendulum.hessian(y), mean_gradient=None, check=False,
        )  # fmt: skip
        same = solve_stages(scaled, s, start, np.full(2, 0.5 / unit))
        assert np.array_equal(same.value, plain.value)
        assert np.array_equal(same.gradient_evaluations, plain.gradient_evaluations)


@pytest.mark.parametrize("name", ["toda-steep", "lotka-volterra-coarse"])
def test_steps_that_overflow_or_leave_the_domain_say_so_without_a_warning(name: str) -> None:
    case, seen = hard_cases.by_name(name), set()
    y, h, dW = case.sample(np.random.default_rng(0), 24)
    for scheme in (schemes.collocation(2), schemes.gauss(2)):
        solution = scheme.solve(case.problem, y, h, dW)
        fine = solution.status == Status.CONVERGED
        assert np.all(np.isfinite(solution.value[:, fine]))
        seen |= set(solution.status.tolist())
    nowhere = scheme.solve(problems.lotka_volterra(), np.array([1.0, 0.0, 0.5]), 0.01, np.zeros(1))
    assert nowhere.status.tolist() == [Status.OVERFLOW]  # a division by zero
    assert {Status.CONVERGED, Status.OVERFLOW if name == "toda-steep" else Status.LEFT_DOMAIN} <= seen


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
    """Against the exact flow at Δ: the error of a step falls like Δ^{p+1},
    whatever h and ΔW make up Δ.
    """
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
    """Its solver is its step, and neither takes averages: those keep the energy of the pendulum,
    it does not.
    """
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
