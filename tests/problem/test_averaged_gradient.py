"""The averaged gradient: its rules correctly rounded, exact to their degree, and what each reports of itself."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from drawn import by_hand

from sepv import problems
from sepv.problem import PolynomialSystem, Problem, average_gradient, average_hessian
from sepv.problem._averaged_gradient import FEW, _adaptive, _quadratures, _size, gauss_legendre
from sepv.record import EPS
from sepv.record import _polynomial as poly


@pytest.mark.parametrize("n", [1, 2, 3, 5, 12, 33])
def test_nodes_and_weights_are_correctly_rounded(n: int) -> None:
    """Against zeros of P_n at 60 digits, and weights 1/((1 − x²)P_n′(x)²) on [0, 1]."""
    ctx = mpmath.MPContext()
    ctx.dps = 60

    def legendre(x):
        before, now = ctx.mpf(1), x
        for k in range(1, n):
            before, now = now, ((2 * k + 1) * x * now - k * before) / (k + 1)
        return now, n * (x * now - before) / (x * x - 1)

    points, weights = gauss_legendre(n)
    for k in range(n):
        # Zero k of P_n lies near cos(π(4k + 3)/(4n + 2)), counted from above.
        x = ctx.cos(ctx.pi * (4 * (n - 1 - k) + 3) / (4 * n + 2))
        for _ in range(8):
            p, slope = legendre(x)
            x -= p / slope
        slope = legendre(x)[1]
        assert points[k] == float((1 + x) / 2)
        assert weights[k] == float(1 / ((1 - x * x) * slope * slope))


def monomial_energy(degree: int) -> Problem:
    """H = Σ of all monomials of one degree and below in two variables, B = J."""
    terms = {(i, j): 1.0 / (1 + i + 2 * j) for i in range(degree + 1) for j in range(degree + 1 - i) if i + j}
    H = poly.polynomial(2, terms)
    return problems.polynomial_problem(PolynomialSystem(2, H, ((0, 1, poly.constant(2, 1.0)),)))


Y0 = np.array([[0.3, -0.4, 2.0], [-0.2, 0.9, 1.0]])
Y1 = np.array([[0.8, -0.1, -1.0], [0.4, 1.1, 3.0]])


@pytest.mark.parametrize("degree", range(1, 9))
def test_polynomials_take_the_fewest_nodes_that_are_exact(degree: int) -> None:
    problem = monomial_energy(degree)
    found = average_gradient(problem, Y0, Y1)
    nodes = max(1, (degree + 1) // 2)
    assert found.evaluations.tolist() == [nodes] * 3
    assert found.error.tolist() == [0.0] * 3
    assert found.reliable.tolist() == [True] * 3
    assert found.reliable.dtype == bool
    ((fine, terms),) = _quadratures(problem, Y0, Y1, nodes + 3)
    assert np.all(np.abs(found.value - fine) <= 16 * EPS * _size(terms))
    hessian = average_hessian(problem, Y0, Y1)
    tau, weights = gauss_legendre(nodes + 3)
    exact = sum(w * t * problem.hessian(Y0 + t * (Y1 - Y0)) for t, w in zip(tau, weights, strict=True))
    scale = np.abs(exact).max(axis=(0, 1)) + 1
    assert np.all(np.abs(hessian - exact) <= 1e-14 * degree**2 * scale)
    # Many states at once have their nodes one after the other.
    many = average_hessian(problem, np.tile(Y0, 100), np.tile(Y1, 100))
    assert Y0.size <= FEW < 100 * Y0.size
    assert np.all(np.abs(many - np.tile(exact, 100)) <= 1e-14 * degree**2 * np.tile(scale, 100))


def steep(*widths: float) -> tuple[Problem, np.ndarray, np.ndarray]:
    """∇H = (1/(y1 + y2), 0) with y2 = w and y1 from 0 to 1, a lane for each w: the nearer the pole, the more nodes."""
    w = np.array(widths)
    problem = replace(
        problems.harmonic_oscillator(),
        mean_gradient=None, degree=None, hessian=None, structure_derivative=None,
        gradient=lambda y: np.stack([1 / (y[0] + y[1]), 0 * y[0]]), check=False,
    )  # fmt: skip
    return problem, np.stack([0 * w, w]), np.stack([1 + 0 * w, w])


def test_the_ladder_climbs_as_far_as_a_lane_needs_and_counts_its_rungs() -> None:
    """∫₀¹ dy/(y + w) = ln(1 + 1/w), for which Gauss rules converge the slower the smaller w is."""
    problem, y0, y1 = steep(1e4, 3.0, 0.3, 0.03, 1e-7)
    found = _adaptive(problem, y0, y1)
    rungs = {sum((4, 8, 16, 32, 64, 128)[:k]): k for k in range(2, 7)}
    assert set(found.evaluations.tolist()) <= set(rungs)
    climbed = [rungs[n] for n in found.evaluations.tolist()]
    assert climbed == sorted(climbed)
    assert (climbed[0], climbed[-1]) == (2, 6)
    assert len(set(climbed)) >= 4
    assert found.reliable.tolist() == [True, True, True, True, False]
    exact = np.log1p(1 / y0[1])
    assert np.all(np.abs(found.value[0] - exact)[:4] <= 256 * EPS * exact[:4])
    assert np.all(found.error[:4] <= 256 * EPS * exact[:4])
    assert found.error[4] > 1e-6
    assert found.reliable.dtype == bool
    # In other units it climbs just as far.
    for unit in (2.0**30, 2.0**-30):
        scaled = replace(problem, gradient=lambda y, c=unit: c * problem.gradient(y), check=False)
        assert _adaptive(scaled, y0, y1).evaluations.tolist() == found.evaluations.tolist()
    # A lane climbs as it does alone.
    for k in range(5):
        alone = _adaptive(problem, y0[:, k : k + 1], y1[:, k : k + 1])
        assert alone.value[0, 0] == found.value[0, k]
        assert alone.evaluations[0] == found.evaluations[k]
        assert alone.error[0] == found.error[k]


def test_rules_that_differ_by_the_rounding_of_their_argument_agree_and_a_kink_does_not() -> None:
    """sin q near 10⁶ is off by eps·10⁶, far more than a rounding of its own; the mean of sign p has no digits.

    The first lane agrees at once, the second by that allowance alone, the third not at all.
    """
    problem = by_hand(
        hamiltonian=lambda y: -np.cos(y[0]) + np.abs(y[1]),
        gradient=lambda y: np.stack([np.sin(y[0]), np.sign(y[1])]),
        hessian=lambda y: np.array([[np.cos(y[0]), 0 * y[0]], [0 * y[0], 0 * y[0]]]),
        check=False,
    )
    y0 = np.array([[0.1, 1e6, 0.1], [1.0, 1.0, -0.3]])
    y1 = y0 + np.array([[0.4, 0.4, 0.4], [0.0, 0.0, 1.0]])
    found = _adaptive(problem, y0, y1)
    assert found.reliable.tolist() == [True, True, False]
    assert found.error[1] > 64 * EPS  # more than the rules' own roundings
    alone = _adaptive(problem, y0[:, :2], y1[:, :2])
    assert alone.reliable.tolist() == [True, True]
