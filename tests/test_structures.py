"""Several structures and several Hamiltonians."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

import sepv
from sepv import polynomial as poly
from sepv import problems, schemes
from sepv.case import Case, from_json, to_json
from sepv.errors import ProblemError, UsageError
from sepv.exact_structures import finer
from sepv.problem import PolynomialSystem
from sepv.problems.several import commuting_actions
from sepv.strategies_structures import commuting_hamiltonian_steps, several_steps
from sepv.structures import StructuresProblem, commuting_hamiltonians


@given(commuting_hamiltonian_steps())
def test_commuting_hamiltonians_are_structures(case: Case) -> None:
    """S_j∇H_0 = B∇H_j, and S_j is skew."""
    problem, y, _, _ = case.build()
    assert isinstance(problem, StructuresProblem)
    assert isinstance(case.problem, PolynomialSystem)
    for S, H in zip(problem.noise_structures, case.problem.noise_hamiltonians, strict=True):
        field = problem.structure(y) @ np.array([float(g(y)) for g in map(_map, poly.gradient(H))])
        assert np.allclose(S(y) @ problem.gradient(y), field, rtol=1e-12, atol=1e-12)
        assert np.array_equal(S(y), -S(y).T)


def _map(p: poly.Polynomial) -> poly.PolynomialMap:
    return poly.PolynomialMap((), (p,))


def test_casimirs_of_b_are_casimirs_of_every_structure() -> None:
    """The rigid body turned about its axes of inertia: H_1 = H_0² has the field 2H_0 f, and keeps |y|² too."""
    drift = problems.rigid_body()
    problem = commuting_hamiltonians(drift, [lambda y: 2 * drift.hamiltonian(y) * drift.gradient(y)])
    y = np.array([0.3, -0.7, 0.5])
    S = problem.noise_structures[0](y)
    assert np.allclose(S @ y, 0, atol=1e-15)
    assert np.allclose(
        S @ drift.gradient(y), 2 * drift.hamiltonian(y) * drift.structure(y) @ drift.gradient(y)
    )
    path = sepv.integrate(schemes.several_structures, problem, h=0.01, T=2.0, seed=1).y
    assert np.ptp(drift.hamiltonian(path)) < 1e-14
    assert np.ptp(np.sum(path**2, axis=0)) < 1e-14


def test_hamiltonians_that_do_not_commute_are_refused_with_their_bracket() -> None:
    with pytest.raises(ProblemError, match=r"\{H_0, H_1\} = -0\.2 at y = \[0\.2, 0\.1\]"):
        commuting_hamiltonians(
            problems.harmonic_oscillator(), [lambda y: np.stack([0 * y[0], np.ones_like(y[1])])]
        )
    H = poly.polynomial(1, {(1,): 1.0})
    system = commuting_actions(H, [H])
    broken = PolynomialSystem(
        2, system.hamiltonian, system.structure, (1.0,), noise_hamiltonians=(poly.variable(2, 0),)
    )
    with pytest.raises(ProblemError, match=r"\{H_0, H_1\}"):
        problems.polynomial_problem(broken)


@pytest.mark.parametrize("name", ["commuting-rotations", "commuting-oscillators"])
def test_closed_forms_are_what_fine_steps_converge_to(name: str) -> None:
    """Two independent references: rotations, and Heun's method with 4096 steps, which is wrong by what it says."""
    problem = problems.by_name(name)
    assert isinstance(problem, StructuresProblem)
    assert problem.closed_form is not None
    y0 = np.asarray(problem.initial)
    dW, y, apart = finer(problem, y0, 1.0, 64, range(64), 5)
    exact = problem.closed_form(y0, 1.0, dW.sum(axis=0))
    assert np.sqrt(np.mean(np.sum((y - exact) ** 2, axis=0))) < 2 * apart < 0.02
    for part in (exact, y[:, :1]):
        assert np.allclose(problem.hamiltonian(part), problem.hamiltonian(y0), atol=1e-2)
    assert np.ptp(problem.hamiltonian(exact)) < 1e-14


def test_schemes_for_one_structure_refuse_several() -> None:
    problem = problems.noncommuting_tops()
    y, dW = np.asarray(problem.initial), np.zeros(2)
    for scheme in [*schemes.ALL.values(), schemes.collocation(2), schemes.gauss(2), schemes.explicit(4)]:
        with pytest.raises(UsageError, match="several-structures"):
            scheme.step(problem, y, 0.1, dW)
    with pytest.raises(UsageError, match="several structures"):
        sepv.exact_flow(problem, 1.0)


def test_one_structure_is_the_energy_preserving_scheme_to_the_bit() -> None:
    problem = problems.rigid_body(noise=(1.0, 0.5))
    y, dW = np.asarray(problem.initial), np.array([0.1, -0.2])
    several = schemes.several_structures.step(problem, y, 0.1, dW)
    assert np.max(np.abs(several - schemes.energy_preserving.step(problem, y, 0.1, dW))) <= 2.0**-52


def test_ensembles_take_several_structures() -> None:
    problem = problems.noncommuting_tops()
    ends = sepv.ensemble(schemes.several_structures, problem, h=1 / 32, T=1.0, paths=64)
    assert not ends.status.any()
    assert ends.energy_defect.max() < 1e-14


@given(several_steps())
def test_cases_travel_as_json(case: Case) -> None:
    assert from_json(to_json(case)) == case


def test_wrong_structures_are_refused() -> None:
    drift = problems.rigid_body()
    keys = {
        "dimension": 3,
        "structure": drift.structure,
        "hamiltonian": drift.hamiltonian,
        "gradient": drift.gradient,
    }

    def symmetric(y: np.ndarray) -> np.ndarray:
        return np.zeros((3, 3, *y.shape[1:])) + 1.0

    def other(y: np.ndarray) -> np.ndarray:
        B = np.zeros((3, 3, *y.shape[1:]))
        B[0, 1], B[1, 0] = y[2], -y[2]
        return B

    with pytest.raises(ProblemError, match="skew"):
        StructuresProblem(**keys, noise=(1.0,), noise_structures=(symmetric,))
    with pytest.raises(ProblemError, match="one for each coefficient"):
        StructuresProblem(**keys, noise=(1.0, 2.0), noise_structures=(drift.structure,))
    with pytest.raises(ProblemError, match="Casimir"):
        StructuresProblem(**keys, casimirs=drift.casimirs, noise=(1.0,), noise_structures=(other,))
