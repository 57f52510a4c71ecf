"""Problems: the paper's four agree with themselves, polynomial data travels, and contradictions are named."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
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


def test_the_casimir_of_lotka_volterra_is_one() -> None:
    problem = problems.lotka_volterra()
    y = np.array([1.0, 1.9, 0.5])
    b, d = -1.0, -0.5
    slope = np.array([1 / y[0], b * d / y[1], -d / y[2]])
    assert np.max(np.abs(slope @ problem.structure(y))) < 1e-15


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


def oscillator(**changes: Any) -> sepv.Problem:
    parts: dict[str, Any] = {
        "dimension": 2,
        "structure": lambda y: np.array([[0 * y[0], -1 + 0 * y[0]], [1 + 0 * y[0], 0 * y[0]]]),
        "hamiltonian": lambda y: y[0] ** 4 / 4 + y[1] ** 2 / 2,
        "gradient": lambda y: np.array([y[0] ** 3, y[1]]),
    }
    return sepv.Problem(**{**parts, **changes})


def test_a_problem_made_by_hand_is_accepted_and_solved() -> None:
    problem = oscillator(initial=(1.0, 0.5))
    y1 = sepv.schemes.energy_preserving.step(problem, np.array([1.0, 0.5]), 0.1, np.array([0.2]))
    assert abs(problem.hamiltonian(y1) - problem.hamiltonian(np.array([1.0, 0.5]))) < 1e-15


def test_functions_that_complex_steps_mislead_are_accepted() -> None:
    problem = oscillator(hamiltonian=lambda y: np.abs(y[0]) ** 4 / 4 + np.abs(y[1]) ** 2 / 2)
    y = np.array([1.0, 0.5])
    assert np.imag(problem.hamiltonian(y + 1e-30j)) == 0.0  # a slope of zero, which ∇H has not
    step = sepv.schemes.energy_preserving.step
    same = step(oscillator(), y, 0.1, np.array([0.2]))
    assert np.array_equal(step(problem, y, 0.1, np.array([0.2])), same)


WRONG = {
    "B not skew": (
        {"structure": lambda y: np.array([[0 * y[0], 1 + 0 * y[0]]] * 2)},
        r"structure\(y\)\[1, 1\]",
    ),
    "B off by 1e-9": (
        {"structure": lambda y: np.array([[0 * y[0], -1 + 0 * y[0]], [1 + 1e-9 + 0 * y[0], 0 * y[0]]])},
        "skew-symmetric",
    ),
    "gradient of another H": (
        {"gradient": lambda y: np.array([y[0] ** 3, 2 * y[1]])},
        r"gradient\(y\)\[1\].*∂H/∂y\[1\]",
    ),
    "gradient wrong by 1e-6": (
        {"gradient": lambda y: np.array([y[0] ** 3, y[1] + 1e-6])},
        r"gradient\(y\)\[1\]",
    ),
    "no Casimir": ({"casimirs": (np.eye(2),)}, "Casimir"),
    "no linear Casimir": ({"linear_casimirs": ((1.0, 0.0),)}, "Casimir"),
    "Casimir not symmetric": ({"casimirs": (((0.0, 1.0), (0.0, 0.0)),)}, "symmetric"),
    "Casimir of wrong shape": ({"casimirs": (np.eye(3),)}, r"\(2, 2\)"),
    "Hessian of another H": (
        {"hessian": lambda y: np.array([[y[0], 0 * y[0]], [0 * y[0], 1 + 0 * y[0]]])},
        "hessian",
    ),
    "negative noise": ({"noise": (-1.0,)}, "≥ 0"),
    "noise not a number": ({"noise": (float("nan"),)}, "finite"),
    "d = 0": ({"dimension": 0}, "d ≥ 1"),
    "batches refused": ({"gradient": lambda y: np.array([float(y[0]) ** 3, float(y[1])])}, "component first"),
    "gradient of wrong shape": ({"gradient": lambda y: y[:1]}, "shape"),
    "domain excludes everything": ({"domain": lambda y: y[0] > 1e9}, "domain"),
    "initial of wrong shape": ({"initial": (1.0,)}, r"\(2,\)"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_contradictions_are_named(wrong: str) -> None:
    changes, words = WRONG[wrong]
    with pytest.raises(ProblemError, match=words) as caught:
        oscillator(**changes)
    assert "Expected" in str(caught.value)
    assert "Remedy" in str(caught.value)


def test_one_dimension_means_that_nothing_moves() -> None:
    still = sepv.Problem(
        dimension=1,
        structure=lambda y: np.zeros((1, 1, *y.shape[1:])),
        hamiltonian=lambda y: y[0] ** 2,
        gradient=lambda y: np.stack([2 * y[0]]),
    )
    for scheme in sepv.schemes.PAPER.values():
        assert scheme.step(still, np.array([1.5]), 0.5, np.array([0.25])).tolist() == [1.5]
    with pytest.raises(ProblemError, match="skew"):
        sepv.Problem(
            dimension=1,
            structure=lambda y: np.ones((1, 1, *y.shape[1:])),
            hamiltonian=lambda y: y[0] ** 2,
            gradient=lambda y: np.stack([2 * y[0]]),
        )


@pytest.mark.parametrize(
    "data",
    [
        {},
        [],
        {"dimension": 2, "hamiltonian": [[[2], 1.0]], "structure": []},
        {"dimension": 2, "hamiltonian": [[[2, 0], "x"]], "structure": []},
        {"dimension": 2, "hamiltonian": [], "structure": [[0, 1]]},
    ],
)
def test_json_that_is_no_problem_is_refused(data: Any) -> None:
    with pytest.raises(sepv.UsageError, match="Expected"):
        problems.from_json(data)


def test_structure_below_the_diagonal_is_refused() -> None:
    data = problems.from_json(
        {"dimension": 2, "hamiltonian": [[[2, 0], 1.0]], "structure": [[1, 0, [[[0, 0], 1.0]]]]}
    )
    with pytest.raises(ProblemError, match="above the diagonal"):
        problems.polynomial_problem(data)


def test_a_mean_gradient_of_another_rule_is_refused() -> None:
    """The midpoint's gradient is off by the cube of the distance: energy would be lost without a word."""
    with pytest.raises(ProblemError, match=r"\(x − y\)ᵀmean_gradient = H\(x\) − H\(y\)"):
        oscillator(
            hamiltonian=lambda y: y[0] ** 4 / 4 + y[1] ** 2 / 2,
            gradient=lambda y: np.stack([y[0] ** 3, y[1]]),
            degree=4,
            mean_gradient=lambda y, x: np.stack([((x[0] + y[0]) / 2) ** 3, (x[1] + y[1]) / 2]),
        )


@pytest.mark.parametrize(
    ("key", "wrong", "words"),
    [
        ("hessian", lambda y: np.ones(3), r"hessian\(y\) of shape \(3, 3\)"),
        ("hessian", lambda y: np.ones((2, 2)), r"shape \(2, 2\)"),
        (
            "structure_derivative",
            lambda y: np.zeros((3, 3)),
            r"structure_derivative\(y\) of shape \(3, 3, 3\)",
        ),
    ],
)
def test_a_derivative_of_another_shape_is_named(key: str, wrong: Any, words: str) -> None:
    with pytest.raises(ProblemError, match=words):
        replace(problems.rigid_body(), **{key: wrong}, check=True)
