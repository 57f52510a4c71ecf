"""Mechanical systems in parts as libraries want them, bodies that attract each other,
and Lie algebras of matrices.
"""

import numpy as np
import pytest
from sepv.properties._structures import is_poisson

from benchmarks.right_schemes import RIGHT_SCHEMES
from sepv import exact_flow, problems, schemes
from sepv.core.arrays import EPS
from sepv.law.cases.case import to_json
from sepv.law.cases.classes import CLASSES
from sepv.problem import Problem, Systems, mechanics
from sepv.problems import _matrix_algebras as algebras
from sepv.problems import from_json
from sepv.problems import to_json as problem_json
from sepv.verification import Verdict, load_laws

NAMED = (
    "henon-heiles", "pendulum-chain", "lennard-jones", "planets", "figure-eight", "harmonic-trap", "kepler", "pendulum",
    "toda",
)  # fmt: skip


def agrees(problem: Problem, y: np.ndarray) -> None:
    """The parts make H and the field again, for a state and a batch,
    and conversions are inverse to each other.
    """
    m = mechanics(problem)
    q, p = m.split(y)
    v, f = m.velocity(p), m.force(q)
    H = problem.hamiltonian(y)
    assert 0.5 * np.sum(p * v, axis=0) + m.potential(q) == pytest.approx(H, rel=1e-13, abs=1e-300)
    field = np.einsum("ij...,j...->i...", problem.structure(y), problem.gradient(y))
    np.testing.assert_allclose(m.join(v, f), field, rtol=1e-12, atol=1e-13 * np.max(np.abs(field)))
    np.testing.assert_allclose(m.momentum(v), p, rtol=1e-12, atol=1e-13 * np.max(np.abs(p)))
    assert np.array_equal(m.join(q, p), y)


@pytest.mark.parametrize("name", NAMED)
def test_named_problems_come_apart(name: str) -> None:
    problem = problems.by_name(name)
    y = np.asarray(problem.initial)
    agrees(problem, y)
    agrees(problem, np.stack([y, y * 1.01], axis=1))


def test_every_member_of_the_family_comes_apart_as_data_and_as_functions() -> None:
    seen = set()
    for _row, case in CLASSES[Systems.MECHANICAL].space.part().cases(5):
        problem, y, *_ = case.build()
        agrees(problem, y)
        m = mechanics(problem)
        assert m is mechanics(problem)
        assert m.positions_first
        assert np.array_equal(m.mass @ m.inverse_mass, np.eye(m.degrees)), "masses are exact"
        assert np.all(np.abs(m.mass) @ np.abs(m.inverse_mass) @ np.ones(m.degrees) <= 16), "masses are tame"
        p = m.split(y)[1]
        assert np.array_equal(m.momentum(m.velocity(p)), p), "and so are velocities"
        seen.add((bool(np.count_nonzero(m.mass - np.diag(np.diag(m.mass)))), case.given))
    assert len(seen) == 6, "diagonal and full masses, given in each way"


def test_a_potential_bounded_below_is_so() -> None:
    space = CLASSES[Systems.MECHANICAL].space.part({"V": ("bounded below",)})
    for _, case in space.cases(1):
        H = case.problem.hamiltonian
        n = H.dimension // 2
        assert all(c > 0 and all(k % 2 == 0 for k in e) for e, c in H.terms if not any(e[n:]))


def test_the_trap_has_its_closed_form() -> None:
    trap = problems.harmonic_trap((1.0, 3.0), noise=())
    flow = exact_flow(trap, np.array([0.7]))
    np.testing.assert_allclose(flow.y[:2, 0], [np.cos(0.7), np.cos(2.1) / 3], rtol=1e-12)


BODIES = [problems.planets(noise=()), problems.figure_eight(noise=())]
BODIES += [problems.planets((1000.0, 1.0), (2.0,), (0.3,), noise=())]


def momenta(y: np.ndarray) -> np.ndarray:
    """Total momentum and angular momentum of states y (d, M), as (3, M)."""
    q, p = (half.reshape(-1, 2, y.shape[1]) for half in np.split(y, 2))
    turning = (q[:, 0] * p[:, 1] - q[:, 1] * p[:, 0]).sum(axis=0)
    return np.concatenate([p.sum(axis=0), turning[None]])


@pytest.mark.parametrize("problem", BODIES, ids=lambda problem: f"{problem.name}-{problem.dimension}")
def test_the_flow_keeps_momentum_and_angular_momentum(problem: Problem) -> None:
    y = np.asarray(problem.initial)
    kept = momenta(np.column_stack([y, exact_flow(problem, np.array([0.5, 3.0])).y]))
    assert np.abs(kept[:2]).max() < 1e-13
    assert np.ptp(kept[2]) < 1e-13 * max(1.0, abs(kept[2, 0]))
    field = problem.structure(y) @ problem.gradient(y)
    assert np.abs(momenta((y + 1e-30j * field)[:, None]).imag).max() < 1e-30 * 64 * EPS


WITH_MEANS = [*BODIES, problems.kepler(), problems.toda()]


@pytest.mark.parametrize("problem", WITH_MEANS, ids=lambda problem: f"{problem.name}-{problem.dimension}")
def test_the_mean_gradient_is_that_of_fine_quadrature(problem: Problem) -> None:
    rng = np.random.default_rng(3)
    y0 = np.asarray(problem.initial)[:, None] + 0.01 * rng.standard_normal((problem.dimension, 20))
    y1 = y0 + 0.02 * rng.standard_normal(y0.shape)
    rule = np.polynomial.legendre.leggauss(24)
    fine = sum(w / 2 * problem.gradient(y0 + (1 + x) / 2 * (y1 - y0)) for x, w in zip(*rule, strict=True))
    assert problem.mean_gradient is not None
    mean = problem.mean_gradient(y0, y1)
    # Some dozens of roundings of the largest terms.
    assert np.abs(mean - fine).max() < 256 * EPS * np.abs(fine).max()


def test_a_light_planet_of_axis_1_has_the_period_2_pi() -> None:
    alone = problems.planets((1e9, 1.0), (1.0,), (0.2,), noise=())
    assert exact_flow(alone, np.array([2 * np.pi])).y[2:4, 0] == pytest.approx(alone.initial[2:4], abs=1e-8)


def test_the_eight_closes() -> None:
    """Simó's initial state has eight digits, and so has the period."""
    eight = problems.figure_eight(noise=())
    assert exact_flow(eight, np.array([6.32591398])).y[:, 0] == pytest.approx(eight.initial, abs=2e-7)


NAMES = ("so(3)", "2 so(3)", "so(4)", "so(5)", "su(3)", "su(4)")
TOPS = ("manakov-top", "su3-top", "zeitlin")


@pytest.mark.parametrize("name", NAMES)
def test_the_field_is_a_commutator_of_matrices(name: str) -> None:
    """B(y)m is [W, M], ⟨E*_a, W⟩ = y_a and ⟨M, W⟩ = mᵀy."""
    algebra, c = algebras.named(name), algebras.constants(name)
    rng = np.random.default_rng(0)
    y, m = rng.standard_normal((2, len(c), 5))
    W, M = algebra.matrix(y), algebra.dual_matrix(m)
    assert np.allclose(algebra.coordinates(W), y, atol=1e-15)
    B = np.einsum("abc,cm->abm", c, y)
    bracket = algebra.coordinates(W @ M - M @ W)
    assert np.allclose(bracket, np.einsum("abm,bm->am", B, m), rtol=1e-13, atol=1e-13)
    pairing = -0.5 * np.trace(W @ M, axis1=1, axis2=2).real.reshape(5, -1).sum(axis=1)
    assert np.allclose(pairing, np.sum(m * y, axis=0), rtol=1e-13)


@pytest.mark.parametrize("name", TOPS)
def test_the_structures_satisfy_jacobis_identity_and_all_is_data(name: str) -> None:
    problem = problems.by_name(name)
    assert is_poisson(problem, np.array(problem.initial))
    assert from_json(problem_json(problem)) == problem.data
    assert algebras.algebra_of(problem, np.array(problem.initial)[:, None]).copies == 1


def test_the_laplacian_of_zeitlins_truncation_has_the_eigenvalues_of_the_sphere() -> None:
    """l(l + 1) with multiplicity 2l + 1, l = 1 … N − 1: of ⟨W, Δ⁻¹W⟩ against ⟨W, W⟩."""
    problem = problems.zeitlin(5)
    C = problem.casimirs[0]
    values = np.sort(1 / np.linalg.eigvals(np.linalg.solve(C, problem.hessian(np.zeros(24)))).real)
    assert np.allclose(values, [l * (l + 1) for l in range(1, 5) for _ in range(2 * l + 1)], rtol=1e-10)
    assert len(problem.data.polynomial_casimirs) == 3  # tr P³, tr P⁴, tr P⁵


@pytest.mark.parametrize("name", TOPS)
def test_eigenvalues_are_kept_by_the_isospectral_rule_at_any_step(name: str) -> None:
    problem = problems.by_name(name)
    rng = np.random.default_rng(1)
    y = np.repeat(np.array(problem.initial)[:, None], 20, axis=1)
    algebra = algebras.algebra_of(problem, y)
    y1 = schemes.isospectral_midpoint.step(problem, y, 0.25, rng.standard_normal((2, 20)))
    before, after = (np.linalg.eigvalsh(algebra.matrix(v) / 1j) for v in (y, y1))
    assert np.abs(y1 - y).max() > 0.05
    assert np.abs(after - before).max() < 1e-14 * 8


def test_the_midpoint_rule_loses_the_third_casimir_by_a_formula() -> None:
    """tr P_1³ − tr P_0³ = ¼ tr (P_1 − P_0)³: odd powers about the middle, where ∇C·z = 0. So h² a
    path without noise, h with noise, whose steps have a length of √h each.
    """  # fmt: skip
    problem = problems.su3_top()
    rng = np.random.default_rng(2)
    y = np.repeat(np.array(problem.initial)[:, None], 20, axis=1)
    y1 = schemes.stochastic_midpoint.step(problem, y, 0.25, rng.standard_normal((2, 20)))
    P0, P1 = (algebras.unitary(3).matrix(v) / 1j for v in (y, y1))

    def cubed(P: np.ndarray) -> np.ndarray:
        return np.trace(P @ P @ P, axis1=1, axis2=2).real

    lost = cubed(P1) - cubed(P0)
    assert np.allclose(lost, 0.25 * cubed(P1 - P0), rtol=0, atol=1e-14)
    assert np.abs(lost).max() > 1e-4


def test_beyond_dimension_three_right_schemes_hold_and_2_1_is_caught() -> None:
    """The fixed systems of the law: d = 4 and 5 with all their Casimirs."""
    (law,) = load_laws(["invariant:casimir"])
    assert law.cases is not None
    fixed = list(law.cases.fixed[Systems.SINGLE]())
    assert {case.problem.dimension for case in fixed} == {4, 5}
    caught = [
        [law.replay(law, scheme, to_json(case)).verdict is Verdict.VIOLATED for case in fixed]
        for scheme in (RIGHT_SCHEMES["exact-flow"], schemes.energy_preserving)
    ]
    assert not any(caught[0])
    assert sum(caught[1]) >= 10
