"""The averaged gradient ∫₀¹ ∇H(y0 + τ(y1 − y0)) dτ of (2.1), exact to rounding.

Three ways, in this order: the problem's closed form; Gauss-Legendre quadrature with ⌈ν/2⌉ nodes for a
polynomial H of degree ν (the integrand has degree ν − 1 in τ); adaptive quadrature with its error.
A fixed rule is not among them: eight nodes leave 8e-5 in a logarithmic energy.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sepv.problem._fields import summed
from sepv.problem._problem import Array, Problem
from sepv.record import EPS, gauss_legendre, mean_nodes

# Nodes of the adaptive rule: the next is tried until two agree. 128 nodes resolve integrands that are analytic within
# about a tenth of the segment's length; the error of rougher ones is reported.
_LADDER = (4, 8, 16, 32, 64, 128)
# The largest y.size for which one call evaluates H″ at all nodes: beyond, memory grows and nothing is gained.
FEW = 512


class Average(NamedTuple):
    """value (d, M); evaluations of ∇H (M,); error (M,): 0 where exact, else the last two rules' difference."""

    value: Array
    evaluations: np.ndarray
    error: Array
    reliable: np.ndarray


def average_gradient(problem: Problem, y0: Array, y1: Array) -> Average:
    """∫₀¹ ∇H(y0 + τ(y1 − y0)) dτ for y0, y1 of shape (d, ...)."""
    shape = y0.shape[1:]
    if problem.mean_gradient is not None:
        value = problem.mean_gradient(y0, y1)
        return Average(value, np.ones(shape, dtype=np.int64), np.zeros(shape), np.ones(shape, dtype=bool))
    if problem.degree is not None:
        nodes = mean_nodes(problem.degree)
        ((value, _),) = _quadratures(problem, y0, y1, nodes)
        return Average(value, np.full(shape, nodes), np.zeros(shape), np.ones(shape, dtype=bool))
    return _adaptive(problem, y0, y1)


def average_hessian(problem: Problem, y0: Array, y1: Array) -> Array | None:
    """∫₀¹ τ H″(y0 + τ(y1 − y0)) dτ, the derivative of the averaged gradient by y1.

    It serves Newton's Jacobian only. So three nodes suffice where H is not a polynomial: they change the speed of
    convergence, not its limit.
    """
    if problem.hessian is None:
        return None
    nodes = 3 if problem.degree is None else mean_nodes(problem.degree)
    points, weights = gauss_legendre(nodes)
    factors = weights * points
    total = np.zeros((problem.dimension, *y0.shape))
    if y0.size <= FEW:  # all nodes in one call
        terms = problem.hessian(_on_segment(y0, y1, points)) * factors.reshape(-1, *(1,) * (y0.ndim - 1))
        mean: Array = total + summed(terms.reshape(-1, *terms.shape[2:])).reshape(total.shape)
        return mean
    for tau, factor in zip(points, factors, strict=True):
        total = total + factor * problem.hessian(y0 + tau * (y1 - y0))
    return total


def _on_segment(y0: Array, y1: Array, points: Array) -> Array:
    """y0 + τ(y1 − y0) for each τ, (d, nodes, ...)."""
    return y0[:, None] + points.reshape(1, -1, *(1,) * (y0.ndim - 1)) * (y1 - y0)[:, None]


def _quadratures(problem: Problem, y0: Array, y1: Array, *rules: int) -> list[tuple[Array, Array]]:
    """Each rule's value (d, ...) and terms (d, nodes, ...); one call evaluates ∇H at the nodes of all rules."""
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
    """The sum of the absolute values of a quadrature's terms (d, nodes, ...): the largest component."""
    return np.asarray(np.max(summed(np.abs(terms)), axis=0))


def argument_rounding(problem: Problem, *states: Array) -> Array:
    """The change of ∇H(y) by one rounding of y, eps |H″(y) y|: the largest over the given states, (M,).

    Where ∇H varies fast beside |y|, as sin q does at q = 10⁸, two quadrature rules agree only to a few of these,
    because each rounds its nodes differently.
    """
    worst = np.zeros(states[0].shape[1:])
    with np.errstate(all="ignore"):
        for y in states:
            change = problem.gradient(y * (1 + 2.0**-26)) - problem.gradient(y)
            worst = np.fmax(worst, np.max(np.abs(change), axis=0) * 2.0**26)
    return EPS * worst


def _adaptive(problem: Problem, y0: Array, y1: Array) -> Average:
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
        open_ = np.flatnonzero(~reliable)
        ((finer, terms),) = _quadratures(problem, a[:, open_], b[:, open_], nodes)
        error[open_] = np.max(np.abs(finer - value[:, open_]), axis=0)
        value[:, open_] = finer
        evaluations[open_] += nodes
        reliable[open_] = _agree(error[open_], terms)
    if not reliable.all():
        open_ = np.flatnonzero(~reliable)
        reliable[open_] = error[open_] <= 16 * argument_rounding(problem, a[:, open_], b[:, open_])
    return Average(
        value.reshape(y0.shape), evaluations.reshape(shape), error.reshape(shape), reliable.reshape(shape)
    )


def _agree(difference: Array, terms: Array) -> NDArray[np.bool_]:
    """True where two rules agree to the rounding errors of their sums."""
    agree: NDArray[np.bool_] = difference <= terms.shape[1] * EPS * _size(terms)
    return agree
