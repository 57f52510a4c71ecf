"""The exact flow: closed forms, the dense solve, series and enclosures,
and an error that is no empty promise.
"""

import re
from collections.abc import Callable
from itertools import permutations

import mpmath
import numpy as np
import pytest
from sepv.reference.arithmetic import context, decimal
from sepv.reference.balls import from_mpf, precision
from sepv.reference.elliptic import closed_form
from sepv.reference.flow import FlowNotReached, enclosed, taylor
from sepv.reference.problem import exact_problem
from sepv.reference.series import PowerSeries, series_over

import sepv
from sepv import exact_flow, problems
from sepv.core.arrays import EPS
from sepv.exact import _dense_flow as dense_solver
from sepv.exact import _flow as exact
from sepv.exact._closed_forms import SEPARATRIX
from sepv.exact._dense_flow import FlowFailure, solve_dense
from sepv.exact._jacobi import argument, jacobi
from sepv.problem import PolynomialSystem, vector_field
from sepv.record import _polynomial as poly

DENSE, JACOBI = "Gauss collocation in panels", "Jacobi elliptic functions"

# A component of φ_8(y0) to 25 digits and more, from Taylor series at 50 digits by a program that is
# no part of sepv. The pendulum's was once noted as …3489919469626: wrong from its 18th digit on, as
# the second test below showed.
COMPUTED_ELSEWHERE = {
    "rigid-body": (0, "0.855297301108575742526317778"),
    "pendulum": (0, "-0.793000088603793491919694626"),
    "lotka-volterra": (0, "2.7016687479775418691785006"),
}


@pytest.mark.parametrize("name", COMPUTED_ELSEWHERE)
def test_the_flow_has_the_values_that_another_program_computed(name: str) -> None:
    """That program started from decimal numbers such as 1.9;
    to round them to binary64 moves φ_8 by an ulp or two.
    """
    component, digits = COMPUTED_ELSEWHERE[name]
    problem = problems.by_name(name)
    for dense in (False, True):
        flow = exact_flow(problem, 8.0, dense=dense)
        error = abs(float(mpmath.mpf(digits) - mpmath.mpf(float(flow.y[component]))))
        assert error <= flow.error + 2 * EPS
        assert flow.error < 1e-12


@pytest.mark.deep
@pytest.mark.parametrize("name", COMPUTED_ELSEWHERE)
def test_the_values_of_another_program_are_right_to_the_last_digit(name: str) -> None:
    """By mpmath from decimal numbers, with equations that share nothing with sepv."""
    component, digits = COMPUTED_ELSEWHERE[name]
    ctx = context(36)
    one, I1, I2 = ctx.mpf(1), ctx.mpf("0.345"), ctx.mpf("0.653")
    field, start = {
        "rigid-body": (
            lambda _t, y: [
                (one / 1 - one / I2) * y[1] * y[2], (one / I1 - 1) * y[0] * y[2], (one / I2 - one / I1) * y[0] * y[1]
            ],
            ["0.8", "0.6", "0"],
        ),
        "pendulum": (lambda _t, y: [-ctx.sin(y[1]), y[0]], ["0.2", "1"]),
        "lotka-volterra": (
            lambda _t, y: [
                y[0] * (y[2] - y[1] / 2 - ctx.mpf("1.5")), y[1] * (y[0] - 2 * y[2] + 2), y[2] * (y[1] - y[0] + 1)
            ],
            ["1", "1.9", "0.5"],
        ),
    }[name]  # fmt: skip
    end = ctx.odefun(field, 0, [ctx.mpf(v) for v in start])(8)[component]
    assert abs(end - ctx.mpf(digits)) <= ctx.mpf(10) ** -len(digits.partition(".")[2])


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
    """Even permutations turn the way of the paper, odd ones the other way;
    the body may spin about either end.
    """
    body = problems.rigid_body(inertia=order)
    for signs in ((1, 1, 1), (-1, 1, 1), (1, -1, -1), (-1, -1, -1)):
        for y in ((0.8, 0.6, 0.1), (0.1, 0.3, 0.9), (0.3, 0.9, 0.1)):
            agree(body, np.array(signs) * y)
    # The body whose axes P permutes turns at Py as the paper's at y, with time reversed where det
    # P = −1.
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
    """eps(|y| + |f|(1 + |θ|)) with a factor: the condition of a formula in θ,
    at the worst of the times.
    """
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
    # Near a quarter period dn is √(1 − m): what is a rounding of u is that of the amplitude and
    # more.
    assert jacobi(np.array([u]), m)[3][0] == pytest.approx(amplitude, abs=8 * EPS * max(1.0, abs(u)))


PENDULUM, BODY = problems.pendulum().data, problems.rigid_body().data
OSCILLATOR, PREDATORS = problems.harmonic_oscillator().data, problems.lotka_volterra().data

CLOSED = [
    (PENDULUM, (0.2, 1.0), 1.5),
    (PENDULUM, (2.0, 0.0), -1.0),
    (PENDULUM, (-2.5, 7.0), 1.0),
    (PENDULUM, (0.0, 3.141592653589793), 3.0),
    (PENDULUM, (0.0, 0.0), 2.0),
    (BODY, (0.8, 0.6, 0.0), 1.5),
    (BODY, (0.0, 1.0, 1e-8), 3.0),
    (BODY, (-0.9, -0.2, 0.1), -1.0),
    (problems.rigid_body((1.0, 0.345, 0.653)).data, (0.1, 0.2, -0.9), 1.0),
    (problems.rigid_body((0.653, 0.345, 1.0)).data, (0.5, 0.2, -0.4), 1.0),
    (OSCILLATOR, (0.2, 0.1), 8.0),
]


@pytest.mark.parametrize(("data", "y", "theta"), CLOSED)
def test_series_and_closed_forms_agree_to_fifty_digits(data, y, theta) -> None:
    for a, b in zip(taylor(data, y, theta), closed_form(data, y, theta), strict=True):
        assert abs(a - b) < 1e-50


def test_series_lie_in_their_enclosures() -> None:
    pytest.importorskip("flint", reason="the extra certify is not installed")
    for data, y, theta in [*CLOSED[:2], *CLOSED[5:6], (PREDATORS, (1.0, 1.9, 0.5), 0.0625)]:
        balls = enclosed(data, y, theta)
        with precision(500):
            for value, ball in zip(taylor(data, y, theta, 70), balls, strict=True):
                assert abs(from_mpf(value) - ball).upper() < 1e-50
                assert ball.rad() < 1e-49


def test_flows_compose() -> None:
    ctx = context(60)
    middle = taylor(PREDATORS, (1.0, 1.9, 0.5), 0.25, 60)
    rounded = [float(v) for v in middle]
    there = taylor(PREDATORS, rounded, -0.25, 40)
    # The way back from a state rounded to binary64 misses by what the rounding grew to.
    assert max(abs(a - b) for a, b in zip(there, (1.0, 1.9, 0.5), strict=True)) < 1e-14
    assert ctx.dps == 60


def test_series_of_functions_are_their_taylor_series() -> None:
    ctx, arithmetic = context(40), series_over(decimal(40))
    x = PowerSeries(ctx.fdot, lambda k: ctx.mpf(k == 1), [ctx.mpf("0.5")])
    for f, g in (
        (arithmetic.sin, ctx.sin),
        (arithmetic.cos, ctx.cos),
        (arithmetic.log, ctx.ln),
        (lambda s: 1 / s, lambda t: 1 / t),
        (lambda s: 3 - s * s / (2 + s), lambda t: 3 - t * t / (2 + t)),
    ):
        for a, b in zip(f(x).upto(12), ctx.taylor(g, ctx.mpf("0.5"), 12), strict=True):
            assert abs(a - b) < 1e-25


def test_a_series_that_blows_up_says_where() -> None:
    """p′ = −3x², x′ = p with H = p²/2 + x³: from (−1, −1) the solution is gone before θ = 10."""
    H = poly.polynomial(2, [((2, 0), 0.5), ((0, 3), 1.0)])
    cubic = PolynomialSystem(2, H, ((0, 1, poly.constant(2, -1.0)),), (1.0,))
    with pytest.raises(FlowNotReached, match="and no further"):
        taylor(cubic, (-1.0, -1.0), 10.0, 15)


def powers(y: np.ndarray) -> np.ndarray:
    """The field of (t, t², t³, t⁴, 1 − t): y_n′ = n y_{n−1}."""
    one = np.ones_like(y[0])
    return np.stack([one, 2 * y[0], 3 * y[1], 4 * y[2], -one])


@pytest.mark.parametrize("end", [3.0, -3.0, 0.1, -(2.0**-40)])
@pytest.mark.parametrize("shrink", [1.0, 0.6])
def test_polynomials_are_followed_exactly_either_way(end: float, shrink: float) -> None:
    y0 = np.array([0.0, 0.0, 0.0, 0.0, 1.0])
    solution = solve_dense(powers, y0, end, 7, shrink)
    edges = solution.edges
    assert np.all(np.diff(edges) > 0)
    assert {edges[0], edges[-1]} == {0.0, end}

    t = np.concatenate([edges, end * np.linspace(0, 1, 23) ** 2])
    exact = np.stack([t, t**2, t**3, t**4, 1 - t])
    # A few roundings of the largest component, a panel.
    assert np.max(np.abs(solution(t) - exact)) <= 4 * edges.size * EPS * np.max(np.abs(exact))
    assert np.array_equal(solution(edges[:-1]), solution.starts)


def rotation(rate: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda y: np.stack([-rate * y[1], rate * y[0]])


def panels(rate: float, stages: int, shrink: float = 1.0, end: float = 1.0) -> int:
    return int(solve_dense(rotation(rate), np.array([1.0, 0.0]), end, stages, shrink).edges.size) - 1


def test_panels_shrink_where_the_series_does_not_decay_and_grow_where_it_more_than_decays() -> None:
    """Ten times faster is ten times shorter, to a factor of two for the halving;
    fewer stages need more panels.
    """
    few, many = panels(2.0, 20), panels(20.0, 20)
    assert few <= 4
    assert 5 * few <= many <= 20 * few
    assert panels(2.0, 8) > 2 * few
    # Each panel is resolved: accepted below 4 eps of the largest component, with a weight half of
    # this.
    solution = solve_dense(rotation(20.0), np.array([1.0, 0.0]), 0.5, 20)
    last = np.abs(solution.coefficients[:, -1]).max(axis=0) / 40 * np.diff(solution.edges)
    assert last.max() < 8 * EPS
    # A first panel that is far too short grows by a fifth each: some 20 panels to 2⁻⁸, without
    # growth 32.
    assert 10 < panels(1.0, 20, 2.0**-12, 2.0**-8) < 24


def test_hundreds_of_panels_cost_no_more_rounding_than_one() -> None:
    """y₁′ = cos 40y₂ from 10⁶: each panel moves y₁ by less than 1,
    and half an ulp of 10⁶ a panel would be a walk.

    Sums that forget what was rounded off are 10 ulp off.
    """
    f = lambda y: np.stack([np.cos(40 * y[1]), np.ones_like(y[1])])  # noqa: E731
    solution = solve_dense(f, np.array([1e6, 0.0]), 200.0, 20)
    assert solution.edges.size > 500
    exact = 1e6 + np.sin(40 * solution.starts[1]) / 40
    assert np.abs(solution.starts[0] - exact).max() <= np.spacing(1e6)


def test_panels_depend_neither_on_the_unit_of_the_state_nor_on_its_sign() -> None:
    """Where the first is as long, ½: with |f| = |y|. Eight nodes are too few for it."""
    y0 = np.array([1.0, 0.25])
    edges = solve_dense(rotation(1.0), y0, 3.0, 8).edges
    assert edges[-2] < 3 - 1e-3
    assert np.diff(edges).max() < 0.5
    for unit in (-1.0, 2.0**-30, -(2.0**30)):
        assert np.array_equal(solve_dense(rotation(1.0), unit * y0, 3.0, 8).edges, edges)


def test_the_last_panel_ends_at_the_end_and_is_no_splinter() -> None:
    for end in 10 * np.random.default_rng(0).uniform(-1, 1, 40):
        for shrink in (0.6, 0.8):
            edges = solve_dense(np.ones_like, np.zeros(1), float(end), 4, shrink).edges
            assert {edges[0], edges[-1]} == {0.0, end}
            # What 40 numbers that know nothing of panels leave over; a splinter is eps.
            assert np.diff(edges).min() > 1e-9


def reached(error: pytest.ExceptionInfo[FlowFailure]) -> float:
    found = re.search(r"θ = (\S+) of", str(error.value))
    assert found is not None
    return float(found.group(1))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("start", [1.0, 1e-3])
def test_a_solution_that_blows_up_is_followed_to_there(sign: int, start: float) -> None:
    """y′ = y²: y = 1/(1/y0 − t). Nothing is warned about on the way."""
    f, y0 = lambda y: y * y, np.array([sign * start])
    t = sign * np.array([0.5, 0.99]) / start
    # A relative error at t is multiplied by (1/y0)/(1/y0 − t), 100 in the end; the roundings of up
    # to 231 panels, an eps each, are a walk: √231, and twice that.
    ends = sign * start / np.array([0.5, 0.01])
    assert solve_dense(f, y0, t[-1], 20)(t)[0] == pytest.approx(ends, rel=100 * 30 * EPS, abs=0)
    with pytest.raises(FlowFailure, match=r"^The exact flow was followed to") as error:
        solve_dense(f, y0, 1.5 * sign / start, 20)
    # A rounding of y moves the end by no more than eps. Panels take a quarter of the way to it and
    # more (20 terms then decay to 4 eps), until that is 10⁻¹³(1 + θ) ≤ 2·10⁻¹³ of the way from 0:
    # what is left is four times as much.
    assert reached(error) * sign * start == pytest.approx(1.0, rel=8e-13, abs=0)


def test_a_field_that_overflows_is_no_warning() -> None:
    """y′ = exp y from 0: y = −log(1 − t)."""
    end = solve_dense(np.exp, np.zeros(1), 0.5, 20)(np.array([0.5]))[0]
    # Three panels of some roundings, times the condition exp y = 2.
    assert end == pytest.approx(np.log(2), rel=16 * EPS, abs=0)
    with pytest.raises(FlowFailure) as error:
        solve_dense(np.exp, np.zeros(1), 3.0, 20)
    assert reached(error) == pytest.approx(1.0, rel=8e-13, abs=0)  # as above


@pytest.mark.parametrize("sign", [1, -1])
def test_a_field_that_ends_or_that_points_against_itself_is_followed_to_there(sign: int) -> None:
    wall = lambda y: np.where(sign * y < 2, sign + 0 * y, np.nan)  # noqa: E731
    jump = lambda y: np.where(y < 2, 1.0, -1.0)  # noqa: E731 - no solution beyond y = 2
    for f, end in ((wall, 3.0), (jump, 3.0)):
        with pytest.raises(FlowFailure, match=r"^The exact flow was followed to") as error:
            solve_dense(f, np.zeros(1), end, 12)
        assert reached(error) == pytest.approx(2.0, rel=0, abs=3e-13)  # the narrowest panel, 10⁻¹³(1 + θ)


def test_flows_that_take_too_many_panels_are_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    f, y0 = rotation(1.0), np.array([1.0, 0.0])
    needed = solve_dense(f, y0, 4.0, 12).edges.size - 1
    monkeypatch.setattr(dense_solver, "_MAX_PANELS", needed)
    assert solve_dense(f, y0, 4.0, 12).edges.size - 1 == needed
    monkeypatch.setattr(dense_solver, "_MAX_PANELS", needed - 1)
    with pytest.raises(FlowFailure, match=f"^{needed} panels led to θ = 4.0 of 4.0"):
        solve_dense(f, y0, 4.0, 12)
