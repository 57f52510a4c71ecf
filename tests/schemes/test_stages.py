"""How the stages of collocation are solved: where the iteration starts, what it costs, which quadrature it trusts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import sepv
from sepv import problems, schemes
from sepv.problem import PolynomialSystem
from sepv.problem._fields import linear_solve
from sepv.problems import hard
from sepv.record import _polynomial as poly
from sepv.record._binary64 import EPS
from sepv.schemes._collocation import _Stages, solve_stages
from sepv.schemes._tableaux import exact_nodes, gauss_tableau, moments
from sepv.solve import Status
from sepv.solve._solution import Equations

STAGES = range(1, 7)
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


@pytest.mark.parametrize("s", [1, 2, 3])
def test_the_iteration_starts_with_newtons_first_step(s: int) -> None:
    """(I − ∂R/∂z) z = R at z = 0, where one evaluation serves all stages, also where f = (0, 0, f₃)."""
    y0 = np.array([[0.8, 0.5, -0.4], [0.6, 0.0, 0.9], [0.1, 0.0, 0.2]])
    y0[:, 1] = [0.5, 0.5, 0.0]
    stages, equations = system(problems.rigid_body(), s, y0, np.array([0.3, 0.2, -0.5]))
    nothing = np.zeros((3 * s, 3))
    right, jacobian = stages.evaluate(nothing, LANES)
    matrix = np.eye(3 * s)[..., None] - jacobian()[0]
    first = linear_solve(matrix, right.value)
    # The same system with entries from other sums: backward errors of some eps in each of its n unknowns.
    condition = np.linalg.cond(np.moveaxis(matrix, -1, 0))
    apart = np.max(np.abs(stages.start(equations) - first), axis=0)
    assert np.all(apart <= 4 * 3 * s * EPS * condition * np.max(np.abs(first), axis=0))
    assert (
        np.abs(first[:, 1]).max() > 1e-3
    )  # f₃ = (1/0.345 − 1/0.653)/4 = 0.34, times Δ = 0.2, in stages of 1/s


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


def test_a_start_stays_inside_the_domain_or_at_the_state() -> None:
    """Lotka-Volterra: a long first step is cut; from outside there is no step at all."""
    problem = problems.lotka_volterra()
    y0 = np.array([[1.0, 1.0, -1.0], [1.9, 1.9, 1.9], [0.5, 0.5, 0.5]])
    stages, equations = system(problem, 2, y0, np.array([0.01, 3.0, 0.01]))
    z = stages.start(equations)
    assert stages.inside(z, LANES).tolist() == [True, True, False]
    assert z[:, 0].any()
    assert z[:, 1].any()
    assert not z[:, 2].any()


def test_every_point_of_the_quadrature_must_lie_inside() -> None:
    """The polynomial dips out of y > 0 between its ends: u = 1 at both, below 0 in the middle."""
    problem = canonical(lambda y: y, domain=lambda y: y[0] > 0)
    y0 = np.ones((2, 3))
    stages, _ = system(problem, 2, y0, np.full(3, 0.1))
    z = np.zeros((2, 2, 3))
    z[0, :, 1] = [-6.0, 6.0]
    z[0, :, 2] = [-1.0, 1.0]
    assert stages.inside(z.reshape(4, 3), LANES).tolist() == [True, False, True]
    # A domain may answer in numbers.
    counted = replace(problem, domain=lambda y: 1.0 * (y[0] > 0), check=False)
    y, dW = np.array([1.0, 0.2]), np.array([0.4])
    ends = [schemes.collocation(2).solve(p, y, 0.1, dW) for p in (problem, counted)]
    assert ends[0].status.tolist() == ends[1].status.tolist() == [Status.CONVERGED]
    assert np.array_equal(ends[0].value, ends[1].value)


def test_the_size_of_the_terms_of_an_average_is_that_of_its_lane() -> None:
    """max|∇H| along u times max_i Σ_n |w_n ℓ_i(τ_n)|/b_i: what the rounding of the sum is relative to."""
    stages, _ = system(
        problems.harmonic_oscillator(), 3, np.array([[1.0, 0.0, 5.0], [2.0, -3.0, 0.0]]), np.ones(3)
    )
    weights = np.abs(moments(3, 7)[0]).sum(axis=1)
    assert np.ptp(weights) > 0.1
    means, size = stages.averages(np.zeros((2, 3, 3)), LANES, 7)
    # Seven products and their sum; the mean of a constant is it, to the roundings of the table and of the sum.
    assert np.allclose(size, np.array([2.0, 3.0, 5.0]) * weights.max(), rtol=8 * EPS, atol=0)
    assert np.all(np.abs(means - stages.y0[:, None]) <= 16 * EPS * size)


class Recorded:
    """A gradient that keeps how many points of each lane it was asked about."""

    def __init__(self, gradient: Callable[[np.ndarray], np.ndarray]) -> None:
        self.gradient, self.points = gradient, []

    def __call__(self, y: np.ndarray) -> np.ndarray:
        self.points.append(y.shape[1] if y.ndim == 3 else 1)
        return self.gradient(y)


@pytest.mark.parametrize("s", [2, 4])
def test_a_rule_that_does_not_settle_is_doubled_up_to_128_nodes(s: int) -> None:
    """s + 4 nodes first, each rule compared with one half as large again. ∇H jumps by 2·10⁻⁹: none will do."""
    gradient = Recorded(lambda y: np.stack([y[0] + 1e-9 * np.sign(y[0] - 0.9), y[1]]))
    solution = schemes.collocation(s).solve(canonical(gradient), np.array([1.0, 0.5]), 0.5, np.zeros(1))
    assert solution.status.tolist() == [Status.QUADRATURE]
    rules, n = set(), s + 4
    while n <= 128:
        rules |= {n, n + n // 2}
        n *= 2
    assert {n for n in gradient.points if n > s + 3} == rules


@pytest.mark.parametrize("s", [2, 3])
def test_evaluations_are_those_of_the_rule_and_of_its_check(s: int) -> None:
    """One for the start, s + 4 an iteration, half as many again for the rule that confirms them; B at s stages."""
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
    """Rigid body: f(−y) = f(y), so that −y with −Δ is the mirror image, to the bit. H ↦ λH with Δ ↦ Δ/λ is nothing."""
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
    # From the origin a rounding of y is nothing: what is allowed is the rounding of the sums, relative to ∇H.
    still, step = np.zeros((2, 1)), np.array([2.0**-10])
    one = solve_stages(canonical(lambda y: 3 + np.sin(y + 0.3)), s, still, step)
    assert one.gradient_evaluations[0] == 1 + (s + 4) * (one.iterations[0] - 1) + (s + 4) + (s + 4) // 2
    for unit in (2.0**30, 2.0**-30):
        scaled = canonical(lambda y, unit=unit: unit * (3 + np.sin(y + 0.3)))
        assert np.array_equal(solve_stages(scaled, s, still, step / unit).value, one.value)
        assert solve_stages(scaled, s, still, step / unit).gradient_evaluations == one.gradient_evaluations


def test_newtons_matrix_is_right_on_long_steps_too() -> None:
    """Where H is no polynomial s + 4 nodes average H″: to 10⁻⁷ for a pendulum whose angle moves by 3.

    The remainder is n!⁴/((2n + 1)(2n)!³) = 2·10⁻¹⁶ of a twelfth derivative, which for cos 3τ times polynomials of
    degree 3 is about (3 + 2)¹²: 5·10⁻⁸.
    """
    stages = _Stages(problems.pendulum(), 2, np.array([[0.2], [1.0]]), np.array([0.4]), 6, True)
    z = np.array([0.3, -0.2, 3.0, 3.1])[:, None]
    K, _ = stages.evaluate(z, np.arange(1)).jacobian()
    for k in range(4):
        shift = np.zeros_like(z)
        shift[k] = 2.0**-17
        ahead, behind = (
            stages.averages((z + e).reshape(2, 2, 1), np.arange(1), 40)[0] for e in (shift, -shift)
        )
        slope = 0.4 * np.stack([-(ahead - behind)[1], (ahead - behind)[0]]) / 2.0**-16
        assert np.max(np.abs(K[:, k] - slope.reshape(4, 1))) < 1e-7


@pytest.mark.parametrize(("s", "degree", "nodes"), [(1, 2, 1), (3, 2, 3), (3, 4, 5), (3, 6, 5), (2, 6, 4)])
def test_newtons_matrix_of_a_polynomial_takes_as_many_nodes_as_are_exact_and_no_more_than_two_more_than_stages(
    s: int, degree: int, nodes: int
) -> None:
    H, asked = poly.polynomial(3, {(degree, 0, 0): 0.5, (0, 1, 1): 1.0}), []
    plain = problems.polynomial_problem(PolynomialSystem(3, H, ((0, 1, poly.constant(3, 1.0)),)))

    def hessian(y: np.ndarray) -> np.ndarray:
        asked.append(y.shape[1])
        return plain.hessian(y)

    known = replace(plain, hessian=hessian, check=False)
    stages, _ = system(known, s, 0.1 * np.ones((3, 3)), np.full(3, 0.1))
    stages.evaluate(np.zeros((3 * s, 3)), LANES).jacobian()
    assert asked == [nodes]


@pytest.mark.parametrize("s", STAGES)
def test_gauss_methods_have_newtons_matrix_of_their_own_equations(s: int) -> None:
    """H″ at the stages, also where H is no polynomial: from a good start, four evaluations and no more."""
    y = np.array([[0.2], [1.0]])
    solution = solve_stages(problems.pendulum(), s, y, np.array([0.4]), averaged=False)
    assert solution.status.tolist() == [Status.CONVERGED]
    stages = _Stages(problems.pendulum(), s, y, np.array([0.4]), s, False)
    z = 0.1 * np.cos(np.arange(2.0 * s))[:, None]
    K, _ = stages.evaluate(z, np.arange(1)).jacobian()
    for k in range(2 * s):
        shift = np.zeros_like(z)
        shift[k] = 2.0**-17
        ahead, behind = (stages.evaluate(z + e, np.arange(1)).right_side.value for e in (shift, -shift))
        # Differences over 2⁻¹⁶: their error 2⁻³⁴|R‴|/6 and some roundings of R ≤ 1 times 2¹⁶, each about 10⁻¹¹.
        assert np.allclose(K[:, k], (ahead - behind) / 2.0**-16, rtol=0, atol=1e-10)
    assert stages.evaluate(z, np.arange(1)).right_side.gradients.tolist() == [s]
    # The c_i are rounded once, and so is each of the s entries, whose absolute values add up to 1.3 at most.
    assert np.allclose(stages.A.sum(axis=1), gauss_tableau(s).c, rtol=0, atol=2 * EPS)


@pytest.mark.parametrize("name", ["toda-steep", "lotka-volterra-coarse"])
def test_steps_that_overflow_or_leave_the_domain_say_so_without_a_warning(name: str) -> None:
    case, seen = hard.by_name(name), set()
    y, h, dW = case.sample(np.random.default_rng(0), 24)
    for scheme in (schemes.collocation(2), schemes.gauss(2)):
        solution = scheme.solve(case.problem, y, h, dW)
        fine = solution.status == Status.CONVERGED
        assert np.all(np.isfinite(solution.value[:, fine]))
        seen |= set(solution.status.tolist())
    nowhere = scheme.solve(problems.lotka_volterra(), np.array([1.0, 0.0, 0.5]), 0.01, np.zeros(1))
    assert nowhere.status.tolist() == [Status.OVERFLOW]  # a division by zero
    assert {Status.CONVERGED, Status.OVERFLOW if name == "toda-steep" else Status.LEFT_DOMAIN} <= seen


def test_a_collocation_method_claims_what_the_paper_proves_of_its_one_stage() -> None:
    for s in STAGES:
        assert {"energy", "casimir", "symmetry", "midpoint", "truncation"} <= schemes.collocation(s).claims
        assert "Cohen and Hairer" in schemes.collocation(s).source
