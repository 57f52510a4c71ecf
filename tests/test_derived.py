"""B and H are enough: what is derived from their records, held against what is written by hand."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import sepv
from sepv import problems
from sepv.average import average_gradient
from sepv.errors import ProblemError

EPS = 2.0**-52
PAPERS = ["harmonic-oscillator", "rigid-body", "pendulum", "lotka-volterra", "kepler", "toda"]


def bare(given: sepv.Problem, **changes) -> sepv.Problem:
    """The same problem by B, H and noise alone."""
    parts = {
        "dimension": given.dimension,
        "structure": given.structure,
        "hamiltonian": given.hamiltonian,
        "noise": given.noise,
        "initial": given.initial,
        "domain": given.domain,
        "name": "bare",
    }
    return sepv.Problem(**parts | changes)


@pytest.mark.parametrize("name", PAPERS)
def test_what_is_derived_is_what_was_written_by_hand(name) -> None:
    given = problems.by_name(name)
    derived = bare(given)
    rng = np.random.default_rng(3)
    y = np.asarray(given.initial)[:, None] * (1 + 0.05 * rng.uniform(-1, 1, (given.dimension, 20)))
    for key in ("gradient", "hessian", "structure_derivative"):
        if getattr(given, key) is not None:
            mine, theirs = getattr(derived, key)(y), getattr(given, key)(y)
            assert mine.shape == theirs.shape
            # Some ten operations, of terms that do not cancel here by more than a factor of ten.
            assert np.allclose(mine, theirs, rtol=100 * EPS, atol=100 * EPS * np.abs(theirs).max())
            assert np.array_equal(getattr(derived, key)(y[:, 4]), mine[..., 4])


@pytest.mark.parametrize("name", ["rigid-body", "pendulum", "lotka-volterra"])
def test_a_step_and_its_work_are_those_of_the_problem_given_in_full(name) -> None:
    given = problems.by_name(name)
    derived = bare(given)
    y = np.asarray(given.initial)
    mean, other = (average_gradient(p, y[:, None], 1.01 * y[:, None]) for p in (derived, given))
    assert np.allclose(mean.value, other.value, rtol=8 * EPS)
    assert mean.evaluations == other.evaluations
    for dW in (0.1, -0.07):
        arguments = (y, 0.05, np.full(given.noises, dW))
        ends = [sepv.schemes.energy_preserving.step(p, *arguments) for p in (derived, given)]
        assert np.allclose(*ends, rtol=16 * EPS, atol=16 * EPS)


def test_a_problem_of_b_and_h_keeps_its_energy() -> None:
    """H with an exponential, which no rule of fixed size averages exactly."""
    morse = sepv.Problem(
        dimension=2,
        structure=problems.pendulum().structure,
        hamiltonian=lambda y: 0.5 * y[0] ** 2 + np.exp(-2 * y[1]) - 2 * np.exp(-y[1]),
        initial=(0.5, 0.2),
        noise=(0.3, 0.2),
    )
    assert morse.mean_gradient is not None
    path = sepv.integrate("energy-preserving", morse, h=1 / 32, T=4.0, seed=1)
    # 128 steps; a step rounds energies of size 3 some ten times.
    assert np.ptp(morse.hamiltonian(path.y)) < 10 * 3 * EPS * np.sqrt(128)


def test_a_polynomial_h_has_its_degree_and_what_has_no_closed_mean_its_quadrature() -> None:
    structure = problems.pendulum().structure
    quartic = sepv.Problem(dimension=2, structure=structure, hamiltonian=lambda y: y[0] ** 4 + y[1] ** 2)
    assert (quartic.degree, quartic.mean_gradient) == (4, None)
    coupled = sepv.Problem(dimension=2, structure=structure, hamiltonian=lambda y: np.cosh(y[0] * y[1]))
    assert (coupled.degree, coupled.mean_gradient) == (None, None)
    assert coupled.hessian is not None
    y1 = sepv.schemes.energy_preserving.step(coupled, np.array([0.5, 0.4]), 0.1, np.array([0.1]))
    assert abs(coupled.hamiltonian(y1) - coupled.hamiltonian(np.array([0.5, 0.4]))) < 4 * EPS


def test_what_a_user_gives_is_kept_and_held_against_h() -> None:
    given = problems.pendulum()
    assert bare(given, gradient=given.gradient).hessian is None
    mine = bare(given, mean_gradient=given.mean_gradient)
    assert mine.mean_gradient is given.mean_gradient
    with pytest.raises(ProblemError, match="gradient to be that of hamiltonian"):
        bare(given, gradient=lambda y: np.stack([y[0], np.cos(y[1])]))
    with pytest.raises(ProblemError, match="hessian to be the derivative"):
        bare(given, hessian=lambda y: np.zeros((2, 2, *y.shape[1:])))


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"hamiltonian": lambda y: 0.5 * y[0] ** 2 if y[1] > 0 else y[1]}, "branches on a value"),
        ({"hamiltonian": lambda y: np.floor(y[0])}, "np.floor"),
        ({"hamiltonian": lambda y: y.no_such_thing}, "AttributeError"),
        ({"hamiltonian": lambda y: y * y}, r"shape \(\)"),
        ({"structure": lambda y: np.array([[float(y[0]), 1.0], [-1.0, 0.0]])}, "wants the value"),
    ],
)
def test_what_cannot_be_derived_says_why_and_what_to_give(changes, why) -> None:
    with pytest.raises(ProblemError, match=why) as caught:
        bare(problems.pendulum(), **changes)
    assert "Remedy" in str(caught.value)


def test_derived_functions_travel_to_other_processes() -> None:
    derived = bare(problems.lotka_volterra())
    y = np.array([1.0, 1.9, 0.5])
    for key in ("gradient", "hessian", "structure_derivative"):
        function = getattr(derived, key)
        assert np.array_equal(pickle.loads(pickle.dumps(function))(y), function(y))
