"""The exact flow: printed values, independent methods, Jacobi's functions, and an error that is no empty promise."""

from itertools import permutations

import mpmath
import numpy as np
import pytest
from sepv.reference.problem import exact_problem

import sepv
from sepv import problems
from sepv.exact import _flow as exact
from sepv.exact import exact_flow
from sepv.exact._closed_forms import SEPARATRIX
from sepv.exact._dense_flow import FlowFailure, solve_dense
from sepv.exact._jacobi import argument, jacobi
from sepv.problem import vector_field
from sepv.record._binary64 import EPS

DENSE, JACOBI = "Gauss collocation in panels", "Jacobi elliptic functions"

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


@pytest.mark.parametrize("name", problems.PAPER)
def test_the_flow_is_a_flow_and_keeps_what_it_must(name: str) -> None:
    problem = problems.by_name(name)
    flow = exact_flow(problem, np.array([-1.5, 0.0, 2.5]))
    assert np.array_equal(flow.y[:, 1], problem.initial) or name in ("rigid-body", "pendulum")
    assert np.max(np.abs(flow.y[:, 1] - problem.initial)) <= flow.error
    onwards = exact_flow(problem, 4.0, flow.y[:, 0])
    # An error at θ = −1.5 is carried on to 2.5 by the slope of the flow, by e^{4L} at most with |f′| ≤ L; here by ten.
    assert np.max(np.abs(onwards.y - flow.y[:, 2])) <= onwards.error + 10 * flow.error
    slope = np.sum(np.max(np.abs(problem.gradient(flow.y)), axis=1))
    assert np.ptp(problem.hamiltonian(flow.y)) <= 2 * slope * flow.error


@pytest.mark.parametrize("name", problems.PAPER)
def test_the_stated_error_covers_the_error(name: str) -> None:
    problem = problems.by_name(name)
    exact = exact_problem(problem.data, 30)
    solution = exact.ctx.odefun(lambda _t, y: exact.field(list(y)), 0, exact.state(problem.initial))
    truth = [[float(v) for v in solution(t)] for t in (0.7, 1.9)]
    for dense in (False, True):
        flow = exact_flow(problem, np.array([0.7, 1.9]), dense=dense)
        # The reference's own rounding to binary64 is half an ulp.
        assert np.max(np.abs(flow.y - np.array(truth).T)) <= flow.error + EPS * np.max(np.abs(flow.y))
        assert flow.error < 1e-12


def test_special_states() -> None:
    rigid, pendulum = problems.rigid_body(), problems.pendulum()
    theta = np.linspace(-3, 3, 7)
    for axis in range(3):  # steady rotations, also the unstable one
        y0 = np.eye(3)[axis]
        steady = exact_flow(rigid, theta, y0)
        assert np.max(np.abs(steady.y - y0[:, None])) <= steady.error < 1e-12
    assert not exact_flow(rigid, theta, np.zeros(3)).y.any()
    assert not exact_flow(pendulum, theta, np.zeros(2)).y.any()
    equal = problems.rigid_body(inertia=(1.0, 1.0, 2.0))
    assert exact_flow(equal, theta).method == DENSE
    separatrix = exact_flow(pendulum, theta, np.array([2.0, 0.0]))
    assert np.max(np.abs(separatrix.y[1] - 2 * np.arctan(np.sinh(theta)))) <= separatrix.error < 1e-12


def test_a_flow_that_blows_up_says_where() -> None:
    # y1' = y1² in the plane: H = y1² y2, blows up at θ = 1/y1.
    parts = {"hamiltonian": [[[2, 1], 1.0]], "structure": [[0, 1, [[[0, 0], 1.0]]]]}
    data = problems.from_json({"dimension": 2, **parts})
    problem = problems.polynomial_problem(data)
    near = exact_flow(problem, 0.9, np.array([1.0, 0.0]))
    assert abs(near.y[0] - 10.0) <= near.error < 1e-11
    with pytest.raises(FlowFailure, match="no further"):
        exact_flow(problem, 1.1, np.array([1.0, 0.0]))


def agree(problem: sepv.Problem, y0: np.ndarray, method: str = JACOBI) -> None:
    """The closed form, which is used, and the dense solve, which knows nothing of it."""
    theta = np.linspace(-3, 4, 15)
    closed, dense = exact_flow(problem, theta, y0), exact_flow(problem, theta, y0, dense=True)
    assert (closed.method, dense.method) == (method, DENSE)
    assert np.max(np.abs(closed.y - dense.y)) <= closed.error + dense.error
    assert closed.error < 1e-12


@pytest.mark.parametrize("order", list(permutations((0.345, 0.653, 1.0))))
def test_the_axes_of_a_rigid_body_may_come_in_any_order(order: tuple[float, ...]) -> None:
    """Even permutations turn the way of the paper, odd ones the other way; the body may spin about either end."""
    body = problems.rigid_body(inertia=order)
    for signs in ((1, 1, 1), (-1, 1, 1), (1, -1, -1), (-1, -1, -1)):
        for y in ((0.8, 0.6, 0.1), (0.1, 0.3, 0.9), (0.3, 0.9, 0.1)):
            agree(body, np.array(signs) * y)
    # The body whose axes P permutes turns at Py as the paper's at y, with time reversed where det P = −1.
    P = np.array([[float(a == b) for b in (0.345, 0.653, 1.0)] for a in order])
    y, theta = np.array([0.8, 0.6, 0.1]), np.linspace(-3, 4, 15)
    ours, paper = (
        exact_flow(body, theta, P @ y),
        exact_flow(problems.rigid_body(), np.linalg.det(P) * theta, y),
    )
    assert np.max(np.abs(ours.y - P @ paper.y)) <= ours.error + paper.error


def test_a_pendulum_turns_over_either_way_and_keeps_count() -> None:
    for p, q in ((2.2, 0.0), (-2.2, 0.3), (2.05, 7.0), (-5.0, -20.0), (0.5, 12.9), (-1.9, -6.0)):
        agree(problems.pendulum(), np.array([p, q]))
    assert np.max(np.abs(exact_flow(problems.pendulum(), 4.0, np.array([-5.0, -20.0])).y[1] + 20)) > 4 * np.pi
    agree(problems.harmonic_oscillator(), np.array([0.3, -1.1]), "rotation")


def test_near_a_separatrix_the_dense_solve_takes_over() -> None:
    """Where k² = H/2 + ½, for the rigid body K_a/K_c, is within 10⁻⁴ of 1, on both sides."""
    for near, method in ((0.5, DENSE), (2.0, JACOBI)):
        for side in (1, -1):
            k2 = 1 + side * near * SEPARATRIX
            assert exact_flow(problems.pendulum(), 1.0, np.array([2 * np.sqrt(k2), 0.0])).method == method
            # About the middle axis b, with K_a = y_a²/A_a + y_b²/A_b and K_c the same with c.
            I = np.array([0.345, 0.653, 1.0])
            A_a, A_b, A_c = 1 / I[1] - 1 / I[2], 1 / I[0] - 1 / I[2], 1 / I[0] - 1 / I[1]
            excess = np.sqrt(near * SEPARATRIX / A_b * (A_a if side > 0 else A_c))
            y0 = np.array([excess if side > 0 else 0.0, 1.0, 0.0 if side > 0 else excess])
            assert exact_flow(problems.rigid_body(), 1.0, y0).method == method


def test_moments_of_inertia_that_are_nearly_equal_are_so_in_every_unit() -> None:
    """I ↦ λI slows time down by λ, and says nothing about how well the formula is conditioned."""
    for ratio, method in ((1 + 1e-5, DENSE), (1.01, JACOBI)):
        for unit in (1e-3, 1.0, 1e3):
            for inertia in ((1.0, 2.0, 2.0 * ratio), (2.0, 1.0, ratio)):
                body = problems.rigid_body(inertia=unit * np.array(inertia))
                assert exact_flow(body, 0.1 * unit, np.array([0.8, 0.3, 0.4])).method == method


def test_the_stated_error_grows_with_the_time_and_does_not_depend_on_signs() -> None:
    """eps(|y| + |f|(1 + |θ|)) with a factor: the condition of a formula in θ, at the worst of the times."""
    oscillator, y0 = problems.harmonic_oscillator(), np.array([3.0, 0.0])
    here, there = (exact_flow(oscillator, np.array(theta), y0).error for theta in ([0.0], [0.0, 100.0]))
    assert here == pytest.approx(16 * EPS * (3 + 3), rel=4 * EPS, abs=0)
    assert there == pytest.approx(16 * EPS * (3 + 3 * 101), rel=4 * EPS, abs=0)
    for theta, y in ((100.0, -y0), (-100.0, y0), (-100.0, -y0)):
        error = exact_flow(oscillator, np.array([0.0, theta]), y).error
        assert error == pytest.approx(there, rel=4 * EPS, abs=0)
    # In a steady rotation nothing moves, and what is stated is the rounding of the state.
    body, axis = problems.rigid_body(), np.array([0.0, 0.0, -1.0])
    assert not vector_field(body, axis).any()
    steady = exact_flow(body, np.array([0.5, 9.0]), axis)
    assert steady.method == JACOBI
    assert steady.error == 16 * EPS


def test_the_dense_solve_states_four_times_what_two_solves_differ_by(monkeypatch: pytest.MonkeyPatch) -> None:
    """And eight roundings of the state, which are all there is at θ = 0."""
    oscillator = problems.harmonic_oscillator()
    for y0 in (np.array([-3.0, 0.0]), np.array([0.0, 3.0])):
        still = exact_flow(oscillator, 0.0, y0, dense=True)
        assert np.array_equal(still.y, y0)
        assert still.error == 8 * EPS * 3
    solves = []

    def rough(f, y0, end, stages, shrink):
        """Solutions that are wrong by what a different number of nodes would explain."""
        solution = solve_dense(f, y0, end, stages, shrink)
        wrong = 1e-9 * len(solves) * np.sign(end)
        solves.append((stages, shrink))
        return lambda t: solution(t) + wrong * t

    monkeypatch.setattr(exact, "solve_dense", rough)
    # Forwards and backwards for one, then for the other: off by 0, 10⁻⁹·2, then 2·10⁻⁹·1, 3·10⁻⁹·2.
    flow = exact_flow(oscillator, np.array([1.0, -2.0]), np.array([1.0, 0.0]), dense=True)
    assert len(set(solves)) == 2
    # To what the states themselves are off by, 10⁻¹⁴ of 4·10⁻⁹.
    assert flow.error == pytest.approx(4 * 4e-9, rel=1e-5, abs=0)


def test_a_flow_does_not_leave_the_domain() -> None:
    """f = (1, 0) on y1 < 1: the flow is y1 + θ, and at θ = 1 it ends."""
    strip = sepv.Problem(
        dimension=2, structure=lambda y: np.zeros((2, 2, *y.shape[1:])) + np.array([[0, 1], [-1, 0]])[..., None],
        hamiltonian=lambda y: y[1], gradient=lambda y: np.stack([0 * y[0], 1 + 0 * y[1]]), noise=(),
        domain=lambda y: y[0] < 1, check=False,
    )  # fmt: skip
    inside = exact_flow(strip, np.array([-5.0, 0.9]), np.zeros(2)).y[0]
    assert inside == pytest.approx([-5.0, 0.9], rel=4 * EPS, abs=0)
    with pytest.raises(FlowFailure, match="leaves the domain"):
        exact_flow(strip, 1.5, np.zeros(2))


@pytest.mark.parametrize("m", [0.0, 1e-300, 1e-9, 0.3, 0.99, 1 - 1e-4])
@pytest.mark.parametrize("size", [1.0, 50.0, 1000.0])
def test_functions_to_a_few_roundings(m: float, size: float) -> None:
    """A rounding of the argument each, and of dn a few of its own size."""
    u = np.random.default_rng(int(size)).uniform(-size, size, 12)
    found = jacobi(u, m)
    with mpmath.workdps(40):
        for name, values in zip(("sn", "cn", "dn"), found[:3], strict=True):
            exact = [mpmath.ellipfun(name, mpmath.mpf(float(x)), m=mpmath.mpf(m)) for x in u]
            off = max(float(abs(v - float(e))) for v, e in zip(values, exact, strict=True))
            assert off <= 4 * EPS * size, name
            if name == "dn":
                relative = max(float(abs(v / e - 1)) for v, e in zip(values, exact, strict=True))
                assert relative <= 8 * EPS * size


@pytest.mark.parametrize("m", [0.0, 0.3, 1 - 1e-4])
@pytest.mark.parametrize("amplitude", [-3.1, -1.0, 0.0, 0.5, 3.1])
def test_the_amplitude_of_its_argument_is_the_amplitude(m: float, amplitude: float) -> None:
    u = argument(amplitude, m)
    # Near a quarter period dn is √(1 − m): what is a rounding of u is that of the amplitude and more.
    assert jacobi(np.array([u]), m)[3][0] == pytest.approx(amplitude, abs=8 * EPS * max(1.0, abs(u)))
