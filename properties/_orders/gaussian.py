"""Expectations over Wiener increments as finite sums: rules for ξ ~ N(0, I_m)
and truncated ζ = clip(ξ, ±A_h).

In one variable the axis is cut at A_h(1), A_h(2), …, A_h(k), where A_h(i) is the bound of Remark
2.1 with i for k. A scheme that clips at one of these points is smooth on each panel, so each panel
has the Gauss rule of the normal weight. Beyond A_h(k), where the scheme gets A_h and the exact
solution ξ, the tail has another rule. Two variables have products of such rules, three to five
products of small Gauss-Hermite rules, and six or more the degree-3 formula with the points ±√m e_j
for m noises. All weights are positive, so errors of different nodes cannot cancel in a mean square.

`rule_for` adds further arguments of schemes: Lévy areas A, space-time areas H, or increments of
half steps. Nodes and the rows of these arguments are in units of √h (A = √h · row, H = √h · row).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise, product

import numpy as np

from sepv.problem import Array, Problem, column, one_hamiltonian
from sepv.record import gauss_legendre
from sepv.schemes import PointLaw, Scheme
from sepv.simulate import areas
from sepv.simulate import truncation as bounded

# Nodes that discretise the weight on a panel. Gauss rules of n ≤ 24 nodes made from them are exact
# to rounding.
_PANEL_NODES = 96
# The length at which an infinite panel is cut off: there the weight has fallen by the factor 1e-35.
_PANEL_REACH = 12.7
# The number of nodes of a tail. They need no further steps of the scheme, which gets A_h at all of
# them.
TAIL_NODES = 8
# The number of points in each variable of product rules, by the number of noises.
POINTS_BY_NOISES = {1: 8, 2: 6, 3: 6, 4: 4, 5: 3}


@dataclass(frozen=True)
class GaussianRule:
    """A quadrature E g(ξ, ζ) ≈ Σ weights · g(xi, zeta[:, index])
    over increments ξ and truncated increments ζ.
    """

    xi: Array  # (m, n) nodes for the exact solution
    weights: Array  # (n,), positive, of sum 1
    zeta: Array  # (m, u) the different nodes for the scheme, u ≤ n
    index: np.ndarray  # (n,) the column of zeta for each node
    degree: int  # exact for polynomials of this degree in each variable of ξ; for m ≥ 6 of this total degree
    areas: Array | None = None  # (k, n) Lévy areas with i < j over a step h = 1, also for the exact solution
    bridges: Array | None = None  # (m, n) space-time Lévy areas over a step h = 1


@lru_cache(maxsize=256)
def rule(
    noises: int, h: float, truncation: int | None, degree: int, panels: bool = True, fewer: int = 0
) -> GaussianRule:
    """Return the rule for a step h with m = `noises` increments of a scheme that truncates with
    k = `truncation`.

    With `panels` and m ≤ 2, each axis is cut where a scheme may clip, and the rule has this
    `degree`. Else it has few nodes and no cuts; `fewer` > 0 then removes `fewer` nodes in each
    variable, or for m ≥ 6 reflects the nodes. If the scheme does not truncate, the cuts are those
    of k = 2, and the scheme gets the nodes beyond them unclipped.
    """
    if noises == 0:
        return GaussianRule(
            np.zeros((0, 1)), np.ones(1), np.zeros((0, 1)), np.zeros(1, dtype=np.intp), degree
        )
    if noises <= 2 and panels:
        cuts = (1,) if noises == 2 else range(1, (truncation or 2) + 1)
        return _product(*_panels(h, truncation, degree, cuts), noises, degree)
    if noises in POINTS_BY_NOISES:
        n = POINTS_BY_NOISES[noises] - fewer
        x, w = np.polynomial.hermite_e.hermegauss(n)
        return _product(x, w / w.sum(), _clip(x, h, truncation), noises, 2 * n - 1)
    axes = np.eye(noises)
    if fewer:  # other nodes of a rule of the same degree: the difference of both shows its error
        axes = axes - 2 / noises
    x = np.sqrt(noises) * np.concatenate([axes, -axes], axis=1)
    return GaussianRule(
        x, np.full(2 * noises, 0.5 / noises), _clip(x, h, truncation), np.arange(2 * noises), 3
    )


def point_rule(noises: int, law: PointLaw) -> GaussianRule:
    """Return the rule for m independent increments with few values: all combinations,
    exact for every function.
    """
    points = np.array(list(product(law.values, repeat=noises))).reshape(-1, noises).T
    weights = np.prod(np.array(list(product(law.weights, repeat=noises))).reshape(-1, noises), axis=1)
    return GaussianRule(points, weights, points, np.arange(weights.size), law.degree)


def _clip(x: Array, h: float, truncation: int | None) -> Array:
    if truncation is None:
        return x
    A = bounded.truncation_bound(h, truncation)
    return np.clip(x, -A, A)


def _product(x: Array, w: Array, seen: Array, m: int, degree: int) -> GaussianRule:
    """Return the product of m equal rules; nodes with the same truncated ζ (`seen`)
    are one node for the scheme.
    """
    different, number = np.unique(seen, return_inverse=True)
    grids = np.array(list(product(range(x.size), repeat=m))).T
    weights = np.prod(w[grids], axis=0)
    shape = (different.size,) * m
    flat, index = np.unique(np.ravel_multi_index(tuple(number[grids]), shape), return_inverse=True)
    seen_points = different[np.array(np.unravel_index(flat, shape))]
    return GaussianRule(x[grids], weights / weights.sum(), seen_points, index, degree)


def _panels(h: float, truncation: int | None, degree: int, cuts: Iterable[int]) -> tuple[Array, Array, Array]:
    """Return nodes ξ, weights and truncated nodes ζ of the rule in one variable,
    cut at A_h for each k in `cuts`.
    """
    last = bounded.truncation_bound(h, truncation or 2)
    edges = [*(bounded.truncation_bound(h, k) for k in cuts if k < (truncation or 2)), last]
    outer = max(3, degree // 2 + 1)
    # The panel around 0 has most of the probability. With n = `degree` nodes it is exact for
    # squares of errors of order p + ½ and degree 2p + 1 in ΔW, if degree = 2p + 2: 2n − 1
    # ≥ 2(2p + 1).
    parts = [_normal_rule(-edges[0], edges[0], min(outer + 3, max(degree, outer + 1)))]
    right = [_normal_rule(a, b, outer) for a, b in pairwise(edges)]
    right.append(_normal_rule(last, last + _PANEL_REACH, outer if truncation is None else TAIL_NODES))
    for x, w in right:
        parts += [(x, w), (-x, w)]
    x, w = (np.concatenate(row) for row in zip(*parts, strict=True))
    return x, w, _clip(x, h, truncation)


def _normal_rule(a: float, b: float, n: int) -> tuple[Array, Array]:
    """Return the n-point Gauss rule of the normal density on [a, b],
    with weights of sum P(a < ξ < b).

    Stieltjes' procedure on a fine discretisation of the weight gives the recurrence of its
    orthogonal polynomials, and the eigenvalues of the Jacobi matrix are the nodes (Gautschi,
    Orthogonal Polynomials, 2004, §2.2). The weight is taken relative to its largest value on the
    panel, because a panel may be far out.
    """
    t, fine = gauss_legendre(_PANEL_NODES)
    x = a + (b - a) * t
    nearest = 0.0 if a < 0 < b else min(abs(a), abs(b))
    w = (b - a) * fine * np.exp(0.5 * (nearest - x) * (nearest + x))
    alpha, beta = np.zeros(n), np.zeros(n)
    before, p = np.zeros_like(x), np.ones_like(x)
    norm = float(w.sum())
    beta[0] = norm
    for j in range(n):
        square = w * p * p
        size = float(square.sum())
        alpha[j] = float((square * x).sum()) / size
        if j:
            beta[j] = size / norm
        norm = size
        p, before = (x - alpha[j]) * p - (beta[j] if j else 0.0) * before, p
    beside = np.sqrt(beta[1:])
    values, vectors = np.linalg.eigh(np.diag(alpha) + np.diag(beside, 1) + np.diag(beside, -1))
    return values, vectors[0] ** 2 * beta[0] * np.exp(-0.5 * nearest * nearest) / np.sqrt(2 * np.pi)


def rule_for(
    scheme: Scheme, problem: Problem, h: float, degree: int, fewer: int = 0, unit: float = 1.0
) -> GaussianRule:
    """Return the rule for a step h, with Lévy areas if the scheme takes them or several
    Hamiltonians need them.

    For several Hamiltonians, the difference from a rule with `fewer` nodes less in each variable
    shows the error. `unit` is the unit of time of h in the truncation bound A_h.
    """
    several = not one_hamiltonian(problem)
    needed = scheme.asks == "areas" or (several and column(problem) == "general")
    # For several Hamiltonians panels and areas would need too many nodes. The law "truncation"
    # tests clipping.
    return _rule(scheme.asks, scheme.truncation, problem.noises, h, degree, needed, not several, fewer, unit)


@lru_cache(maxsize=256)
def _rule(
    asks: str, truncation: int | None, m: int, h: float, degree: int, with_areas: bool, panels: bool, fewer: int,
    unit: float,
) -> GaussianRule:  # fmt: skip
    if asks == "halves":
        return _of_halves(m, h, degree, fewer)
    if asks == "space-time" and not with_areas:
        return _of_bridges(m, h, degree, fewer)
    own = rule(m, h / unit, truncation, degree, panels, fewer)
    if not with_areas:
        return own
    points, shares = areas.points(own.xi)  # (k, n, Q), (Q,)
    k, n, Q = points.shape
    flat = points.reshape(k, n * Q)
    xi, weights = np.repeat(own.xi, Q, axis=1), np.repeat(own.weights, Q) * np.tile(shares, n)
    seen = replace(own, xi=xi, weights=weights, index=np.repeat(own.index, Q), areas=flat)
    if asks == "space-time":
        H = np.tile(areas.bridges(m), n)
        rows = np.concatenate([own.zeta[:, seen.index], H])
        return replace(seen, zeta=rows, index=np.arange(n * Q), bridges=H)
    if asks != "areas":
        return seen
    rows = np.concatenate([own.zeta[:, seen.index], np.sqrt(h) * flat])
    return replace(seen, zeta=rows, index=np.arange(n * Q))


def _of_halves(m: int, h: float, degree: int, fewer: int) -> GaussianRule:
    """Return a rule for schemes that take the untruncated increments of a step and of its first
    half, without areas.
    """
    two = rule(2 * m, h, None, degree, False, fewer)
    xi = (two.xi[:m] + two.xi[m:]) / np.sqrt(2)
    zeta = np.concatenate([(two.zeta[:m] + two.zeta[m:]) / np.sqrt(2), two.zeta[:m] / np.sqrt(2)])
    return GaussianRule(xi, two.weights, zeta, two.index, two.degree)


def _of_bridges(m: int, h: float, degree: int, fewer: int) -> GaussianRule:
    """Return a rule of untruncated increments and independent space-time areas of variance h/12."""
    two = rule(2 * m, h, None, degree, False, fewer)
    H = two.xi[m:] / np.sqrt(12)
    zeta = np.concatenate([two.xi[:m], H])
    return GaussianRule(two.xi[:m], two.weights, zeta, np.arange(two.weights.size), two.degree, bridges=H)
