"""Moments E (φ − y0)^α of the exact solution φ after one step,
by the generator's series or by a splitting.

**Polynomial data.** The moments are the series Σ h^k/k! L^k g of the generator L in rational
numbers (`sepv.reference.generator`). For linear fields L keeps the degree of g, and the series is
computed fast. For other fields it has fewer terms, with an error of the order
h^(GENERATOR_MIN_TERMS + 1) or higher.

**Functions.** The splitting of S. Ninomiya and N. Victoir (Appl. Math. Finance 15, 2008),

    Q_h g = ½ E g(e^{½hf_0} e^{c_1√hξ_1f_1} … e^{c_m√hξ_mf_m} e^{½hf_0} y) + ½ E g(… the noises in
    the other order …),

is E g(φ) + C h³ + O(h⁴). Q_{h/2}² has a quarter of this C, so that (4 Q_{h/2}² − Q_h)/3 has an
error of O(h⁴). Expectations are products of Gauss-Hermite rules with n points, with an error of
O(h^n). Flows are solved to rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations_with_replacement, product

import numpy as np
from sepv.properties._orders.log_ode import runge_kutta
from sepv.reference.generator import is_linear, moments

from sepv.errors import Skipped
from sepv.problem import (
    Array,
    PolynomialSystem,
    Problem,
    drift,
    noise_field,
    one_hamiltonian,
)
from sepv.record import EPS
from sepv.schemes import DORMAND_PRINCE_8

# All monomials up to this degree are tested. Above it, powers of a few linear forms are tested
# instead.
FULL_DEGREE = 3
# The number of terms of the generator's series for linear fields: for h ≤ 2⁻⁶, h^9/9! is far below
# rounding.
GENERATOR_TERMS = 8
# The least number of terms for nonlinear fields. Orders up to 2 are visible above an error of h⁵.
GENERATOR_MIN_TERMS = 4
# The number of quadrature points in each variable, by the number of noises. More noises than these
# would need hours.
QUADRATURE_POINTS = {0: 1, 1: 6, 2: 5, 3: 4}
# The power of h in the error of the extrapolated splitting.
SPLITTING_POWER = 4
# The largest number of steps for a flow. The number is doubled until two results agree.
_FLOW_MAX_STEPS = 32


def exponents(dimension: int, degree: int = FULL_DEGREE) -> tuple[tuple[int, ...], ...]:
    """Return the exponents of all monomials of degree 1 to `degree`."""
    products = (combinations_with_replacement(range(dimension), k) for k in range(1, degree + 1))
    return tuple(tuple(chosen.count(i) for i in range(dimension)) for own in products for chosen in own)


def moments_at(
    problem: Problem, states: Array, sizes: list[float], degree: int = FULL_DEGREE
) -> tuple[list[Array], float]:
    """Return E (φ − y0)^α (A, S) at each step size for A exponents α,
    and the largest error of the flows used.

    If H is a function, step sizes down to the finest one with an infinite flow are left out, and
    moments are NaN if QUADRATURE_POINTS lacks the number of noises. Several structures must be data
    with linear fields, else `Skipped` is raised.
    """
    data = problem.data
    if isinstance(data, PolynomialSystem):
        return _by_series(problem, data, states, sizes, degree), 0.0
    if one_hamiltonian(problem):
        raise Skipped(f"{problem.name} has no closed form, and is not given as data")
    if problem.noises not in QUADRATURE_POINTS:
        count = len(exponents(problem.dimension, degree))
        return [np.full((count, states.shape[1]), np.nan)] * len(sizes), 0.0
    found: list[Array] = []
    worst = 0.0
    for h in sizes:
        values, error = _by_splitting(problem, states, h, degree)
        found = [*found, values] if np.all(np.isfinite(values)) else []
        worst = max(worst, error) if found else 0.0
    return found, worst


def _by_series(
    problem: Problem, data: PolynomialSystem, states: Array, sizes: list[float], degree: int
) -> list[Array]:
    linear = is_linear(data)
    if not linear and one_hamiltonian(problem):
        raise Skipped(
            f"{problem.name} has several structures, no closed form, and fields that are not linear"
        )
    terms = GENERATOR_TERMS if linear else max(GENERATOR_MIN_TERMS, degree // 2 + 2)
    asked = exponents(problem.dimension, degree)
    series = [moments(data, tuple(y.tolist()), asked, terms) for y in states.T]
    rows = np.array([[[float(v) for v in row] for row in one] for one in series])
    return [np.asarray(rows @ h ** np.arange(terms + 1.0)).T for h in sizes]


def _by_splitting(problem: Problem, states: Array, h: float, degree: int) -> tuple[Array, float]:
    """Return the extrapolated moments (A, S) of the splitting, and the error of its flows."""
    asked = exponents(problem.dimension, degree)
    start = states[..., None]
    whole, weights, first = _split(problem, start, h)
    half, halves, second = _split(problem, start, h / 2)
    twice, _, third = _split(problem, half, h / 2)
    products = np.multiply.outer(halves, halves).reshape(-1)
    rough = moments_of(whole - start, weights, asked)
    fine = moments_of(twice - start, products, asked)
    return (4 * fine - rough) / 3, 2 * max(first, second, third)


def moments_of(moved: Array, weights: Array, asked: tuple[tuple[int, ...], ...]) -> Array:
    """Return the moments E z^α (A, S) of z = `moved` (d, S, n) for the exponents α in `asked`."""
    powers = ([moved[i] ** a for i, a in enumerate(alpha)] for alpha in asked)
    return np.array([np.prod(factors, axis=0) @ weights for factors in powers])


def _split(problem: Problem, y: Array, h: float) -> tuple[Array, Array, float]:
    """Make a splitting step from y (d, S, n) to 2u nodes each. Return ends (d, S, n·2u), weights,
    the flows' error.
    """
    m, (d, S, n) = problem.noises, y.shape
    x, w = np.polynomial.hermite_e.hermegauss(QUADRATURE_POINTS[m])
    grid = np.array(list(product(range(x.size), repeat=m)), dtype=np.intp).reshape(-1, m).T
    weights = np.prod((w / w.sum())[grid], axis=0)
    u = weights.size
    times = np.sqrt(h) * np.tile(x[grid], (1, S * n))  # for each pair of a state and a node, nodes fastest
    y, error = _flow(lambda z: drift(problem, z), y.reshape(d, -1), np.full(S * n, 0.5 * h))
    lanes = np.repeat(y, u, axis=1)
    ends = []
    for order in (range(m), range(m)[::-1]):
        z = lanes
        for j in order:
            z, more = _flow(lambda z, j=j: noise_field(problem, j, z), z, problem.c[j] * times[j])  # type: ignore[misc]
            error = max(error, more)
        z, more = _flow(lambda z: drift(problem, z), z, np.full(S * n * u, 0.5 * h))
        error = max(error, more)
        ends.append(z.reshape(d, S, n, u))
    found = np.concatenate(ends, axis=3)
    return found.reshape(d, S, n * 2 * u), 0.5 * np.concatenate([weights, weights]), error


def _flow(field: Callable[[Array], Array], y: Array, times: Array) -> tuple[Array, float]:
    """Return a flow from y (d, M) over times (M,), and its error;
    steps of order 8 are halved until results agree.
    """

    def slope(z: Array) -> Array:
        return times * field(z)

    with np.errstate(all="ignore"):  # a step that is too long gives inf or NaN, which is detected
        found = runge_kutta(slope, y, 1, DORMAND_PRINCE_8)
        steps, error = 1, np.inf
        while steps < _FLOW_MAX_STEPS and error > 16 * EPS * np.max(np.abs(y)):
            steps *= 2
            finer = runge_kutta(slope, y, steps, DORMAND_PRINCE_8)
            error = float(np.max(np.abs(finer - found))) / 128 + 8 * EPS * float(np.max(np.abs(finer)))
            found = finer
    return found, error
