"""The exact flow: printed values, independent methods, and an error that is not an empty promise."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from sepv.reference.problem import exact_problem

import sepv
from sepv import problems
from sepv.dense import FlowFailure
from sepv.exact import exact_flow

# φ_8(y0) to 27 digits, from Taylor series at 50 digits by another program.
PRINTED = {
    "rigid-body": (0, "0.855297301108575742526317778"),
    "pendulum": (0, "-0.793000088603793489919469626"),
    "lotka-volterra": (0, "2.7016687479775418691785006"),
}


@pytest.mark.parametrize("name", PRINTED)
@pytest.mark.parametrize("dense", [False, True])
def test_values_printed_elsewhere(name: str, dense: bool) -> None:
    component, digits = PRINTED[name]
    flow = exact_flow(problems.by_name(name), 8.0, dense=dense)
    error = abs(float(mpmath.mpf(digits) - mpmath.mpf(float(flow.y[component]))))
    assert error <= flow.error
    assert flow.error < 1e-12


@pytest.mark.parametrize("name", ["harmonic-oscillator", "rigid-body", "pendulum"])
def test_closed_forms_agree_with_the_dense_solve(name: str) -> None:
    problem, theta = problems.by_name(name), np.linspace(-6, 9, 301)
    rng = np.random.default_rng(4)
    for _ in range(12):
        y0 = np.asarray(problem.initial) + rng.normal(size=problem.dimension) * 2
        closed, dense = exact_flow(problem, theta, y0), exact_flow(problem, theta, y0, dense=True)
        assert np.max(np.abs(closed.y - dense.y)) <= closed.error + dense.error
        assert dense.method != closed.method or name == "pendulum"  # a separatrix is left to the dense solve


@pytest.mark.parametrize("name", problems.NAMED)
def test_the_flow_is_a_flow_and_keeps_what_it_must(name: str) -> None:
    problem = problems.by_name(name)
    flow = exact_flow(problem, np.array([-1.5, 0.0, 2.5]))
    assert np.array_equal(flow.y[:, 1], problem.initial) or name in ("rigid-body", "pendulum")
    assert np.max(np.abs(flow.y[:, 1] - problem.initial)) <= flow.error
    onwards = exact_flow(problem, 4.0, flow.y[:, 0])
    assert np.max(np.abs(onwards.y - flow.y[:, 2])) < 1e-12
    assert np.ptp(problem.hamiltonian(flow.y)) < 1e-13


@pytest.mark.parametrize("name", problems.NAMED)
def test_the_stated_error_covers_the_error(name: str) -> None:
    problem = problems.by_name(name)
    exact = exact_problem(problem.data, 30)
    solution = exact.ctx.odefun(lambda _t, y: exact.field(list(y)), 0, exact.state(problem.initial))
    truth = [[float(v) for v in solution(t)] for t in (0.7, 1.9)]
    for dense in (False, True):
        flow = exact_flow(problem, np.array([0.7, 1.9]), dense=dense)
        # The reference's own rounding to binary64 is half an ulp.
        assert np.max(np.abs(flow.y - np.array(truth).T)) <= flow.error + 2.3e-16 * np.max(np.abs(flow.y))
        assert flow.error < 1e-12


def test_special_states() -> None:
    rigid, pendulum = problems.rigid_body(), problems.pendulum()
    theta = np.linspace(-3, 3, 7)
    for axis in range(3):  # steady rotations, also the unstable one
        y0 = np.eye(3)[axis]
        assert np.max(np.abs(exact_flow(rigid, theta, y0).y - y0[:, None])) < 1e-13
    assert not exact_flow(rigid, theta, np.zeros(3)).y.any()
    assert not exact_flow(pendulum, theta, np.zeros(2)).y.any()
    equal = problems.rigid_body(inertia=(1.0, 1.0, 2.0))
    assert exact_flow(equal, theta).method == "Gauss collocation in panels"
    separatrix = exact_flow(pendulum, theta, np.array([2.0, 0.0]))
    assert np.max(np.abs(separatrix.y[1] - 2 * np.arctan(np.sinh(theta)))) < 1e-12


def test_a_flow_that_blows_up_says_where() -> None:
    # y1' = y1² in the plane: H = y1² y2, blows up at θ = 1/y1.
    data = problems.from_json(
        {"dimension": 2, "hamiltonian": [[[2, 1], 1.0]], "structure": [[0, 1, [[[0, 0], 1.0]]]]}
    )
    problem = problems.polynomial_problem(data)
    assert exact_flow(problem, 0.9, np.array([1.0, 0.0])).y[0] == pytest.approx(10.0, rel=1e-12)
    with pytest.raises(FlowFailure, match="no further"):
        exact_flow(problem, 1.1, np.array([1.0, 0.0]))


@pytest.mark.parametrize("theta", [np.nan, np.array([]), np.zeros((2, 2)), np.array([1.0, np.inf])])
def test_wrong_times_are_refused(theta: np.ndarray) -> None:
    with pytest.raises(sepv.UsageError, match="theta"):
        sepv.exact_flow(problems.pendulum(), theta)


def test_wrong_states_are_refused() -> None:
    for y0 in (np.zeros(3), np.array([0.0, np.nan])):
        with pytest.raises(sepv.UsageError, match="y0"):
            sepv.exact_flow(problems.pendulum(), 1.0, y0)
