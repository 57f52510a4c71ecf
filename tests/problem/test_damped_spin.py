"""A spin with damping and field noise: its fields, what its steps keep,
and the distribution that it samples.
"""

from typing import Any

import numpy as np
import pytest

import sepv
from sepv.errors import ProblemError
from sepv.problem import StructuresProblem, vector_field
from sepv.problems import damped_spin
from sepv.schemes import by_name

Y = np.array([0.48, -0.6, 0.64])
RATE, KT = 0.5, 0.25


def slope(y: np.ndarray) -> np.ndarray:
    """∇E of the default problem: E = −½y₃² − ¼y₂ − ½y₃."""
    return np.array([0.0, -0.25, -0.5 - y[2]])


def test_the_fields_are_those_of_landau_and_lifshitz() -> None:
    problem = damped_spin(RATE, KT)
    assert isinstance(problem, StructuresProblem)
    wanted = np.cross(Y, slope(Y) + RATE * np.cross(Y, slope(Y)))
    np.testing.assert_allclose(vector_field(problem, Y), wanted, atol=1e-16)
    for j, S in enumerate(problem.structures[1:]):
        np.testing.assert_array_equal(S(Y) @ problem.gradient(Y), np.cross(Y, np.eye(3)[j]))
    np.testing.assert_allclose(problem.c, np.sqrt(2 * RATE * KT))


def test_damping_takes_energy_at_the_rate_alpha_times_the_torque_squared() -> None:
    torque = np.cross(Y, slope(Y))
    assert slope(Y) @ vector_field(damped_spin(RATE), Y) == pytest.approx(-RATE * torque @ torque, rel=1e-14)


def test_the_scheme_for_several_structures_is_the_implicit_midpoint_rule_and_keeps_the_norm() -> None:
    problem, h, dW = damped_spin(), 0.125, np.array([0.25, -0.5, 0.125])
    y1 = by_name("several-structures").step(problem, Y, h, dW)
    middle = 0.5 * (Y + y1)
    field = h * vector_field(problem, middle) + np.cross(middle, problem.c * dW)
    np.testing.assert_allclose(y1 - Y, field, atol=4e-16)
    assert abs(y1 @ y1 - Y @ Y) < 1e-15


def test_it_samples_the_boltzmann_distribution_on_the_sphere() -> None:
    """⟨y₃⟩ = coth x − 1/x with x = b/kT, for E = −b y₃;
    five standard errors of 2048 paths (a false alarm in 2e6).
    """
    problem = damped_spin(RATE, KT, field=(0.0, 0.0, 0.5), anisotropy=0.0)
    ends = sepv.ensemble("several-structures", problem, h=0.125, T=16.0, paths=2048, seed=11).y[2]
    assert np.mean(ends) == pytest.approx(1 / np.tanh(2.0) - 0.5, abs=5 * np.std(ends) / np.sqrt(2048))
    # With half of the noise it would be coth 4 − ¼.
    assert np.mean(ends) < 1 / np.tanh(4.0) - 0.25 - 5 * np.std(ends) / np.sqrt(2048)


@pytest.mark.parametrize("wrong", [{"damping": -1.0}, {"temperature": float("nan")}, {"field": (1.0, 0.0)}])
def test_wrong_numbers_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ProblemError, match="from 0 up"):
        damped_spin(**wrong)
