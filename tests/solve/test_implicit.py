"""The implicit solve: what it reports when it converges, and when it cannot."""

from dataclasses import replace

import numpy as np
import pytest
from drawn import J
from hypothesis import given

import sepv
from sepv import problems, schemes
from sepv.problem import Problem
from sepv.schemes._energy_preserving import step as preserving
from sepv.solve import Status
from sepv.verification import Case, strategies

increment = preserving.increment

IMPLICIT = [s for s in schemes.PAPER.values() if s.solve is not None]


def stripped(problem: Problem, *keys: str) -> Problem:
    """The problem without what a user may leave out."""
    return replace(problem, **dict.fromkeys(keys, None), check=False)


@given(strategies.any_steps())
def test_residual_is_that_of_the_value_returned_and_at_rounding(case: Case) -> None:
    problem, y, h, dW = case.build()
    solution = schemes.energy_preserving.solve(problem, y, h, dW)
    assert solution.status[0] == Status.CONVERGED
    from sepv.verification import step_residual

    delta = problem.random_step(h, dW[:, None])[None]
    y1 = solution.value
    residual = y1 - y[:, None] - increment(problem, y[:, None], y1, delta).value
    allowed = step_residual(problem, y, y1[:, 0], h, dW)
    assert np.all(np.abs(residual[:, 0]) <= allowed)
    assert solution.residual[0] <= allowed.max()
    assert 1 <= solution.iterations[0] <= 12
    assert solution.gradient_evaluations[0] >= solution.iterations[0] == solution.structure_evaluations[0]


@pytest.mark.parametrize("scheme", IMPLICIT, ids=lambda s: s.name)
@given(case=strategies.steps())
def test_problems_without_derivatives_or_degree_give_the_same_step(scheme: sepv.Scheme, case: Case) -> None:
    problem, y, h, dW = case.build()
    plain = stripped(problem, "hessian", "structure_derivative", "degree", "data")
    full, bare = (scheme.solve(p, y, h, dW) for p in (problem, plain))
    assert full.status[0] == bare.status[0] == Status.CONVERGED
    from sepv.verification import step_residual

    # Two solutions of one equation, each with a residual at rounding; the contraction factor is ≤ 1/4.
    allowed = 2 * 4 / 3 * step_residual(problem, y, full.value[:, 0], h, dW).max()
    assert np.max(np.abs(full.value - bare.value)) <= allowed


@given(case=strategies.any_steps())
def test_bits_do_not_depend_on_the_batch(case: Case) -> None:
    """Of the scheme of which the law *reproducibility* asks this in deep runs alone."""
    (problem, y, h, dW), scheme = case.build(), schemes.discrete_gradient
    lanes = 5
    factors = 1 - np.arange(lanes) / 16
    batch = scheme.solve(problem, y[:, None] * factors, h, np.repeat(dW[:, None], lanes, axis=1))
    for k, factor in enumerate(factors):
        alone = scheme.solve(problem, y * factor, h, dW)
        assert np.array_equal(alone.value[:, 0], batch.value[:, k])
        assert alone.iterations[0] == batch.iterations[k]


def test_a_gradient_too_rough_for_quadrature_is_reported() -> None:
    def kink(y: np.ndarray) -> np.ndarray:
        return np.stack([np.sign(y[0] - 0.123) + y[0], y[1]])

    keys = ("mean_gradient", "degree", "hessian", "structure_derivative")
    problem = replace(stripped(problems.harmonic_oscillator(), *keys), gradient=kink, check=False)
    with pytest.raises(sepv.StepFailure, match="quadrature"):
        schemes.energy_preserving.step(problem, np.array([0.1, -1.0]), 0.5, np.array([0.1]))


def test_a_step_without_solution_says_so() -> None:
    problem = problems.lotka_volterra()
    y = np.asarray(problem.initial)
    for delta in (2.0, -1.0):  # no solution was ever found there
        with pytest.raises(sepv.StepFailure, match="Remedy") as caught:
            schemes.energy_preserving.step(problem, y, 0.5, np.array([(delta - 0.5) / 0.5]))
        failure = caught.value
        assert failure.problem == "lotka-volterra"
        assert failure.delta == pytest.approx(delta)
        assert failure.y.tolist() == [1.0, 1.9, 0.5]
        assert failure.iterations >= 1
        assert failure.residual > 1e-9


def test_a_state_at_rest_stays_where_the_jacobian_is_singular() -> None:
    """H = y1 y2 has a saddle at the origin; at Δ = 2 the Jacobian of (3.4) and (2.1) there is singular."""
    data = problems.from_json(
        {"dimension": 2, "hamiltonian": [[[1, 1], 1.0]], "structure": [[0, 1, [[[0, 0], 1.0]]]]}
    )
    problem = problems.polynomial_problem(data)
    for scheme in IMPLICIT:
        assert scheme.step(problem, np.zeros(2), 1.0, np.array([1.0])).tolist() == [0.0, 0.0]


@pytest.mark.parametrize("name", ["midpoint", "energy-preserving", "discrete-gradient"])
def test_a_domain_in_which_h_goes_on_beyond_is_left_by_name(name: str) -> None:
    """A rotation by Δ ≈ ½ from (1, 1) takes q to 1.36, where H is defined too: `domain` alone ends it at 1.2."""
    H = lambda y: 0.5 * (y[0] ** 2 + y[1] ** 2)  # noqa: E731
    problem = Problem(2, J, H, domain=lambda y: y[1] < 1.2, initial=(1.0, 1.0))
    y, dW = np.array([[1.0, 1.0, 0.1], [1.0, 1.0, -0.5]]), np.array([[0.4, 0.0, 0.4]])
    solve = schemes.by_name(name).solve
    assert solve is not None
    expected = [Status.LEFT_DOMAIN, Status.CONVERGED, Status.CONVERGED]
    found = solve(problem, y, 0.1, dW)
    assert found.status.tolist() == expected
    assert np.all(found.value[1] < 1.2)
    assert [solve(problem, y[:, k], 0.1, dW[:, k]).status[0] for k in range(3)] == expected
    everywhere = solve(replace(problem, domain=None, check=False), y, 0.1, dW)
    assert everywhere.status.tolist() == [Status.CONVERGED] * 3
    assert everywhere.value[1, 0] > 1.2
