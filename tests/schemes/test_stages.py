"""How the stages of collocation are solved: where the iteration starts, what it costs, which quadrature it trusts."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sepv.reference import hard

import sepv
from sepv import problems, schemes
from sepv.schemes._collocation import _Stages, solve_stages
from sepv.schemes._tableaux import exact_nodes
from sepv.solve import Status
from sepv.solve._solution import Equations

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
