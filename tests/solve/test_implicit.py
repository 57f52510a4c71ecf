"""The implicit solve: what it reports when it converges, and when it cannot."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given

import sepv
from sepv import problems, schemes
from sepv.problem import PolynomialSystem, Problem, average_gradient
from sepv.problem._fields import linear_solve, matvec
from sepv.record import PolynomialMap, gauss_legendre
from sepv.record import _polynomial as poly
from sepv.record._polynomial import majorant
from sepv.schemes._energy_preserving import jacobian
from sepv.schemes._energy_preserving import step as preserving
from sepv.solve import Status
from sepv.solve import _newton as implicit
from sepv.solve._newton import iterate
from sepv.solve._solution import Equations, Solution
from sepv.verification import Case, strategies

increment = preserving.increment

EPS = 2.0**-52
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


@pytest.mark.parametrize("scheme", IMPLICIT, ids=lambda s: s.name)
@given(case=strategies.any_steps())
def test_bits_do_not_depend_on_the_batch(scheme: sepv.Scheme, case: Case) -> None:
    problem, y, h, dW = case.build()
    lanes = 5
    factors = 1 - np.arange(lanes) / 16
    batch = scheme.solve(problem, y[:, None] * factors, h, np.repeat(dW[:, None], lanes, axis=1))
    for k, factor in enumerate(factors):
        alone = scheme.solve(problem, y * factor, h, dW)
        assert np.array_equal(alone.value[:, 0], batch.value[:, k])
        assert alone.iterations[0] == batch.iterations[k]


@pytest.mark.parametrize("scheme", [schemes.energy_preserving, schemes.midpoint], ids=lambda s: s.name)
def test_one_lane_reports_what_it_reports_in_a_batch_also_where_it_fails(scheme: sepv.Scheme) -> None:
    fields = ("value", "residual", "iterations", "gradient_evaluations", "structure_evaluations", "status")
    ended = set()
    for name in ("pendulum", "lotka-volterra", "rigid-body"):
        whole = problems.by_name(name)
        bare = stripped(whole, "hessian", "structure_derivative", "degree", "mean_gradient")
        for problem in (whole, bare):
            y = np.outer(np.asarray(whole.initial), (1.0, 1e-3, 1e3))
            for h in (0.25, 2.0, 1e300):
                batch = scheme.solve(problem, y, h, np.zeros((problem.noises, 3)))
                for k in range(3):
                    alone = scheme.solve(problem, y[:, k], h, np.zeros(problem.noises))
                    for field in fields:
                        one, many = getattr(alone, field)[..., 0], getattr(batch, field)[..., k]
                        assert np.array_equal(one, many, equal_nan=True), (name, h, k, field)
                    ended.add(Status(int(alone.status[0])))
    assert len(ended) >= 3, ended


@pytest.mark.parametrize("name", ["pendulum", "lotka-volterra"])
def test_adaptive_quadrature_reaches_the_closed_form(name: str) -> None:
    problem = problems.by_name(name)
    y = np.asarray(problem.initial)[:, None] * np.linspace(0.9, 1.1, 7)
    for spread in (0.0, 1e-12, 1e-3, 0.3):
        y1 = y * (1 + spread)
        closed = average_gradient(problem, y, y1)
        found = average_gradient(stripped(problem, "mean_gradient"), y, y1)
        assert found.reliable.all()
        # Every component has size ≤ 10; both carry a few roundings, the rule one a node.
        assert np.max(np.abs(found.value - closed.value)) < 1e-13
        assert np.all(np.abs(found.value - closed.value).max(axis=0) <= found.error + 1e-14)


def test_a_gradient_too_rough_for_quadrature_is_reported() -> None:
    def kink(y: np.ndarray) -> np.ndarray:
        return np.stack([np.sign(y[0] - 0.123) + y[0], y[1]])

    problem = replace(
        problems.harmonic_oscillator(),
        mean_gradient=None, degree=None, hessian=None, structure_derivative=None, gradient=kink, check=False,
    )  # fmt: skip
    mean = average_gradient(problem, np.array([[0.0], [0.0]]), np.array([[1.0], [0.0]]))
    assert not mean.reliable[0]
    assert mean.error[0] > 1e-6
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


def broken_after(limit: float) -> Problem:
    """An oscillator whose gradient is NaN for |y| ≥ limit."""
    base = problems.harmonic_oscillator()

    def gradient(y: np.ndarray) -> np.ndarray:
        return np.where(np.abs(y) < limit, y, np.nan)

    return replace(
        base, gradient=gradient, mean_gradient=None, hessian=None, structure_derivative=None, check=False
    )


def test_overflow_and_nan_are_a_status() -> None:
    solution = schemes.energy_preserving.solve(broken_after(1.05), np.array([1.0, 1.0]), 0.5, np.array([0.0]))
    assert solution.status[0] == Status.OVERFLOW
    healthy = schemes.energy_preserving.solve(broken_after(9.0), np.array([1.0, 1.0]), 0.5, np.array([0.0]))
    assert healthy.status[0] == Status.CONVERGED


def test_a_singular_jacobian_is_a_status() -> None:
    def hyperbolic(y: np.ndarray) -> np.ndarray:
        return np.stack([y[1], y[0]])

    base = problems.harmonic_oscillator()
    # H = y1 y2: the midpoint equation is (1 ∓ Δ/2) y1 = (1 ± Δ/2) y0, singular at Δ = 2.
    problem = replace(
        base,
        hamiltonian=lambda y: y[0] * y[1], gradient=hyperbolic, mean_gradient=None,
        hessian=lambda y: np.array([[0 * y[0], 1 + 0 * y[0]], [1 + 0 * y[0], 0 * y[0]]]), check=False,
    )  # fmt: skip
    solution = schemes.midpoint.solve(problem, np.array([1.0, 1.0]), 2.0, np.array([0.0]))
    assert solution.status[0] == Status.SINGULAR
    with pytest.raises(sepv.StepFailure, match="singular"):
        schemes.midpoint.step(problem, np.array([1.0, 1.0]), 2.0, np.array([0.0]))


def test_one_failing_lane_leaves_the_others_alone() -> None:
    problem = problems.lotka_volterra()
    y = np.repeat(np.asarray(problem.initial)[:, None], 3, axis=1)
    dW = np.array([[0.01, 3.0, -0.01]])
    solution = schemes.energy_preserving.solve(problem, y, 0.01, dW)
    assert (solution.status == Status.CONVERGED).tolist() == [True, False, True]
    alone = schemes.energy_preserving.step(problem, y[:, 2], 0.01, dW[:, 2])
    assert np.array_equal(solution.value[:, 2], alone)


@pytest.mark.parametrize("d", [1, 2, 3, 4, 7])
def test_linear_solve_solves(d: int) -> None:
    rng = np.random.default_rng(d)
    A = np.eye(d)[..., None] + 0.2 * rng.standard_normal((d, d, 11))
    x = rng.standard_normal((d, 11))
    b = np.einsum("ijm,jm->im", A, x)
    assert np.max(np.abs(linear_solve(A, b) - x)) < 1e-12
    A[:, :, 4] = 0.0
    with np.errstate(all="ignore"):
        y = linear_solve(A, b)
    assert not np.isfinite(y[:, 4]).any()
    assert np.isfinite(np.delete(y, 4, axis=1)).all()


@pytest.mark.parametrize("nodes", range(1, 8))
def test_gauss_legendre_is_exact_to_degree_2n_minus_1(nodes: int) -> None:
    points, weights = gauss_legendre(nodes)
    for degree in range(2 * nodes):
        assert weights @ points**degree == pytest.approx(1 / (degree + 1), rel=1e-15 * (degree + 2))
    assert abs(weights @ points ** (2 * nodes) - 1 / (2 * nodes + 1)) > 1e-12


@pytest.mark.parametrize(
    "wrong",
    [
        {"y": np.array([1.0, 2.0])},
        {"y": np.array([1.0, np.nan, 0.0])},
        {"y": np.zeros((3, 2, 2))},
        {"dW": np.array([])},
        {"dW": np.array([0.1, 0.1])},
        {"dW": np.array([np.inf])},
        {"h": float("nan")},
        {"h": np.array([0.1, 0.2])},
    ],
)
@pytest.mark.parametrize("scheme", schemes.PAPER.values(), ids=lambda s: s.name)
def test_arguments_that_do_not_fit_the_problem_are_refused(
    scheme: sepv.Scheme, wrong: dict[str, Any]
) -> None:
    arguments = {"y": np.array([0.8, 0.6, 0.0]), "h": 0.01, "dW": np.array([0.1]), **wrong}
    with pytest.raises(sepv.UsageError, match="Expected"):
        scheme.step(problems.rigid_body(), arguments["y"], arguments["h"], arguments["dW"])


def test_a_component_near_zero_does_not_stop_the_iteration_early() -> None:
    """Found by the law of symmetry: y3 stays at rounding about zero while y1 and y2 still move."""
    data = problems.from_json(
        {
            "dimension": 3,
            "hamiltonian": [[[2, 0, 0], 0.5], [[0, 2, 0], 0.5], [[0, 0, 2], 0.5]],
            "structure": [
                [0, 1, [[[1, 0, 0], -1.5], [[0, 0, 1], 1.5]]],
                [0, 2, [[[0, 1, 0], -1.5]]],
                [1, 2, [[[1, 0, 0], 1.5], [[0, 0, 1], -1.5]]],
            ],
        }
    )
    problem, y, h = problems.polynomial_problem(data), np.array([1.0, 1.0, 0.0]), 1 / 78
    y1 = schemes.energy_preserving.step(problem, y, h, np.array([h]))
    back = schemes.energy_preserving.step(problem, y1, h, np.array([-3 * h]))
    assert np.max(np.abs(back - y)) < 1e-15


def test_a_state_at_rest_stays_where_the_jacobian_is_singular() -> None:
    """H = y1 y2 has a saddle at the origin; at Δ = 2 the Jacobian of (3.4) and (2.1) there is singular."""
    data = problems.from_json(
        {"dimension": 2, "hamiltonian": [[[1, 1], 1.0]], "structure": [[0, 1, [[[0, 0], 1.0]]]]}
    )
    problem = problems.polynomial_problem(data)
    for scheme in IMPLICIT:
        assert scheme.step(problem, np.zeros(2), 1.0, np.array([1.0])).tolist() == [0.0, 0.0]


def system_of_two() -> PolynomialSystem:
    """H = y1² y2 − 2y2, B12 = y1 − y2: values cancel at (1, 1), their terms do not."""
    H = poly.polynomial(2, {(2, 1): 1.0, (0, 1): -2.0})
    return PolynomialSystem(2, H, ((0, 1, poly.polynomial(2, {(1, 0): 1.0, (0, 1): -1.0})),))


def test_majorants_take_absolute_coefficients_where_there_are_any() -> None:
    y = np.array([1.0, 1.0])
    p = PolynomialMap((), (poly.polynomial(2, {(1, 0): 1.0, (0, 1): -1.0}),))
    assert majorant(p, y) == 2.0
    assert majorant(lambda y: -y, y).tolist() == [1.0, 1.0]


def test_the_equation_of_a_step_says_what_its_rounding_is_relative_to(monkeypatch) -> None:
    """Σ|step| · max_i (|B||∇H|)_i with absolute coefficients, at the larger of |y0| and |y1|, lane by lane."""
    problem = problems.polynomial_problem(system_of_two())
    seen: list[Equations] = []

    def capture(equations: Equations, start: np.ndarray, lanes: np.ndarray) -> Solution:
        seen.append(equations)
        assert not start.any()
        return iterate(equations, start, lanes)

    monkeypatch.setattr(implicit, "iterate", capture)
    y0 = np.array([[1.0, -2.0, 0.5], [1.0, 0.25, -1.0]])
    step = np.array([[0.1, -0.2, 0.05], [0.1, 0.1, -0.05]])
    implicit.solve(problem, y0, step, increment, jacobian)
    (equations,) = seen
    z, lanes = np.array([[0.5, 0.25], [-3.0, 0.5]]), np.array([0, 2])
    reach = np.array([[1.5, 0.75], [2.0, 1.0]])
    entry, first, second = reach[0] + reach[1], 2 * reach[0] * reach[1], reach[0] ** 2 + 2
    expected = np.array([0.2, 0.1]) * entry * np.maximum(first, second)
    assert equations.magnitude(z, lanes) == pytest.approx(expected, rel=1e-15, abs=0)
    small = np.full((2, 2), 0.25)
    assert np.all(equations.magnitude(-small, lanes) < equations.magnitude(small, lanes) + 1)
    assert np.array_equal(equations.size, np.abs(y0))
    assert equations.exact
    assert equations.inside is None
    B = np.abs(problem.structure.majorant(reach))
    assert matvec(B, problem.gradient.majorant(reach)).max(axis=0) * [0.2, 0.1] == pytest.approx(
        expected, rel=4 * EPS, abs=0
    )


@pytest.mark.parametrize("missing", ["degree", "hessian", "structure_derivative"])
def test_a_jacobian_is_exact_only_with_all_it_is_made_of(missing: str, monkeypatch) -> None:
    seen: list[Equations] = []
    monkeypatch.setattr(implicit, "iterate", lambda e, *at: (seen.append(e), iterate(e, *at))[1])
    problem = problems.polynomial_problem(system_of_two())
    y0, step = np.array([[1.0, 0.5, 0.2], [0.9, 0.8, 0.1]]), np.full((1, 3), 0.01)
    full = implicit.solve(problem, y0, step, increment, jacobian)
    bare = implicit.solve(replace(problem, check=False, **{missing: None}), y0, step, increment, jacobian)
    assert [e.exact for e in seen] == [True, False]
    assert np.max(np.abs(full.value - bare.value)) <= 4 * EPS
    nodes = 2 if missing != "degree" else 12  # the adaptive rule with 4 and 8 nodes agrees at once
    # Differences: R at two other values, but at the end, where the matrix of the iteration before serves.
    others = 0 if missing == "degree" else 2 * (bare.iterations - 1)
    assert bare.gradient_evaluations.tolist() == (nodes * (bare.iterations + others)).tolist()
    assert full.gradient_evaluations.tolist() == (2 * full.iterations).tolist()


def test_a_domain_may_answer_in_numbers() -> None:
    problem = problems.lotka_volterra()
    y0, step = np.repeat([[1.0], [1.9], [0.5]], 4, axis=1), np.array([[0.1, 0.2, -0.3, 2.0]])
    numbers = replace(problem, domain=lambda y: np.where(problem.domain(y), 1, 0), check=False)
    found, asked = (implicit.solve(p, y0, step, increment, jacobian) for p in (numbers, problem))
    assert np.array_equal(found.value, asked.value)
    assert found.status.tolist() == asked.status.tolist()
    assert len(set(found.status.tolist())) > 1


def test_a_good_start_saves_iterations_and_changes_nothing_else() -> None:
    problem = problems.polynomial_problem(system_of_two())
    y0, step = np.array([[1.0, 0.5], [0.9, 0.8]]), np.full((1, 2), 0.1)
    cold = implicit.solve(problem, y0, step, increment, jacobian)
    warm = implicit.solve(problem, y0, step, increment, jacobian, start=cold.change)
    assert np.all(warm.iterations < cold.iterations)
    assert np.max(np.abs(warm.value - cold.value)) <= 4 * EPS
    assert np.array_equal(warm.value, y0 + warm.change)


@pytest.mark.parametrize("name", ["midpoint", "energy-preserving", "discrete-gradient"])
def test_a_domain_in_which_h_goes_on_beyond_is_left_by_name(name: str) -> None:
    """A rotation by Δ ≈ ½ from (1, 1) takes q to 1.36, where H is defined too: `domain` alone ends it at 1.2."""
    problem = Problem(
        dimension=2,
        structure=lambda y: np.array([[0 * y[0], -1 + 0 * y[0]], [1 + 0 * y[0], 0 * y[0]]]),
        hamiltonian=lambda y: 0.5 * (y[0] ** 2 + y[1] ** 2),
        domain=lambda y: y[1] < 1.2,
        initial=(1.0, 1.0),
    )
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
