"""Problems: the paper's four agree with themselves, polynomial data travels, and contradictions are named."""

import json

import numpy as np
import pytest
from drawn import by_hand
from hypothesis import given, settings

import sepv
from sepv import problems
from sepv.errors import ProblemError
from sepv.problem import PolynomialSystem, check_problem
from sepv.verification import strategies
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
