"""Functions of one state alone, and constant matrices, are accepted;
what cannot be mended is refused.
"""

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import sepv
from sepv import ProblemError, problems
from sepv.problem import HamiltoniansProblem, StructuresProblem

J = np.array([[0.0, -1.0], [1.0, 0.0]])
# H = ½|y|² in the ways that people write it.
ENERGIES: dict[str, Callable[[Any], Any]] = {
    "np.dot": lambda y: 0.5 * np.dot(y, y),
    "@": lambda y: 0.5 * y @ y,
    "np.sum": lambda y: 0.5 * np.sum(y**2),
    "sum over axis 0": lambda y: 0.5 * np.sum(y**2, axis=0),
    "method sum": lambda y: 0.5 * (y**2).sum(),
    "np.vdot": lambda y: 0.5 * np.vdot(y, y),
    "np.inner": lambda y: 0.5 * np.inner(y, y),
    "np.einsum": lambda y: 0.5 * np.einsum("i,i", y, y),
    "np.mean": lambda y: np.mean(y**2),
    "quadratic form": lambda y: 0.5 * y @ np.eye(2) @ y,
    "np.linalg.norm": lambda y: 0.5 * np.linalg.norm(y) ** 2,
}


@pytest.mark.quick
@pytest.mark.parametrize("way", ENERGIES)
def test_an_energy_of_one_state_becomes_one_of_batches(way: str) -> None:
    problem = sepv.Problem(dimension=2, structure=J, hamiltonian=ENERGIES[way], initial=(0.0, 1.0))
    y = np.random.default_rng(1).standard_normal((2, 5))
    np.testing.assert_allclose(problem.hamiltonian(y), 0.5 * (y**2).sum(axis=0), rtol=4e-16)
    np.testing.assert_allclose(problem.gradient(y), y, rtol=1e-15)
    ends = sepv.ensemble("energy-preserving", problem, h=0.1, T=1.0, paths=20)
    assert ends.energy_defect.max() < 1e-14


@pytest.mark.parametrize("structure", [J, J.tolist(), lambda y: J], ids=["array", "list", "function"])
def test_a_constant_matrix_is_a_structure(structure: Any) -> None:
    problem = sepv.Problem(2, structure, lambda y: y[0] ** 2 / 2 + y[1] ** 4 / 4, initial=(0.0, 1.0))
    y = np.random.default_rng(2).standard_normal((2, 4))
    assert problem.structure(y).shape == (2, 2, 4)
    assert np.array_equal(problem.structure(y)[..., 3], J)
    assert np.array_equal(problem.structure(y[:, 0]), J)
    assert not problem.structure_derivative(y).any()
    few = sepv.Effort(examples=2)
    assert (
        sepv.verify("energy-preserving", laws="energy,casimir", problems=problem, effort=few).exit_code == 0
    )


def test_a_constant_structure_travels_to_other_processes() -> None:
    problem = sepv.Problem(2, J, problems.pendulum().hamiltonian, initial=(0.0, 1.0))
    copied = pickle.loads(pickle.dumps(problem.structure))
    assert np.array_equal(copied(np.ones((2, 3))), problem.structure(np.ones((2, 3))))


def test_structures_and_hamiltonians_of_noises_may_be_constant_or_of_one_state() -> None:
    several = StructuresProblem(
        2, J, lambda y: y @ y, noise=(0.5,), initial=(0.0, 1.0), noise_structures=(2 * J,)
    )
    assert several.noise_structures[0](np.ones((2, 3))).shape == (2, 2, 3)
    apart = HamiltoniansProblem(
        2, J, lambda y: y @ y, noise=(0.5,), initial=(0.0, 1.0), noise_hamiltonians=(lambda y: np.sum(y**3),)
    )
    assert apart.noise_hamiltonians[0](np.ones((2, 3))).tolist() == [2.0, 2.0, 2.0]


def test_a_function_that_mixes_the_states_of_a_batch_is_not_used_for_batches() -> None:
    """y / |y| with the norm of the whole batch has the right shape and wrong values."""
    problem = sepv.Problem(2, J, lambda y: y[0] ** 2 / np.linalg.norm(y), initial=(0.5, 1.0))
    y = np.array([[3.0, 5.0], [4.0, 12.0]])
    np.testing.assert_allclose(problem.hamiltonian(y), [9 / 5, 25 / 13], rtol=1e-15)


def test_a_function_that_mixes_states_and_cannot_be_recorded_is_refused_with_both_values() -> None:
    def energy(y: Any) -> Any:
        """½|y|² times 1 for one state and twice that for a batch."""
        return (0.5 if np.ndim(y[0] + 0.0) == 0 and float(np.sum(y[0])) < 1e9 else 1.0) * (y**2).sum(axis=0)

    with pytest.raises(ProblemError, match=r"in a batch and .* alone"):
        sepv.Problem(2, J, energy, lambda y: y, initial=(0.0, 1.0))


def test_a_matrix_of_the_wrong_shape_or_not_skew_is_refused() -> None:
    with pytest.raises(ProblemError, match=r"shape \(2, 2\)"):
        sepv.Problem(2, np.zeros((3, 3)), lambda y: y @ y)
    with pytest.raises(ProblemError, match="skew"):
        sepv.Problem(2, np.eye(2), lambda y: y @ y)
