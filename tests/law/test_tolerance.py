"""The derived bounds against numbers worked out by hand, and against rounding as it happens."""

import math
from dataclasses import replace
from typing import Any

import mpmath
import numpy as np
import pytest
from sepv.properties.test_reference import QUADRATURE_NODES, quadrature_rounding

import sepv
from sepv import problems, schemes
from sepv.core.arrays import EPS, TINY
from sepv.core.formula import counted
from sepv.law import amplification as amplified
from sepv.law import tolerance
from sepv.law.cases.classes import CLASSES
from sepv.law.contraction import CONTRACTION, _spectral_norm, contraction_ball, contraction_radius
from sepv.problem import PolynomialSystem, StructuresProblem, Systems, average_gradient
from sepv.problem._enclosures import recorded
from sepv.record import PolynomialMap
from sepv.record import _polynomial as poly
from sepv.schemes import _energy_preserving as energy_preserving
from sepv.schemes import _gonzalez as gonzalez
from sepv.schemes import _itoh_abe as itoh_abe
from sepv.schemes._tableaux import amplification
from sepv.verification import Case

# The same formula in another order: a dozen operations on numbers that do not cancel.
SAME = 12 * EPS


def cancelling() -> sepv.Problem:
    """H = y1³ − 3y1²y2 + y3 with B12 = y3 − 2y1y2, B13 = −y1, B23 = 0: terms that cancel,
    and a constant one.
    """
    H = poly.polynomial(3, {(3, 0, 0): 1.0, (2, 1, 0): -3.0, (0, 0, 1): 1.0})
    B = (
        (0, 1, poly.polynomial(3, {(0, 0, 1): 1.0, (1, 1, 0): -2.0})),
        (0, 2, poly.polynomial(3, {(1, 0, 0): -1.0})),
    )
    return problems.polynomial_problem(PolynomialSystem(3, H, B, noise=(0.5, 2.0)))


def plain(problem: sepv.Problem, **known: Any) -> sepv.Problem:
    """The same as functions, of which no terms are known."""
    parts = {"structure": problem.structure.__call__, "gradient": problem.gradient.__call__}
    return replace(problem, check=False, **{**parts, **known})


def test_majorants_of_polynomials_are_sums_of_absolute_terms() -> None:
    """∇H = (3y1² − 6y1y2, −3y1², 1) vanishes in its first component where y1 = 2y2;
    its terms do not.
    """
    problem, y, x = cancelling(), np.array([2.0, 1.0, -3.0]), np.array([-1.0, 0.5, 8.0])
    assert problem.gradient(y).tolist() == [0.0, -12.0, 1.0]
    assert tolerance.gradient_majorant(problem, y).tolist() == [24.0, 12.0, 1.0]
    assert tolerance.gradient_majorant(problem, x).tolist() == [6.0, 3.0, 1.0]
    B = tolerance.structure_majorant(problem, y)
    assert B.tolist() == [[0, 7, 2], [7, 0, 0], [2, 0, 0]]
    both = tolerance.structure_majorant(problem, y, x)
    # At the corner (2, 1, 8) of the box: 8 + 2·2·1, and not the larger of 3 + 2·2·1 and 8 + 2·1·½
    # at the ends.
    assert both.tolist() == [[0, 12, 2], [12, 0, 0], [2, 0, 0]]
    assert tolerance.gradient_majorant(problem, x, y).tolist() == [24.0, 12.0, 1.0]
    assert tolerance.gradient_majorant(problem, x, y, beyond=1.0).tolist() == [3 * 9 + 6 * 3 * 2, 3 * 9, 1]


def test_majorants_of_functions_are_what_a_rounding_of_y_does() -> None:
    """|∇H| + |H″||y| and |B| + |B′||y|; by differences where no derivatives are given."""
    problem, y = cancelling(), np.array([2.0, 1.0, -3.0])
    known = plain(problem)
    # H″ = [[6y1 − 6y2, −6y1], [−6y1, 0]] in y1, y2.
    assert tolerance.gradient_majorant(known, y).tolist() == [0 + 6 * 2 + 12 * 1, 12 + 12 * 2, 1]
    # B12 = −7 with slopes (−2, −4, 1), B13 = −2 with slope −1.
    assert tolerance.structure_majorant(known, y).tolist() == [[0, 7 + 4 + 4 + 3, 4], [18, 0, 0], [4, 0, 0]]
    bare = plain(problem, hessian=None, structure_derivative=None)
    # Differences know H″ to about √eps of ∇H.
    for at in (y, np.array([1.0, -1.0, 0.0])):
        found, exact = tolerance.gradient_majorant(bare, at), tolerance.gradient_majorant(known, at)
        assert np.allclose(found, exact, rtol=1e-6, atol=0)
    found, exact = tolerance.structure_majorant(bare, y), tolerance.structure_majorant(known, y)
    assert np.allclose(found, exact, rtol=1e-6, atol=0)
    # The pendulum: ∇H = (p, sin q) and H″ = diag(1, cos q), at states of either sign.
    for p, q in ((-2.0, -1.0), (3.0, 2.5)):
        found = tolerance.gradient_majorant(problems.pendulum(), np.array([p, q]))
        size = [2 * abs(p), abs(np.sin(q)) + abs(np.cos(q) * q)]
        assert np.allclose(found, size, rtol=SAME, atol=0)


def test_operations_are_those_that_the_derivation_counts() -> None:
    """4(2ν + T + d + 8) for one stage; more stages add their sums and amplify errors of ∇H."""
    problem = cancelling()  # ν = 3 for H, at most two terms a component, d = 3
    assert tolerance.operations(problem) == 4 * (2 * 3 + 2 + 3 + 8)
    # s = 2: ⌈2·3/2⌉ = 3 nodes.
    assert tolerance.operations(problem, 2) == amplification(2) * (4 * 19 + 4 * (2 + 3))
    # B of degree 4 counts as H of degree 5 would, and so does a B of five terms.
    steep = poly.polynomial(3, dict.fromkeys(((n, 0, 0) for n in range(5)), 1.0))
    data = replace(problem.data, structure=((0, 1, steep),))
    assert tolerance.operations(problems.polynomial_problem(data)) == 4 * (2 * 5 + 5 + 3 + 8)
    # For functions: ν = 2, T = 6, and 2(s + 4) nodes. One function among them is enough.
    assert tolerance.operations(problems.pendulum()) == 4 * (4 + 6 + 2 + 8)
    assert tolerance.operations(problems.pendulum(), 3) == amplification(3) * (80 + 4 * (3 + 14))
    for part in ("gradient", "structure"):
        known = replace(problem, check=False, **{part: getattr(plain(problem), part)})
        assert tolerance.operations(known) == 4 * (4 + 6 + 3 + 8)


def test_the_residual_has_the_size_of_the_state_of_the_step_and_of_the_solver() -> None:
    """K eps/2 (max|y| + |Δ|₁ M_B M_g), in a case where each part has a value of its own."""
    problem = cancelling()
    y0, y1 = np.array([2.0, 1.0, -3.0]), np.array([-1.0, 0.5, -8.0])
    h, dW = -0.25, np.array([-0.5, 0.125])
    length = 0.25 + 0.5 * 0.5 + 2 * 0.125
    # M_B and M_g as above: M_B M_g = (12·12 + 2·1, 12·24, 2·24).
    flow = np.array([146.0, 288.0, 48.0])
    expected = 0.5 * EPS * 4 * 19 * (8 + length * flow)
    found = tolerance.step_residual(problem, y0, y1, h, dW)
    assert np.allclose(found, expected, rtol=SAME, atol=0)
    assert np.array_equal(tolerance.step_residual(problem, y1, y0, h, dW), found)
    owned = replace(schemes.energy_preserving, solver_tolerance=1e-6)
    lazy = tolerance.step_residual(problem, y0, y1, h, dW, owned)
    assert np.allclose(lazy - found, 8e-6, rtol=SAME, atol=0)
    twice = tolerance.step_residual(problem, y0, y1, h, dW, schemes.collocation(2))
    # Two stages leave the segment by at most ¼ of 5, the largest |y1 − y0|: M_g = (51.1875,
    # 31.6875, 1) at (3.25, 2.25, 9.25), and M_B12 = 9.25 + 2·3.25·2.25, M_B13 = 3.25.
    B12, B13, g = 23.875, 3.25, (75.5625, 31.6875, 1.0)
    wider = np.array([B12 * g[1] + B13 * g[2], B12 * g[0], B13 * g[0]])
    expected = 0.5 * EPS * tolerance.operations(problem, 2) * (8 + length * wider)
    assert np.allclose(twice, expected, rtol=SAME, atol=0)
    assert np.all(tolerance.step_residual(problem, 0 * y0, 0 * y0, 0.0, 0 * dW) == TINY)
    starts, ends = np.stack([y0, y1, 0 * y0], axis=1), np.stack([y1, 0 * y0, y0], axis=1)
    noise = np.stack([dW, 0 * dW, 2 * dW], axis=1)
    batch = tolerance.step_residual(problem, starts, ends, h, noise)
    for k in range(3):
        alone = tolerance.step_residual(problem, starts[:, k], ends[:, k], h, noise[:, k])
        assert np.array_equal(batch[:, k], alone)


@pytest.mark.parametrize("small", [0.01, 0.003, 0.001])
def test_the_bound_of_energy_covers_a_step_along_which_the_gradient_vanishes_at_both_ends_alone(
    small: float,
) -> None:
    """H = y1y2y3 from (1, δ, δ) to (δ, 1, δ): the averaged ∇H is (y2y3, y1y3, y1y2)
    = (δ/2, δ/2, 1/6) nearly.

    With the majorant at the ends, half of the allowed residual exceeded the bound 1.9 to 20 times.
    """
    ones = ((0, 1, poly.constant(3, 1.0)), (0, 2, poly.constant(3, 1.0)), (1, 2, poly.constant(3, 1.0)))
    problem = problems.build(PolynomialSystem(3, poly.polynomial(3, {(1, 1, 1): 1.0}), ones, (1.0,)))
    y0, y1 = np.array([1.0, small, small]), np.array([small, 1.0, small])
    r = tolerance.step_residual(problem, y0, y1, 0.5, np.array([0.5]))
    mean = average_gradient(problem, y0, y1).value
    assert mean @ r / 2 <= tolerance.energy_bound(problem, y0, y1, r)
    ends = np.max([problem.gradient(y0), problem.gradient(y1)], axis=0)
    assert mean @ r / 2 > 1.9 * (ends @ r)


@pytest.mark.parametrize("name", ["pendulum", "lotka-volterra", "kepler", "pendulum-chain"])
def test_majorants_of_functions_bound_the_terms_on_the_whole_segment(name: str) -> None:
    """At 33 states between y0 and y1, drawn around the initial state;
    nowhere below the value at the ends.
    """
    problem, rng = problems.by_name(name), np.random.default_rng(3)
    start = np.asarray(problem.initial)
    for _ in range(20):
        y0, y1 = start * (1 + 0.3 * rng.uniform(-1, 1, (2, start.size)))
        g, B = tolerance.gradient_majorant(problem, y0, y1), tolerance.structure_majorant(problem, y0, y1)
        for y in np.linspace(y0, y1, 33):
            assert np.all(np.abs(problem.gradient(y)) <= g * (1 + SAME))
            assert np.all(np.abs(problem.structure(y)) <= B * (1 + SAME))
        for y in (y0, y1):
            assert np.all(tolerance.gradient_majorant(problem, y) <= g * (1 + SAME))
        assert np.all(np.isfinite(g))
        assert np.all(np.isfinite(B))


@pytest.mark.parametrize("small", [0.01, 0.003, 0.001])
def test_majorants_of_functions_that_hide_their_operations_are_estimates_never_below_the_ends(
    small: float,
) -> None:
    """H = y1y2y3 by functions of floats: nine states of the segment from (1, δ, δ) to (δ, 1, δ)
    bound its mean ∇H.
    """

    def gradient(y: Any) -> Any:
        a, b, c = (np.asarray(v, dtype=float) for v in y)  # symbols are no floats
        return np.array([b * c, a * c, a * b])

    def hamiltonian(y: Any) -> Any:
        return np.prod(np.asarray(y, dtype=float), axis=0)

    problem = sepv.Problem(
        3, lambda y: np.zeros((3, 3, *np.shape(y)[1:])), hamiltonian, gradient=gradient, check=False
    )
    y0, y1 = np.array([1.0, small, small]), np.array([small, 1.0, small])
    bound = tolerance.gradient_majorant(problem, y0, y1)
    assert recorded(problem.gradient, 3) is None
    for y in (y0, y1):
        assert np.all(tolerance.gradient_majorant(problem, y) <= bound)
    mean = np.array([small * (1 + small) / 2, small * (1 + small) / 2, (1 + 4 * small + small**2) / 6])
    assert np.all(mean <= bound)


def test_several_structures_have_the_residual_of_the_largest() -> None:
    drift, y, x = cancelling(), np.array([1.0, 1.0, 0.0]), np.array([2.0, 1.0, -3.0])
    B = drift.structure

    def terms(*factors: float) -> np.ndarray:
        """What the residual has beside the state itself, max|y| = 3, for G_j = factor · B."""
        several = StructuresProblem(
            3, B, drift.hamiltonian, drift.gradient, noise=(1.0,) * len(factors), check=False,
            noise_structures=tuple(
                PolynomialMap((3, 3), tuple(poly.scale(f, p) for p in B.rows)) for f in factors
            ),
        )  # fmt: skip
        dW = np.resize([0.1, 0.0], len(factors))
        residual = tolerance.step_residual(several, y, x, 0.1, dW)
        return residual / (0.5 * EPS * tolerance.operations(drift)) - 3

    for factors in ((-3.0,), (0.5, 3.0), (3.0, 0.0)):
        assert np.allclose(terms(*factors), 3 * terms(0.5), rtol=SAME, atol=0)


def test_bounds_of_invariants_are_attained() -> None:
    """A change of y by ±r, each sign the worst, changes a linear H and C,
    and to first order C = yᵀAy, by the bound.
    """
    H = poly.polynomial(2, {(1, 0): 3.0, (0, 1): -4.0})
    problem = problems.build(PolynomialSystem(2, H, ((0, 1, poly.constant(2, 1.0)),)))
    y, r = np.array([0.5, -2.0]), np.array([1e-3, 1e-5])
    assert tolerance.energy_bound(problem, y, y, r) == pytest.approx(3e-3 + 4e-5, rel=SAME, abs=0)
    linear = tolerance.casimir_bound(np.array([2.0, -5.0]), y, y, r)
    assert linear == pytest.approx(2e-3 + 5e-5, rel=SAME, abs=0)
    A = np.array([[1.0, -3.0], [-3.0, 0.5]])
    slope = 2 * A @ y  # (13, −5) with terms (1 + 12, 3 + 2): nothing cancels
    for end, times in ((y, 1), (3 * y, 2)):
        bound = tolerance.casimir_bound(A, y, end, r)
        assert bound == pytest.approx(times * float(np.abs(slope) @ r), rel=SAME, abs=0)
    none = np.zeros(2)
    assert tolerance.energy_bound(problem, y, y, none) == TINY
    assert tolerance.casimir_bound(A, y, y, none) == tolerance.casimir_bound(A[0], y, y, none) == TINY
    batch = tolerance.energy_bound(problem, np.stack([y, y], 1), np.stack([y, y], 1), np.stack([r, none], 1))
    assert batch.tolist() == [tolerance.energy_bound(problem, y, y, r), TINY]


def test_units_are_what_one_rounding_of_y_does() -> None:
    """eps |∇I| |y|, the larger of both states; a multiple of the smallest number where that
    vanishes.
    """
    oscillator, small, large = problems.harmonic_oscillator(), np.array([3.0, -4.0]), np.array([-8.0, 6.0])
    for y0, y1, size in ((small, small, 25), (small, large, 100), (large, small, 100)):
        assert tolerance.energy_ulp(oscillator, y0, y1) == pytest.approx(EPS * size, rel=SAME, abs=0)
        assert tolerance.casimir_ulp(np.eye(2), y0, y1) == pytest.approx(2 * EPS * size, rel=SAME, abs=0)
        linear = tolerance.casimir_ulp(np.array([0.0, 2.0]), y0, y1)
        assert linear == pytest.approx(2 * EPS * np.sqrt(size), rel=SAME, abs=0)
    assert tolerance.energy_ulp(oscillator, 0 * small, 0 * small) == EPS * TINY
    assert tolerance.casimir_ulp(np.eye(2), 0 * small, 0 * small) == EPS * TINY
    batch = tolerance.energy_ulp(oscillator, np.stack([small, large], 1), np.stack([large, large / 2], 1))
    assert np.allclose(batch, EPS * 100, rtol=SAME, atol=0)
    assert tolerance.state_ulp(small) == 4 * EPS
    assert tolerance.state_ulp(small, large) == tolerance.state_ulp(large, small) == 8 * EPS
    assert tolerance.state_ulp(0 * small) == EPS * TINY


def test_the_walk_is_that_of_sums_that_are_rounded() -> None:
    """y ↦ fl(y + z) with random z, in exact arithmetic: root mean square of 4000 roundings,
    which is known to 1.1 %.

    Spread evenly over ±½ulp, a rounding has the variance ulp²/12; its square has a relative spread
    of 0.9. Five such standard errors: a false alarm in two million.
    """
    rng = np.random.default_rng(7)
    y = np.array([1.3, 0.3, -5.0])[:, None] + 1e-3 * rng.standard_normal((3, 4000))
    z = 1e-3 * rng.standard_normal((3, 4000))
    slope = np.array([0.5, -3.0, 0.25])[:, None] * np.ones((1, 4000))
    total = y + z
    taken = total - y  # Knuth's two-sum: what the rounded sum lacks
    lost = (y - (total - taken)) + (z - taken)
    seen = float(np.sqrt(np.mean(np.sum(slope * lost, axis=0) ** 2)))
    assert tolerance.rounding_walk(slope, total) == pytest.approx(seen, rel=5 * 0.0142 / 2**0.5, abs=0)
    # ulps of 2⁻⁵², 2⁻⁵⁴ and 2⁻⁵⁰ with these slopes, and the mean of squares over states.
    exact = EPS * np.sqrt((0.5**2 + (3 / 4) ** 2 + (4 / 4) ** 2) / 12)
    assert tolerance.rounding_walk(slope, total) == pytest.approx(exact, rel=SAME, abs=0)
    two = tolerance.rounding_walk(np.array([[1.0, 7.0]]), np.array([[1.0, -1.0]]))
    assert two == pytest.approx(EPS * np.sqrt(25 / 12), rel=SAME, abs=0)


def test_nothing_is_predicted_where_the_walk_overflows() -> None:
    for slope, state in ((1e300, 1e300), (np.inf, 1.0), (np.nan, 1.0)):
        assert tolerance.rounding_walk(np.array([[slope]]), np.array([[state]])) == 0.0
    assert tolerance.rounding_walk(np.array([[1e100]]), np.array([[1.0]])) > 0


def test_errors_of_a_state_are_judged_in_their_worst_component() -> None:
    """The condition (I − ∂R/∂y1)⁻¹ turns residuals into errors,
    the rounding of y1 itself comes on top.
    """
    problem, y0, y1 = problems.harmonic_oscillator(), np.array([1.0, 2.0]), np.array([-4.0, 1.0])
    dW, condition = np.array([0.5]), np.array([[1.0, 2.0], [0.0, 3.0]])
    r = tolerance.step_residual(problem, y0, y1, 0.25, dW)
    bounds = condition @ r + EPS * np.array([4.0, 1.0])
    with mpmath.workdps(30):
        for k, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
            # Component k is off by 100 bounds of its own, the other by 99 of its own.
            off = sign * np.where(np.arange(2) == k, 100, 99) * bounds
            exact = [mpmath.mpf(float(v)) + mpmath.mpf(float(e)) for v, e in zip(y1, off, strict=True)]
            error, bound = tolerance.state_error(exact, condition, problem, y0, y1, 0.25, dW)
            assert bound == pytest.approx(bounds[k] / (4 * EPS), rel=SAME, abs=0)
            assert error == pytest.approx(100 * bound, rel=SAME, abs=0)
        exact = [mpmath.mpf(-4), mpmath.mpf(1)]
        for scheme in (replace(schemes.energy_preserving, solver_tolerance=1e-3), schemes.collocation(4)):
            r = tolerance.step_residual(problem, y0, y1, 0.25, dW, scheme)
            error, bound = tolerance.state_error(exact, np.eye(2), problem, y0, y1, 0.25, dW, scheme)
            assert error == 0
            assert bound == pytest.approx((r + EPS * np.array([4.0, 1.0]))[0] / (4 * EPS), rel=SAME, abs=0)


def test_another_quadrature_is_allowed_its_own_roundings_and_no_more() -> None:
    problem = problems.harmonic_oscillator()
    y, dW = np.array([0.2, 0.1]), np.array([750.0])
    allowed = quadrature_rounding(problem, y, y, 250.0, dW)
    # |Δ| M_B M_g = 1000 (0.1, 0.2), in units of u and times the number of nodes.
    assert allowed == pytest.approx(QUADRATURE_NODES * 2.0**-53 * 1000 * np.array([0.1, 0.2]))
    # Forty nodes in any order, weights rounded to nearest, are within it.
    rng = np.random.default_rng(0)
    for _ in range(20):
        weights = rng.dirichlet(np.ones(QUADRATURE_NODES - 2))
        total = np.float64(0)
        for w in weights:
            total += w * np.float64(0.1)
        exact = math.fsum(weights) * 0.1
        assert 1000 * abs(float(total) - exact) <= allowed[0]
    assert np.all(quadrature_rounding(problem, 1e300 * y, y, 1e300, dW) == 0)


@pytest.mark.parametrize(
    "scheme", [gonzalez, itoh_abe, energy_preserving], ids=["gonzalez", "itoh-abe", "(2.1)"]
)
def test_equations_of_steps_contract_inside_the_radius(scheme: Any) -> None:
    """R maps the ball into itself, and contracts by κ: in the largest component,
    for Gonzalez in the Euclidean norm.
    """
    rng, order = np.random.default_rng(2), 2 if scheme is gonzalez else np.inf
    for _, case in CLASSES[Systems.SINGLE].space.cases(1)[::4]:
        problem, y, _, _ = case.build()
        radius, r = contraction_ball(problem, y)
        pairs = rng.uniform(-r, r, (2, y.size, 24))
        pairs[1, :, ::2] = pairs[0, :, ::2] * (1 + 1e-4 * rng.standard_normal((y.size, 12)))
        step, at = np.full((1, 24), radius), np.repeat(y[:, None], 24, axis=1)
        first, second = (counted(scheme.formula, problem, at, at + z, step).value for z in pairs)
        assert np.all(np.abs(first).max(axis=0) <= r * (1 + 1e-9))
        moved, apart = (np.linalg.norm(v, ord=order, axis=0) for v in (first - second, pairs[0] - pairs[1]))
        assert np.all(moved <= tolerance.CONTRACTION * apart + 1e-12 * (r + np.abs(y).max()))


def test_the_spectral_norm_is_bounded_tightly() -> None:
    """By at most 5 % more than NumPy's, for matrices with zeros, of any scale,
    and for 0 and ∞ themselves.
    """
    rng = np.random.default_rng(0)
    for d in (2, 3, 9):
        A = rng.random((d, d, 40)) ** 3 * (rng.random((d, d, 40)) < 0.7) * 10.0 ** rng.integers(-90, 90, 40)
        exact, found = np.linalg.norm(A, ord=2, axis=(0, 1)), _spectral_norm(A)
        assert np.all(exact <= found * (1 + SAME))
        assert np.all(found <= 1.05 * exact)
    assert _spectral_norm(np.zeros((3, 3, 1))) == 0


def test_errors_of_a_contraction_are_amplified_by_no_more_than_the_bound() -> None:
    """‖(I − ∂R/∂y1)⁻¹‖ at the contraction radius: H = ½|y|² + ¼y2⁴, ∂R/∂y1 of (2.1) by
    differences.
    """
    H = poly.add(poly.squares((1, 1)), poly.polynomial(2, {(0, 4): 0.25}))
    data = PolynomialSystem(2, H, ((0, 1, poly.constant(2, -1.0)),), ())
    problem, y = problems.polynomial_problem(data), np.array([0.5, 1.0])
    case = Case(data, (0.5, 1.0), contraction_radius(problem, y), ())
    y1 = schemes.energy_preserving.step(problem, y, case.h, np.zeros(0))

    def right(end: np.ndarray) -> np.ndarray:
        nodes = zip((0.5 - 15**0.5 / 10, 0.5, 0.5 + 15**0.5 / 10), (5 / 18, 8 / 18, 5 / 18), strict=True)
        mean = sum(w * problem.gradient(y + t * (end - y)) for t, w in nodes)
        return case.h * problem.structure((y + end) / 2) @ mean

    slope = np.stack([(right(y1 + e) - right(y1 - e)) / 2e-6 for e in 1e-6 * np.eye(2)], axis=1)
    size = np.abs(np.linalg.inv(np.eye(2) - slope)).sum(axis=1).max()
    assert 1 < size <= amplified(schemes.energy_preserving, case)
    # R(z) = κz amplifies errors by 1/(1 − κ): no bound may be smaller.
    assert amplified(schemes.energy_preserving, case) >= 1 / (1 - CONTRACTION)


def test_the_ball_of_a_contraction_may_be_smaller_than_the_state() -> None:
    """H = ¼(y1⁴ + y2⁴) at y = 0: |∇H| ≤ r³ and |H″| ≤ 3r², so that the radius min(r⁻², κ/3r²)
    grows as r falls.
    """
    H = poly.polynomial(2, {(4, 0): 0.25, (0, 4): 0.25})
    problem = problems.polynomial_problem(PolynomialSystem(2, H, ((0, 1, poly.constant(2, -1.0)),), ()))
    radius, ball = contraction_ball(problem, np.zeros(2))
    assert ball == 2.0**-5
    assert radius == pytest.approx(min(1.0, CONTRACTION / 3) * 2.0**10)
