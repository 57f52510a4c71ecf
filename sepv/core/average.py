"""The averaged gradient ∫₀¹ ∇H(y0 + τ(y1 − y0)) dτ of the scheme (2.1), exact to rounding.

A closed form is used if the problem gives one. For a polynomial H of degree ν, Gauss-Legendre
quadrature with ⌈ν/2⌉ nodes is exact, because the integrand has degree ν − 1 in τ. For any other H,
adaptive quadrature estimates its error. No fixed number of nodes suffices for all H: with eight
Gauss nodes, the energy of a logarithmic H has an error of 8e-5. A record of a Casimir is averaged
likewise.
"""

from __future__ import annotations

from decimal import Decimal, localcontext
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from sepv.core.arrays import EPS, Array, Flags, summed
from sepv.core.problem import System

# Numbers of nodes of the adaptive quadrature: the next is tried until two results agree. 128 nodes
# resolve integrands that are analytic within about a tenth of the segment's length.
_LADDER = (4, 8, 16, 32, 64, 128)
# The largest y.size for which one call evaluates H″ at all nodes; a larger one is no faster.
ONE_CALL_MAX_SIZE = 512


class Average(NamedTuple):
    """An averaged gradient, `value` (d, M), its evaluations of ∇H and an estimate of its error.

    `error` is 0 for a closed form or a polynomial H, else the difference between the last two
    quadrature results. `reliable` is True where the error is of the size of rounding. All but
    `value` are numbers, or arrays (M,) if paths differ.
    """

    value: Array
    evaluations: Any
    error: Any
    reliable: Any


def average_gradient(problem: System, y0: Array, y1: Array) -> Average:
    """The average ∫₀¹ ∇H(y0 + τ(y1 − y0)) dτ of ∇H from y0 to y1, for states (d, ...)."""
    if problem.mean_gradient is not None:
        value = problem.mean_gradient(y0, y1)
        return Average(value, 1, 0.0, True)
    if problem.degree is not None:
        nodes = mean_nodes(problem.degree)
        ((value, _),) = _quadratures(problem, y0, y1, nodes)
        return Average(value, nodes, 0.0, True)
    return _adaptive(problem, y0, y1)


def average_hessian(problem: System, y0: Array, y1: Array) -> Array | None:
    """The average's derivative (d, d, ...) by y1, ∫₀¹ τ H″(y0 + τ(y1 − y0)) dτ; None without H″.

    Only Newton's Jacobian uses the result. Three nodes therefore suffice if H is not a polynomial:
    the quadrature error changes the speed of Newton's iteration, but not its limit.
    """
    if problem.hessian is None:
        return None
    nodes = 3 if problem.degree is None else mean_nodes(problem.degree)
    points, weights = gauss_legendre(nodes)
    factors = weights * points
    total = np.zeros((problem.dimension, *y0.shape))
    if y0.size <= ONE_CALL_MAX_SIZE:  # all nodes in one call
        terms = problem.hessian(_on_segment(y0, y1, points)) * factors.reshape(-1, *(1,) * (y0.ndim - 1))
        mean: Array = total + summed(terms.reshape(-1, *terms.shape[2:])).reshape(total.shape)
        return mean
    for tau, factor in zip(points, factors, strict=True):
        total = total + factor * problem.hessian(y0 + tau * (y1 - y0))
    return total


def _on_segment(y0: Array, y1: Array, points: Array) -> Array:
    """The points y0 + τ(y1 − y0) for all τ in `points`, as an array (d, nodes, ...)."""
    return y0[:, None] + points.reshape(1, -1, *(1,) * (y0.ndim - 1)) * (y1 - y0)[:, None]


def _quadratures(problem: System, y0: Array, y1: Array, *rules: int) -> list[tuple[Array, Array]]:
    """The average of ∇H from y0 to y1 by several Gauss rules; `rules` are their numbers of nodes.

    For each rule the list has the value (d, ...) and its summands (d, nodes, ...).
    """
    tabulated = [gauss_legendre(nodes) for nodes in rules]
    all_points = tabulated[0][0] if len(rules) == 1 else np.concatenate([points for points, _ in tabulated])
    gradients = problem.gradient(_on_segment(y0, y1, all_points))
    sums, first = [], 0
    for nodes, (_, weights) in zip(rules, tabulated, strict=True):
        terms = gradients[:, first : first + nodes] * weights.reshape(1, -1, *(1,) * (y0.ndim - 1))
        first += nodes
        sums.append((summed(terms), terms))
    return sums


def _size(terms: Array) -> Array:
    """The scale (...) of rounding in quadrature sums: max over components of Σ|terms|."""
    return np.asarray(np.max(summed(np.abs(terms)), axis=0))


def argument_rounding(problem: System, *states: Array) -> Array:
    """The largest change (M,) of ∇H(y) by one rounding of y, about eps |H″(y) y|, at `states` y.

    If ∇H varies over lengths far below |y|, as sin q does at q = 10⁸, two quadrature rules differ
    by a few such changes, because their nodes are rounded differently.
    """
    worst = np.zeros(states[0].shape[1:])
    with np.errstate(all="ignore"):
        for y in states:
            change = problem.gradient(y * (1 + 2.0**-26)) - problem.gradient(y)
            worst = np.fmax(worst, np.max(np.abs(change), axis=0) * 2.0**26)
    return EPS * worst


def _adaptive(problem: System, y0: Array, y1: Array) -> Average:
    """The average of ∇H by Gauss rules of more nodes, until two agree to rounding."""
    shape = y0.shape[1:]
    a, b = y0.reshape(y0.shape[0], -1), y1.reshape(y1.shape[0], -1)
    # The first two rules are always needed, so one call evaluates both.
    (coarse, _), (value, terms) = _quadratures(problem, a, b, *_LADDER[:2])
    error = np.max(np.abs(value - coarse), axis=0)
    evaluations = np.full(value.shape[1], sum(_LADDER[:2]))
    reliable = _agree(error, terms)
    for nodes in _LADDER[2:]:
        if reliable.all():
            break
        rest = np.flatnonzero(~reliable)
        ((finer, terms),) = _quadratures(problem, a[:, rest], b[:, rest], nodes)
        error[rest] = np.max(np.abs(finer - value[:, rest]), axis=0)
        value[:, rest] = finer
        evaluations[rest] += nodes
        reliable[rest] = _agree(error[rest], terms)
    if not reliable.all():
        rest = np.flatnonzero(~reliable)
        reliable[rest] = error[rest] <= 16 * argument_rounding(problem, a[:, rest], b[:, rest])
    return Average(
        value.reshape(y0.shape), evaluations.reshape(shape), error.reshape(shape), reliable.reshape(shape)
    )


def _agree(difference: Array, terms: Array) -> Flags:
    """True for each path on which two rules' `difference` is rounding of their `terms`."""
    agree: Flags = difference <= terms.shape[1] * EPS * _size(terms)
    return agree


@lru_cache(maxsize=64)
def gauss_legendre(nodes: int) -> tuple[Array, Array]:
    """Gauss-Legendre nodes and weights on [0, 1], symmetric to the bit: x_k = 1 − x_{n+1−k}.

    The nodes above ½ and the weights are correctly rounded. If each node were, Σ w_k x_k would be
    ½ + ε/2. Then the averaged gradient of a quadratic H would be taken at ȳ + ε(y1 − y0)/2, and
    each step would change H by −½ε(y1 − y0)ᵀH″(y1 − y0), always in one direction: with two nodes
    by a tenth of a rounding. NumPy's weights at the ends have relative errors of 40 eps for 12
    nodes and of 60000 eps for 128. Newton's method in decimal arithmetic, which is the same on
    every platform, corrects NumPy's nodes.
    """
    with localcontext() as context:
        context.prec = 40
        rule = [_polished(nodes, float(x)) for x in np.polynomial.legendre.leggauss(nodes)[0]]
    points = np.array([float(x) for x, _ in rule])
    points[: nodes // 2] = 1 - points[::-1][: nodes // 2]  # an exact difference
    return points, np.array([float(w) for _, w in rule])


def _polished(nodes: int, guess: float) -> tuple[Decimal, Decimal]:
    """The Gauss node (1 + x)/2 and weight 1/((1 − x²)P_n′(x)²), P_n(x) = 0 near `guess`."""
    x = Decimal(guess)
    for _ in range(3):  # with 16, 32 and 64 right digits; the derivative is that of the last iteration
        p, previous = x, Decimal(1)
        for k in range(1, nodes):
            p, previous = ((2 * k + 1) * x * p - k * previous) / (k + 1), p
        slope = nodes * (x * p - previous) / (x * x - 1)
        x -= p / slope
    return (1 + x) / 2, 1 / ((1 - x * x) * slope * slope)


def mean_nodes(degree: int) -> int:
    """The ⌈ν/2⌉ nodes that average ∇H exactly along a segment, for a polynomial H of degree ν."""
    return max(1, -(-degree // 2))
