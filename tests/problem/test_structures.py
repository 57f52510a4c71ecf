"""Several structures and several Hamiltonians."""

from collections.abc import Callable
from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sepv.properties._orders.several_fields import refined
from sepv.properties.test_reference import critical_step
from sepv.reference.equations_by_class import equation_for
from sepv.reference.steps import reference_step

import sepv
from sepv import PolynomialSystem, ProblemError, StepFailure, problems, schemes
from sepv.core.arrays import EPS, TINY
from sepv.core.newton import Status
from sepv.law.cases.commuting import commuting_step
from sepv.law.cases.of_law import ALL_CASES, Question
from sepv.problem import CommutingStructure, StructuresProblem, Systems, commuting_hamiltonians
from sepv.problems._several import closed_form, commuting_actions
from sepv.record import PolynomialMap
from sepv.record import _polynomial as poly
from sepv.verification import Case

_RANDOM = st.randoms(use_true_random=False)
_SEVERAL = ALL_CASES.of_class(Systems.SEVERAL)
assert isinstance(_SEVERAL, Question)


@given(_RANDOM.map(commuting_step).filter(bool))
def test_commuting_hamiltonians_are_structures(case: Case) -> None:
    """S_j∇H_0 = B∇H_j, and S_j is skew."""
    problem, y, _, _ = case.build()
    assert isinstance(problem, StructuresProblem)
    assert isinstance(case.problem, PolynomialSystem)
    for S, H in zip(problem.noise_structures, case.problem.noise_hamiltonians, strict=True):
        field = problem.structure(y) @ np.array([float(g(y)) for g in map(_map, poly.gradient(H))])
        # What is rounded is relative to the terms of S, B and ∇H, dozens of products and sums.
        size = (S.majorant(y) + problem.structure.majorant(y)) @ problem.gradient.majorant(y)
        size += problem.structure.majorant(y) @ np.array(
            [float(g.majorant(y)) for g in map(_map, poly.gradient(H))]
        )
        assert np.all(np.abs(S(y) @ problem.gradient(y) - field) <= 64 * EPS * size.max() + TINY)
        assert np.array_equal(S(y), -S(y).T)


def _map(p: poly.Polynomial) -> PolynomialMap:
    return PolynomialMap((), (p,))


@pytest.mark.parametrize("name", ["commuting-rotations", "commuting-oscillators"])
def test_closed_forms_are_what_fine_steps_converge_to(name: str) -> None:
    """Two independent references: rotations, and the log-ODE, which is wrong by what it says."""
    problem = problems.by_name(name)
    assert isinstance(problem, StructuresProblem)
    assert problem.closed_form is not None
    y0 = np.asarray(problem.initial)
    rough, y, apart = refined(problem, y0, 1.0, 64, range(64), 5, 1.0)
    exact = problem.closed_form(y0, 1.0, rough.dW.sum(axis=0))
    assert np.sqrt(np.mean(np.sum((y - exact) ** 2, axis=0))) < 2 * apart < 0.02
    # |ΔH| ≤ d max|∂H| max|Δy|; a rounding or two of y in the closed form, some dozen in H.
    energy, slope = problem.hamiltonian(y0), np.max(np.abs(problem.gradient(exact)))
    assert np.max(np.abs(problem.hamiltonian(y) - energy)) <= y0.size * slope * np.max(np.abs(y - exact))
    assert np.max(np.abs(problem.hamiltonian(exact) - energy)) <= 16 * EPS * slope * np.max(np.abs(exact))


PAIRS = [("several-structures", "energy-preserving"), ("stochastic-midpoint", "midpoint")]


@pytest.mark.parametrize(("several", "one"), PAIRS)
def test_with_one_structure_and_hamiltonian_a_scheme_for_several_is_that_for_one(
    several: str, one: str
) -> None:
    problem = problems.rigid_body(noise=(1.0, 0.5))
    y, dW = np.asarray(problem.initial), np.array([0.1, -0.2])
    found, known = (schemes.by_name(name).step(problem, y, 0.1, dW) for name in (several, one))
    # Up to the order in which h B and the c_j ΔW_j B are added up: a rounding of y.
    assert np.max(np.abs(found - known)) <= EPS


A, b = np.diag([1.0, -0.5, 2.0, 0.25]), np.array([0.125, 0.5, -0.25, 0.0])
OTHER = np.array([0.0, 3.0, 1.0, -1.0])
LEVI_CIVITA = np.zeros((4, 4, 4, 4))
for _order in permutations(range(4)):
    LEVI_CIVITA[_order] = np.linalg.det(np.eye(4)[list(_order)])


def one_of_each(y: np.ndarray) -> np.ndarray:
    """B_ij = ε_ijkl ∂_kC_1 ∂_lC_2 in dimension four, for C_1 = yᵀAy and C_2 = bᵀy:
    both are Casimirs.
    """
    return np.einsum("ijkl,k...,l->ij...", LEVI_CIVITA, 2 * np.einsum("ki,i...->k...", A, y), b)


def two_linear(y: np.ndarray) -> np.ndarray:
    """The same for two linear Casimirs, times a factor."""
    return np.multiply.outer(np.einsum("ijkl,k,l->ij", LEVI_CIVITA, OTHER, b), 1 + y[0] * y[1])


def quartic(y: np.ndarray) -> np.ndarray:
    return 0.5 * y[0] ** 2 + y[1] ** 2 + 0.25 * y[2] ** 4 + y[3] * y[0]


def quartic_gradient(y: np.ndarray) -> np.ndarray:
    return np.stack([y[0] + y[3], 2 * y[1], y[2] ** 3, y[0]])


def squared(y: np.ndarray) -> np.ndarray:
    return 2 * quartic(y) * quartic_gradient(y)


def test_every_casimir_of_either_kind_is_one_of_a_commuting_structure() -> None:
    """S∇H_0 = B∇H_1, S∇C = 0 for two Casimirs whose gradients are not orthogonal,
    one of either kind or two linear.
    """
    y = np.random.default_rng(3).standard_normal((4, 7))
    y[:, 6] *= 1e-3
    for B, casimirs, linear in ((one_of_each, (A,), (b,)), (two_linear, (), (OTHER, b))):
        S = CommutingStructure(B, quartic_gradient, squared, casimirs, linear)
        together = S(y)
        for n in range(7):
            at, matrix = y[:, n], S(y[:, n])
            field = B(at) @ squared(at)
            # Gram and Schmidt's vectors, orthogonal to eps over the sine of the angles between ∇C
            # and ∇H: 10⁻³ and more here; S is two of them divided by the square of the third's
            # length.
            size = np.abs(matrix).max() + np.abs(B(at)).max()
            assert np.allclose(together[:, :, n], matrix, rtol=0, atol=1e3 * EPS * size)
            assert np.array_equal(matrix, -matrix.T)
            assert field.any()
            off = np.abs(matrix @ quartic_gradient(at) - field).max()
            assert off < 1e3 * EPS * size * np.abs(squared(at)).max()
            for slope in [2 * C @ at for C in casimirs] + list(linear):
                assert np.abs(matrix @ slope).max() < 1e3 * EPS * size * np.abs(slope).max()


def test_structures_of_eight_components_have_the_bits_of_their_states() -> None:
    """From eight on `np.sum` adds the components of a single state in pairs."""
    rng = np.random.default_rng(0)
    M, y = rng.standard_normal((8, 8)), rng.standard_normal((8, 50))
    B = lambda y: np.multiply.outer(M - M.T, np.ones(y.shape[1:]))  # noqa: E731
    S = CommutingStructure(B, lambda y: y**3, lambda y: y * y, (M + M.T,), (M[0],))
    assert np.array_equal(S(y), np.concatenate([S(y[:, [n]]) for n in range(50)], axis=-1))


def test_where_the_drift_rests_the_structure_vanishes() -> None:
    """∇H_0 = 0 at the origin, where ∇C_1 vanishes too; and in a batch beside states that move."""
    S = CommutingStructure(one_of_each, quartic_gradient, squared, (A,), (b,))
    y = np.array([[0.0, 0.3, 3.0], [0.0, -0.7, 1.0], [0.0, 0.2, -2.0], [0.0, 0.1, 0.5]])
    both, bounds = S(y), S.majorant(y)
    assert not both[:, :, 0].any()
    assert not bounds[:, :, 0].any()
    for n in (1, 2):
        assert both[:, :, n].any()
        assert np.array_equal(both[:, :, n], S(y[:, n]))
        assert np.array_equal(bounds[:, :, n], S.majorant(y[:, n]))
    # A steady rotation of the rigid body: ∇H_0 is that of the Casimir, and no term vanishes but
    # their sum.
    drift = problems.rigid_body()
    turning = commuting_hamiltonians(drift, [lambda y: 2 * drift.hamiltonian(y) * drift.gradient(y)])
    (G,) = turning.noise_structures
    assert isinstance(G, CommutingStructure)
    axis = np.array([0.0, 0.0, 1.0])
    assert not G(axis).any()
    assert not G.majorant(axis).any()


def of_actions(H: poly.Polynomial, noise: poly.Polynomial) -> StructuresProblem:
    problem = problems.build(commuting_actions(H, [noise]))
    assert isinstance(problem, StructuresProblem)
    return replace(problem, closed_form=closed_form(H, (1.0,), [poly.gradient(noise)]), check=False)


def critical_plane() -> StructuresProblem:
    """H_0 = I_1, H_1 = I_2: the first plane may rest at its critical points while the second
    turns.
    """
    return of_actions(poly.variable(2, 0), poly.variable(2, 1))


def critical_circle() -> StructuresProblem:
    """H_0 = ½(I − 1)² up to a constant, H_1 = I: a circle of radius √2 of critical points,
    on which the noise turns.
    """
    return of_actions(poly.polynomial(1, {(2,): 0.5, (1,): -1.0}), poly.variable(1, 0))


@settings(max_examples=25)
@given(_RANDOM.map(critical_step))
def test_steps_from_critical_points_of_the_energy_are_refused_where_a_noise_acts(case: Case) -> None:
    problem, y, h, dW = case.build()
    with pytest.raises(StepFailure, match="a structure is undefined") as refused:
        schemes.several_structures.step(problem, y, h, dW)
    assert "critical point of H_0" in str(refused.value)
    with pytest.raises(StepFailure, match="a structure is undefined"):
        reference_step(equation_for(Systems.SEVERAL), case.problem, case.y, h, case.dW)
    # Without noise the drift rests, and so does the step.
    assert np.array_equal(schemes.several_structures.step(problem, y, h, 0 * dW), y)


def test_an_ensemble_says_of_each_lane_whether_its_structure_is_defined() -> None:
    """Of the states (0, 0, 1, 0) and its neighbours, only the first has no structure: |w| is small,
    but known.
    """
    problem, dW = critical_plane(), np.full((1, 4), 0.1)
    y = np.array([[0.0, 1e-9, 1e-170, 0.5], [0.0] * 4, [1.0] * 4, [0.0] * 4])
    solution = schemes.several_structures.solve(problem, y, 0.01, dW)
    assert solution.status.tolist() == [Status.UNDEFINED, 0, 0, 0]
    # H_1 is quadratic: the midpoint rule turns the second plane by 2 atan(ΔW/2).
    angle = 2 * np.arctan(0.05)
    turned = np.array([[np.cos(angle)], [np.sin(angle)]])
    assert np.abs(solution.value[2:, 1:] - turned).max() <= 4 * EPS
    run = {"h": 1 / 8, "T": 1.0, "paths": 3, "y0": (0.0, 0.0, 1.0, 0.0)}
    ends = sepv.ensemble(schemes.several_structures, problem, **run)
    assert ends.status.tolist() == [Status.UNDEFINED] * 3
    assert ends.failed_step.tolist() == [0] * 3


@pytest.mark.parametrize("distance", [0.0, 1e-4])
def test_next_to_a_curved_set_of_critical_points_no_wrong_step_passes(distance: float) -> None:
    """S_1∇̄H_0 turns by two thirds of the angle there, whatever h:
    no path of 64 gets through with status 0.
    """
    problem, y0 = critical_circle(), (np.sqrt(2.0) + distance, 0.0)
    for steps in (8, 128):
        ends = sepv.ensemble(schemes.several_structures, problem, h=1 / steps, T=1.0, paths=64, y0=y0)
        assert (ends.status != 0).all()
        assert Status.UNDEFINED in ends.status


def test_away_from_critical_points_steps_next_to_them_converge() -> None:
    """Half of the radius outside the circle: a quarter of the error for a quarter of the step,
    within two.
    """
    problem, y0 = critical_circle(), np.array([1.5 * np.sqrt(2.0), 0.0])
    error = []
    for steps in (64, 256):
        dW = sepv.simulate.increments(2, T=1.0, steps=steps, noises=1, paths=64)
        ends = sepv.ensemble(schemes.several_structures, problem, h=1 / steps, T=1.0, dW=dW, y0=y0)
        assert not ends.status.any()
        assert problem.closed_form is not None
        apart = ends.y - problem.closed_form(y0, 1.0, dW.sum(axis=0))
        error.append(float(np.sqrt(np.mean(np.sum(apart**2, axis=0)))))
    assert error[0] < 0.1
    assert 2 < error[0] / error[1] < 8


def test_a_third_partys_scheme_meets_no_number_where_there_is_no_structure() -> None:
    (S,) = critical_plane().noise_structures
    y = np.array([[0.0, 0.0, 1.0], [0.0] * 3, [1.0, 0.0, 1.0], [0.0] * 3])
    matrices = S(y)
    assert np.isnan(matrices[:, :, 0]).all()
    assert not matrices[:, :, 1].any()  # all flows rest
    assert np.isfinite(matrices[:, :, 2]).all()
    # A rigid body with equal moments of inertia: ∇H_0 is that of |y|²/2 on the equator, up to
    # roundings.
    top = problems.rigid_body(inertia=(1.0, 1.0, 0.5))
    about = commuting_hamiltonians(top, [lambda y: np.stack([0 * y[0], 0 * y[0], 1 + 0 * y[0]])])
    turn = np.array([[np.cos(0.7), np.cos(0.7)], [np.sin(0.7), np.sin(0.7)], [0.0, 0.1]])
    found = about.noise_structures[0](turn)
    assert np.isnan(found[:, :, 0]).all()
    assert np.isfinite(found[:, :, 1]).all()


def test_roundings_of_a_commuting_structure_are_relative_to_its_terms() -> None:
    """2(M_v M_gᵀ + M_g M_vᵀ)/|w|² by hand: H_0 = |y|²/2 and H_1 = 25/2 |y|² at (3, −4),
    v = B∇H_1 = 25(−4, −3).
    """
    turn = lambda y: np.array([[0.0, -1.0], [1.0, 0.0]])  # noqa: E731
    y = np.array([3.0, -4.0])
    plain = CommutingStructure(turn, lambda y: y, lambda y: 25 * y)
    # M_v = 25(4, 3), M_g = (3, 4), |w|² = 25.
    expected = 2 * np.array([[2 * 12, 9 + 16], [9 + 16, 2 * 12]])
    assert np.allclose(plain.majorant(y), expected, rtol=4 * EPS, atol=0)
    assert np.all(np.abs(plain(y)) <= plain.majorant(y))


def oscillator(**known: object) -> sepv.Problem:
    return replace(problems.harmonic_oscillator(), check=False, **known)


def test_brackets_are_judged_beside_their_terms() -> None:
    """A large H_1 that commutes up to rounding is taken, a tiny one that does not is refused:
    in any unit.
    """
    for unit in (1e-14, 1e14):
        tilted = oscillator(
            gradient=lambda y: np.stack([y[0] + 0.1 * y[1], 0.1 * y[0] + 1.3 * y[1]]),
            hamiltonian=lambda y: 0.5 * y[0] ** 2 + 0.1 * y[0] * y[1] + 0.65 * y[1] ** 2,
        )
        commuting_hamiltonians(tilted, [lambda y, tilted=tilted, unit=unit: unit * tilted.gradient(y) / 3])
        with pytest.raises(ProblemError, match=r"H_2.* = 0 everywhere"):
            commuting_hamiltonians(
                tilted,
                [tilted.gradient, lambda y, unit=unit: unit * np.stack([1 + 0 * y[0], 0 * y[1]])],
            )
    with pytest.raises(ProblemError, match="nan"):
        commuting_hamiltonians(oscillator(), [lambda y: np.full_like(y, np.nan)])
    commuting_hamiltonians(oscillator(), [np.zeros_like])


def test_brackets_are_asked_for_around_the_initial_state_and_inside_the_domain_only() -> None:
    """H_1 that commutes but for a bump: at the initial state, beside it, where there is a
    domain.
    """

    def bump(where: Callable[[np.ndarray], bool]) -> Callable[[np.ndarray], np.ndarray]:
        return lambda y: y + (np.array([1.0, 0.0]) if where(y) else 0.0)

    far = np.array([30.0, -40.0])
    for where in (lambda y: np.array_equal(y, far), lambda y: 0 < np.abs(y - far).max() < 11):
        with pytest.raises(ProblemError, match="flow keeps H_0"):
            commuting_hamiltonians(oscillator(initial=far), [bump(where)])
    commuting_hamiltonians(oscillator(domain=lambda y: y[0] > 0), [bump(lambda y: y[0] <= 0)])
    with pytest.raises(ProblemError, match="contains the initial state"):
        commuting_hamiltonians(oscillator(domain=lambda y: y[0] > 1e9), [np.zeros_like])
