"""Lie algebras of matrices: their structures and Casimirs as data, and what two midpoint rules do to Casimirs."""

import numpy as np
import pytest
from sepv.properties._structures import is_poisson

from benchmarks.right_schemes import RIGHT
from sepv import problems, schemes
from sepv.problem import Systems
from sepv.problems import _matrix_algebras as algebras
from sepv.problems import from_json
from sepv.problems import to_json as problem_json
from sepv.verification import Verdict, load_laws
from sepv.verification._cases.case import to_json

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
    """tr P_1³ − tr P_0³ = ¼ tr (P_1 − P_0)³: odd powers about the middle, where ∇C·z = 0. So h² a path without noise,
    h with noise, whose steps have a length of √h each."""  # fmt: skip
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
    (law,) = load_laws(["any-casimir"])
    assert law.cases is not None
    fixed = list(law.cases.fixed[Systems.SINGLE]())
    assert {case.problem.dimension for case in fixed} == {4, 5}
    caught = [
        [law.replay(law, scheme, to_json(case)).verdict is Verdict.VIOLATED for case in fixed]
        for scheme in (RIGHT["exact-flow"], schemes.energy_preserving)
    ]
    assert not any(caught[0])
    assert sum(caught[1]) >= 10
