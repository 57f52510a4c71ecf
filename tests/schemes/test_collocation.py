"""Energy-preserving collocation: its coefficients, its solver, and what it reduces to."""

from dataclasses import replace
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from drawn import by_hand
from hypothesis import given
from hypothesis import strategies as st
from sepv.reference.arithmetic import decimal
from sepv.reference.steps import reference_step
from sepv.reference.tableau import stage_table

import sepv
from sepv import problems, schemes
from sepv.errors import StepFailure
from sepv.record import gauss_legendre
from sepv.schemes._tableaux import amplification, exact_nodes, gauss_tableau, lagrange, moments
from sepv.solve import Status
from sepv.verification import Case, Verdict, state_ulp, strategies, verify

STAGES = range(1, 7)
EPS = 2.0**-52


@pytest.mark.parametrize("s", STAGES)
def test_coefficients_are_right_to_two_roundings(s: int) -> None:
    table = stage_table(s, decimal(40))
    order = sorted(range(s), key=lambda i: table.c[i])
    A, b = [[table.a[i][j] for j in order] for i in order], [table.b[i] for i in order]
    found = gauss_tableau(s)
    for i in range(s):
        assert abs(float(b[i] - mpmath.mpf(float(found.b[i])))) <= EPS * found.b[i]
        for j in range(s):
            assert abs(float(A[i][j] - mpmath.mpf(float(found.A[i, j])))) <= EPS


@pytest.mark.parametrize("s", STAGES)
def test_averages_are_exact_up_to_the_degree_that_is_promised_and_not_beyond(s: int) -> None:
    """b_i⁻¹∫ℓ_i g for g of degree s(ν − 1), as ∇H∘u has, against twice as many nodes."""
    for degree in range(1, 7):
        n, power = exact_nodes(s, degree), s * (degree - 1)

        def averages(nodes: int, power: int = power) -> np.ndarray:
            return moments(s, nodes)[0] @ (2 * gauss_legendre(nodes)[0] - 0.75) ** power

        exact = averages(2 * n + s)
        # A node rounded by EPS/2 changes a power by 2·power·EPS/2; weights and sums a little more.
        size = 1.25**power
        assert np.max(np.abs(averages(n) - exact)) < (2 * power + 40) * EPS * size
        if n > s:  # with fewer nodes than stages even ℓ_i is not resolved
            assert np.max(np.abs(averages(n - 1) - exact)) > 1e-9


def test_what_averages_may_amplify_is_the_integral_of_a_lagrange_polynomial() -> None:
    """The largest b_i⁻¹∫|ℓ_i|, by 64 nodes about kinks: an error of some 64⁻²."""
    assert amplification(1) == pytest.approx(1.0, rel=1e-15)
    tau = (np.arange(100_000) + 0.5) / 100_000
    for s in STAGES:
        means = np.mean(np.abs(lagrange(s, tau)), axis=1) / gauss_tableau(s).b
        assert amplification(s) == pytest.approx(means.max(), rel=4e-3)


@given(strategies.steps(strategies.poisson_systems(degree=4, largest=4)), st.sampled_from(STAGES))
def test_newton_needs_no_derivatives_of_the_problem(case: Case, s: int) -> None:
    problem, y, h, dW = case.build()
    plain = replace(problem, hessian=None, structure_derivative=None, check=False)
    exact = np.array(reference_step(f"collocation-{s}", case.problem, case.y, h, case.dW, 30).y1, dtype=float)
    found = schemes.collocation(s).step(plain, y, h, dW)
    assert np.max(np.abs(found - exact)) <= 4 * state_ulp(y, exact)


@pytest.mark.parametrize("s", [2, 3, 6])
def test_energies_that_are_no_polynomials_are_kept_at_large_steps(s: int) -> None:
    """Adaptive quadrature: a fixed rule of eight nodes leaves 1e-5 in a logarithmic energy."""
    for name, h, allowed in (("pendulum", 0.25, 8), ("lotka-volterra", 2.0**-6, 40)):
        problem = problems.by_name(name)
        ends = sepv.ensemble(schemes.collocation(s), problem, h=h, T=1.0, paths=64, seed=3, engine="numpy")
        fine = ends.status == Status.CONVERGED
        assert fine.sum() >= 60
        assert ends.energy_defect[fine].max() <= allowed * EPS * np.sqrt(1 / h) * 4


def test_what_no_quadrature_resolves_is_reported_and_not_returned() -> None:
    """H = |y1| + …: the averages of its gradient never settle where the path crosses the kink."""
    problem = by_hand(
        hamiltonian=lambda y: abs(y[0]) + 0.5 * y[1] * y[1], gradient=lambda y: np.stack([np.sign(y[0]), y[1]]),
        noise=1.0, check=False,
    )  # fmt: skip
    with pytest.raises(StepFailure, match="not solved"):
        schemes.collocation(2).step(problem, np.array([0.1, 1.0]), 0.5, np.array([0.0]))


@pytest.mark.parametrize("s", STAGES)
def test_a_family_member_counts_its_work(s: int) -> None:
    """Rigid body: s nodes and s structures an iteration, and one of each for the start, which is an iteration."""
    for scheme in (schemes.collocation(s), schemes.gauss(s)):
        y = np.array([[0.8, 0.8, 1.0], [0.6, 0.1, 0.0], [0.1, 0.6, 0.0]])
        solution = scheme.solve(problems.rigid_body(), y, 0.01, np.array([[0.1, -0.2, 0.3]]))
        assert not solution.status.any()
        counts = solution.iterations - 1
        assert solution.gradient_evaluations.tolist() == (s * counts + 1).tolist()
        assert solution.structure_evaluations.tolist() == (s * counts + 1).tolist()
        assert np.array_equal(solution.value[:, 2], y[:, 2])  # at rest


def test_two_stages_keep_quadratic_invariants_by_their_rounded_coefficients() -> None:
    """b_i a_ij + b_j a_ji = b_i b_j exactly: rounded each by itself they moved H by 0.17 roundings a step."""
    A, b = ([[Fraction(v) for v in row] for row in np.atleast_2d(a).tolist()]
            for a in (gauss_tableau(2).A, gauss_tableau(2).b))  # fmt: skip
    assert all(b[0][i] * A[i][j] + b[0][j] * A[j][i] == b[0][i] * b[0][j] for i in (0, 1) for j in (0, 1))
    assert np.array_equal(moments(2, 2)[0], np.eye(2))
    own = replace(schemes.collocation(2), problems=(problems.harmonic_oscillator(),))
    (found,) = verify(own, laws=["rounding"]).findings
    assert found.verdict is Verdict.HOLDS, found
