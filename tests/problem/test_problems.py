"""Problems: the paper's four, polynomial data that travels, contradictions, and all that is derived from B and H."""

import json
import pickle

import numpy as np
import pytest
from drawn import by_hand
from hypothesis import given, settings
from sepv.reference.problem import exact_problem

import sepv
from sepv import ProblemError, problems, strategies
from sepv.problem import PartFlow, PolynomialSystem, average_gradient, check_problem, vector_field
from sepv.record import EPS, NoClosedForm
from sepv.verification._cases import case as cases


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
    """B skew, ∇H of H, H″ of ∇H, B′ of B, Casimirs: those that are derived, and those that are written."""
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
