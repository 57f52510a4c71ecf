"""Problems: the paper's four, data that travels, contradictions, what is derived from B and H,
and averages of ∇H.
"""

import json
import pickle
from dataclasses import replace
from typing import Any

import mpmath
import numpy as np
import pytest
from drawn import by_hand
from hypothesis import given, settings
from sepv.reference.problem import exact_problem

import sepv
from sepv import ProblemError, problems, strategies
from sepv.core.average import ONE_CALL_MAX_SIZE, _adaptive, _quadratures, _size, gauss_legendre
from sepv.law.cases import case as cases
from sepv.law.tolerance import rounding_walk
from sepv.problem import (
    PartFlow,
    PolynomialSystem,
    Problem,
    average_gradient,
    average_hessian,
    check_problem,
    vector_field,
)
from sepv.problem._enclosures import over_box
from sepv.record import EPS, NoClosedForm
from sepv.record import _polynomial as poly


def test_parameters_are_the_papers() -> None:
    assert problems.harmonic_oscillator().initial.tolist() == [0.2, 0.1]
    assert problems.rigid_body().initial.tolist() == [0.8, 0.6, 0.0]
    assert dict(problems.rigid_body().data.parameters)["inertia"] == (0.345, 0.653, 1.0)
    assert problems.pendulum().c.tolist() == [1.0, 0.5]
    assert dict(problems.lotka_volterra().data.parameters) == {
        "a": (-2.0,), "b": (-1.0,), "d": (-0.5,), "nu": (1.0,), "mu": (2.0,), "noise": (0.5,),
    }  # fmt: skip


@settings(max_examples=12)
@given(strategies.casimir_systems())
def test_casimirs_by_construction_are_casimirs(data: PolynomialSystem) -> None:
    check_problem(problems.polynomial_problem(data))


@given(strategies.any_steps())
def test_cases_travel_to_the_bit(case: cases.Case) -> None:
    assert cases.from_json(json.loads(json.dumps(cases.to_json(case)))) == case
    assert cases.from_token(cases.to_token(case)) == case


def test_energies_of_a_long_chain_have_the_same_bits_alone_and_in_a_batch() -> None:
    """From eight terms on `np.sum` adds those of a single state in pairs."""
    chain, y = sepv.problems.toda(particles=12), np.random.default_rng(0).standard_normal((24, 40))
    alone = [chain.hamiltonian(y[:, [k]])[0] for k in range(40)]
    assert np.array_equal(chain.hamiltonian(y), alone)


def test_functions_that_complex_steps_mislead_are_accepted() -> None:
    problem = by_hand(hamiltonian=lambda y: np.abs(y[0]) ** 4 / 4 + np.abs(y[1]) ** 2 / 2)
    y = np.array([1.0, 0.5])
    assert np.imag(problem.hamiltonian(y + 1e-30j)) == 0.0  # a slope of zero, which ∇H has not
    step = sepv.schemes.energy_preserving.step
    same = step(by_hand(), y, 0.1, np.array([0.2]))
    assert np.array_equal(step(problem, y, 0.1, np.array([0.2])), same)


def test_one_dimension_means_that_nothing_moves() -> None:
    still = sepv.Problem(1, lambda y: np.zeros((1, 1, *y.shape[1:])), lambda y: y[0] ** 2)
    for scheme in sepv.schemes.PAPER.values():
        assert scheme.step(still, np.array([1.5]), 0.5, np.array([0.25])).tolist() == [1.5]
    with pytest.raises(ProblemError, match="skew"):
        sepv.Problem(1, lambda y: np.ones((1, 1, *y.shape[1:])), lambda y: y[0] ** 2)


def bare(given: sepv.Problem, **changes) -> sepv.Problem:
    """The same problem by B, H and noise alone."""
    kept = ("dimension", "structure", "hamiltonian", "noise", "initial", "domain")
    parts = {key: getattr(given, key) for key in kept}
    return sepv.Problem(**parts | {"name": "bare"} | changes)


@pytest.mark.parametrize(
    "name", [*problems.PAPER, *problems.EXTENSIONS, *problems.SEVERAL, *problems.HAMILTONIANS]
)
def test_the_parts_of_every_problem_by_name_belong_together(name) -> None:
    """B skew, ∇H of H, H″ of ∇H, B′ of B, Casimirs: those that are derived,
    and those that are written.
    """
    check_problem(problems.by_name(name))


@pytest.mark.parametrize("name", problems.PAPER)
def test_slopes_and_means_are_those_of_the_oracle(name) -> None:
    """In 50 digits, for segments from nothing to several times the state."""
    given = problems.by_name(name)
    exact = exact_problem(given.data)
    rng = np.random.default_rng(3)
    for size in (0.0, 1e-300, 1e-12, 1e-3, 0.3, 3.0):
        y = np.asarray(given.initial) * (1 + 0.05 * rng.uniform(-1, 1, given.dimension))
        end = y * (1 + size * rng.uniform(0, 1, given.dimension))
        at, to = exact.state(y), exact.state(end)
        slope = np.array([float(v) for v in exact.gradient(at)])
        average = np.array([float(v) for v in exact.mean_gradient(at, to)])
        found = average_gradient(given, y[:, None], end[:, None])
        # Sums of three terms, each of some four operations.
        assert np.all(np.abs(given.gradient(y) - slope) <= 8 * EPS * np.abs(slope).max())
        assert np.all(np.abs(found.value[:, 0] - average) <= 8 * EPS * np.abs(average).max())
        assert (found.evaluations, found.reliable) == (1, True)
        if given.nambu is not None:
            casimir = np.array([float(v) for v in exact.mean_casimir_gradient(at, to)])
            mine = average_gradient(given.nambu, y[:, None], end[:, None]).value[:, 0]
            assert np.all(np.abs(mine - casimir) <= 8 * EPS * np.abs(casimir).max())


def test_means_of_exponentials_overflow_where_they_do_themselves() -> None:
    """e^−300 … e^300 along a segment: (e^300 − e^−300)/600."""
    chain = problems.toda(2)
    start, end = np.array([0.0, 0.0, -150.0, 150.0]), np.array([0.0, 0.0, 150.0, -150.0])
    for y0, y1 in ((start, end), (end, start)):
        assert chain.mean_gradient(y0, y1)[2] == pytest.approx(np.exp(300.0) / 600, rel=600 * EPS)
    far = np.array([0.0, 0.0, 350.0, -350.0])
    mean = chain.mean_gradient(np.array([0.0, 0.0, -300.0, 300.0]), far)
    assert mean[2] == pytest.approx(np.exp(700.0) / 1300, rel=2000 * EPS)


def test_a_derived_function_of_one_state_divides_by_zero_as_arrays_do() -> None:
    centre = problems.kepler()
    with np.errstate(all="ignore"):
        one, batch = centre.gradient(np.zeros(4)), centre.gradient(np.zeros((4, 2)))
    assert not np.isfinite(one).all()
    assert np.array_equal(one, batch[:, 1], equal_nan=True)


@pytest.mark.parametrize("name", ["harmonic-oscillator", "rigid-body", "pendulum", "lotka-volterra"])
def test_flows_of_parts_solve_their_equations(name) -> None:
    """y′(t) = B∇H_k by the complex step, and the parts add up to f."""
    given = problems.by_name(name)
    y = np.asarray(given.initial) * 1.1 + 0.01
    total = np.zeros(given.dimension)
    for flow in given.flows:
        there = flow(y, np.array(0.7))
        speed = flow(y, np.array(0.7 + 1e-30j)).imag / 1e-30
        again = flow(there, np.array(1e-30j)).imag / 1e-30
        assert np.allclose(speed, again, rtol=16 * EPS, atol=16 * EPS)
        assert np.array_equal(flow(y, np.array(0.0)), y)
        total += flow(y, np.array(1e-30j)).imag / 1e-30
    assert np.allclose(total, vector_field(given, y), rtol=16 * EPS, atol=16 * EPS)


def test_a_part_whose_flow_no_rule_knows_says_so() -> None:
    for part, words in (
        (lambda y: y[0] ** 2 * y[1], "linear"),
        (lambda y: 0.5 * (y[0] ** 2 - y[1] ** 2), "neither"),
    ):
        with pytest.raises(NoClosedForm, match=words):
            PartFlow(2, problems.pendulum().structure, part)(np.ones(2), np.array(0.1))


def test_a_polynomial_h_has_its_degree_and_what_has_no_closed_mean_its_quadrature() -> None:
    structure = problems.pendulum().structure
    quartic = sepv.Problem(dimension=2, structure=structure, hamiltonian=lambda y: y[0] ** 4 + y[1] ** 2)
    assert (quartic.degree, quartic.mean_gradient) == (4, None)
    coupled = sepv.Problem(dimension=2, structure=structure, hamiltonian=lambda y: np.cosh(y[0] * y[1]))
    assert (coupled.degree, coupled.mean_gradient) == (None, None)
    assert coupled.hessian is not None
    y1 = sepv.schemes.energy_preserving.step(coupled, np.array([0.5, 0.4]), 0.1, np.array([0.1]))
    assert abs(coupled.hamiltonian(y1) - coupled.hamiltonian(np.array([0.5, 0.4]))) < 4 * EPS


def test_what_a_user_gives_is_kept() -> None:
    given = problems.pendulum()
    assert bare(given, gradient=given.gradient).hessian is None
    mine = bare(given, mean_gradient=given.mean_gradient)
    assert mine.mean_gradient is given.mean_gradient


def test_derived_functions_travel_to_other_processes() -> None:
    derived = bare(problems.lotka_volterra())
    y = np.array([1.0, 1.9, 0.5])
    for key in ("gradient", "hessian", "structure_derivative"):
        function = getattr(derived, key)
        assert np.array_equal(pickle.loads(pickle.dumps(function))(y), function(y))


@pytest.mark.parametrize("n", [1, 2, 3, 5, 12, 33])
def test_nodes_and_weights_are_correctly_rounded(n: int) -> None:
    """Against zeros of P_n at 60 digits, and weights 1/((1 − x²)P_n′(x)²) on [0, 1]."""
    ctx = mpmath.MPContext()
    ctx.dps = 60

    def legendre(x):
        before, now = ctx.mpf(1), x
        for k in range(1, n):
            before, now = now, ((2 * k + 1) * x * now - k * before) / (k + 1)
        return now, n * (x * now - before) / (x * x - 1)

    points, weights = gauss_legendre(n)
    for k in range(n):
        # Zero k of P_n lies near cos(π(4k + 3)/(4n + 2)), counted from above.
        x = ctx.cos(ctx.pi * (4 * (n - 1 - k) + 3) / (4 * n + 2))
        for _ in range(8):
            p, slope = legendre(x)
            x -= p / slope
        slope = legendre(x)[1]
        # The nodes below ½ are 1 minus those above, which are correctly rounded: symmetry matters
        # more.
        assert points[k] == (float((1 + x) / 2) if 2 * k + 1 >= n else 1 - float((1 - x) / 2))
        assert weights[k] == float(1 / ((1 - x * x) * slope * slope))


def monomial_energy(degree: int) -> Problem:
    """H = Σ of all monomials of one degree and below in two variables, B = J."""
    terms = {(i, j): 1.0 / (1 + i + 2 * j) for i in range(degree + 1) for j in range(degree + 1 - i) if i + j}
    H = poly.polynomial(2, terms)
    return problems.polynomial_problem(PolynomialSystem(2, H, ((0, 1, poly.constant(2, 1.0)),)))


Y0 = np.array([[0.3, -0.4, 2.0], [-0.2, 0.9, 1.0]])
Y1 = np.array([[0.8, -0.1, -1.0], [0.4, 1.1, 3.0]])


@pytest.mark.parametrize("degree", range(1, 9))
def test_polynomials_take_the_fewest_nodes_that_are_exact(degree: int) -> None:
    problem = monomial_energy(degree)
    found = average_gradient(problem, Y0, Y1)
    nodes = max(1, (degree + 1) // 2)
    assert found[1:] == (nodes, 0.0, True)
    ((fine, terms),) = _quadratures(problem, Y0, Y1, nodes + 3)
    assert np.all(np.abs(found.value - fine) <= 16 * EPS * _size(terms))
    hessian = average_hessian(problem, Y0, Y1)
    tau, weights = gauss_legendre(nodes + 3)
    exact = sum(w * t * problem.hessian(Y0 + t * (Y1 - Y0)) for t, w in zip(tau, weights, strict=True))
    scale = np.abs(exact).max(axis=(0, 1)) + 1
    assert np.all(np.abs(hessian - exact) <= 1e-14 * degree**2 * scale)
    # Many states at once have their nodes one after the other.
    many = average_hessian(problem, np.tile(Y0, 100), np.tile(Y1, 100))
    assert Y0.size <= ONE_CALL_MAX_SIZE < 100 * Y0.size
    assert np.all(np.abs(many - np.tile(exact, 100)) <= 1e-14 * degree**2 * np.tile(scale, 100))


def steep(*widths: float) -> tuple[Problem, np.ndarray, np.ndarray]:
    """∇H = (1/(y1 + y2), 0) with y2 = w and y1 from 0 to 1, a lane for each w: the nearer the pole,
    the more nodes.
    """
    w = np.array(widths)
    problem = replace(
        problems.harmonic_oscillator(),
        mean_gradient=None, degree=None, hessian=None, structure_derivative=None,
        gradient=lambda y: np.stack([1 / (y[0] + y[1]), 0 * y[0]]), check=False,
    )  # fmt: skip
    return problem, np.stack([0 * w, w]), np.stack([1 + 0 * w, w])


def test_the_ladder_climbs_as_far_as_a_lane_needs_and_counts_its_rungs() -> None:
    """∫₀¹ dy/(y + w) = ln(1 + 1/w), for which Gauss rules converge the slower the smaller w is."""
    problem, y0, y1 = steep(1e4, 3.0, 0.3, 0.03, 1e-7)
    found = _adaptive(problem, y0, y1)
    rungs = {sum((4, 8, 16, 32, 64, 128)[:k]): k for k in range(2, 7)}
    assert set(found.evaluations.tolist()) <= set(rungs)
    climbed = [rungs[n] for n in found.evaluations.tolist()]
    assert climbed == sorted(climbed)
    assert (climbed[0], climbed[-1]) == (2, 6)
    assert len(set(climbed)) >= 4
    assert found.reliable.tolist() == [True, True, True, True, False]
    exact = np.log1p(1 / y0[1])
    assert np.all(np.abs(found.value[0] - exact)[:4] <= 256 * EPS * exact[:4])
    assert np.all(found.error[:4] <= 256 * EPS * exact[:4])
    assert found.error[4] > 1e-6
    assert found.reliable.dtype == bool
    # In other units it climbs just as far.
    for unit in (2.0**30, 2.0**-30):
        scaled = replace(problem, gradient=lambda y, c=unit: c * problem.gradient(y), check=False)
        assert _adaptive(scaled, y0, y1).evaluations.tolist() == found.evaluations.tolist()
    # A lane climbs as it does alone.
    for k in range(5):
        alone = _adaptive(problem, y0[:, k : k + 1], y1[:, k : k + 1])
        assert alone.value[0, 0] == found.value[0, k]
        assert alone.evaluations[0] == found.evaluations[k]
        assert alone.error[0] == found.error[k]


def test_rules_that_differ_by_the_rounding_of_their_argument_agree_and_a_kink_does_not() -> None:
    """sin q near 10⁶ is off by eps·10⁶, far more than a rounding of its own;
    the mean of sign p has no digits.

    The first lane agrees at once, the second by that allowance alone, the third not at all.
    """
    problem = by_hand(
        hamiltonian=lambda y: -np.cos(y[0]) + np.abs(y[1]),
        gradient=lambda y: np.stack([np.sin(y[0]), np.sign(y[1])]),
        hessian=lambda y: np.array([[np.cos(y[0]), 0 * y[0]], [0 * y[0], 0 * y[0]]]),
        check=False,
    )
    y0 = np.array([[0.1, 1e6, 0.1], [1.0, 1.0, -0.3]])
    y1 = y0 + np.array([[0.4, 0.4, 0.4], [0.0, 0.0, 1.0]])
    found = _adaptive(problem, y0, y1)
    assert found.reliable.tolist() == [True, True, False]
    assert found.error[1] > 64 * EPS  # more than the rules' own roundings
    alone = _adaptive(problem, y0[:, :2], y1[:, :2])
    assert alone.reliable.tolist() == [True, True]


@pytest.mark.parametrize("nodes", range(1, 41))
def test_nodes_and_weights_are_symmetric_to_the_bit(nodes: int) -> None:
    """So the averaged gradient of a quadratic H is taken at the middle of the segment,
    and H gets no bias.
    """
    points, weights = gauss_legendre(nodes)
    assert np.array_equal(points[::-1], 1 - points)
    assert np.array_equal(weights[::-1], weights)


def test_the_energy_of_a_quadratic_hamiltonian_has_no_bias_with_two_nodes() -> None:
    """Two oscillators, ω = 1e8 and 1e-8, weakly coupled:
    a step changed H by 0.09 roundings of y1 in the mean.

    100,000 steps in longest floats show a mean of 0.0041 roundings. Five such errors: a false alarm
    in a million.
    """
    one = np.array([[0.0, 1.0], [-1.0, 0.0]])
    B = np.kron(np.eye(2), one)
    fast, slow = 1e8, 1e-8

    def energy(y: Any) -> Any:
        return fast * (y[0] ** 2 + y[1] ** 2) / 2 + slow * ((y[2] ** 2 + y[3] ** 2) / 2 + y[0] * y[2] ** 2)

    problem = sepv.Problem(4, B, energy, noise=(0.5,), initial=(1.0, 0.0, 1.0, 0.0))
    rng = np.random.default_rng(4)
    angle = rng.uniform(0, 2 * np.pi, 100_000)
    y = np.stack([np.cos(angle), np.sin(angle), np.ones_like(angle), np.zeros_like(angle)])
    y1 = sepv.schemes.energy_preserving.step(problem, y, 0.0, rng.standard_normal((1, angle.size)) / fast)
    change = energy(y1.astype(np.longdouble)) - energy(y.astype(np.longdouble))
    rounding = rounding_walk(problem.gradient(y1), y1)
    mean, spread = float(np.mean(change)), float(np.std(change))
    assert spread < 2 * rounding
    assert abs(mean) < 5 * spread / angle.size**0.5
    assert 5 * spread / angle.size**0.5 < 0.05 * rounding  # the test sees half of the bias


def test_a_box_that_leaves_the_domain_is_bounded_by_pieces_of_the_segment() -> None:
    """1/(y1 + y2) from (2, −1) to (−1, 2): the sum is 1 on the segment,
    where |F| + Σ|∂F||y| is 4 at most.
    """

    def field(y: Any) -> Any:
        return np.stack([1 / (y[0] + y[1])])

    y0, y1 = np.array([[2.0, 1.0], [-1.0, 1.0]]), np.array([[-1.0, 1.5], [2.0, 0.5]])
    batch = over_box(field, y0, y1)
    assert batch is not None
    for k, (least, most) in enumerate(((4.0, 6.0), (1.0, 2.0))):
        alone = over_box(field, y0[:, k], y1[:, k])
        assert alone is not None
        assert alone[0] == batch[0, k]
        assert least <= alone[0] <= most
