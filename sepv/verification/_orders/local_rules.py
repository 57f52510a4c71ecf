"""Expectations over what a step sees: increments, and the areas, space-time areas or halves that it asks for.

Nodes are in units of √h, further rows too (A = √h · row, H = √h · row), as
`sepv.verification._orders.local_errors` scales them.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from sepv.problem import HamiltoniansProblem, Problem, column
from sepv.schemes import Scheme
from sepv.simulate import _areas as areas
from sepv.verification._orders.gaussian import Rule, rule


def rule_for(scheme: Scheme, problem: Problem, h: float, degree: int, fewer: int = 0) -> Rule:
    """The rule for this scheme, with areas where it asks for them or several Hamiltonians need them.

    Parameters
    ----------
    fewer : nodes in each variable to leave out, of several Hamiltonians, for an estimate of the rule's error.
    """
    several = isinstance(problem, HamiltoniansProblem)
    needed = scheme.asks == "areas" or (several and column(problem) == "general")
    # Where a scheme clips its increments is for the law "truncation": areas multiply the nodes.
    return _rule(scheme.asks, scheme.truncation, problem.noises, h, degree, needed, not several, fewer)


@lru_cache(maxsize=256)
def _rule(
    asks: str,
    truncation: int | None,
    m: int,
    h: float,
    degree: int,
    with_areas: bool,
    panels: bool,
    fewer: int,
) -> Rule:
    if asks == "halves":
        return _of_halves(m, h, degree, fewer)
    if asks == "space-time" and not with_areas:
        return _of_bridges(m, h, degree, fewer)
    own = rule(m, h, truncation, degree, panels, fewer)
    if not with_areas:
        return own
    points, shares = areas.points(own.xi)  # (k, n, Q), (Q,)
    k, n, Q = points.shape
    flat = points.reshape(k, n * Q)
    seen = replace(
        own,
        xi=np.repeat(own.xi, Q, axis=1),
        weights=np.repeat(own.weights, Q) * np.tile(shares, n),
        index=np.repeat(own.index, Q),
        areas=flat,
    )
    if asks == "space-time":
        H = np.tile(areas.bridges(m), n)
        rows = np.concatenate([own.zeta[:, seen.index], H])
        return replace(seen, zeta=rows, index=np.arange(n * Q), bridges=H)
    if asks != "areas":
        return seen
    rows = np.concatenate([own.zeta[:, seen.index], np.sqrt(h) * flat])
    return replace(seen, zeta=rows, index=np.arange(n * Q))


def _of_halves(m: int, h: float, degree: int, fewer: int) -> Rule:
    """Increments of both halves, not truncated; the exact solution is shown no areas."""
    two = rule(2 * m, h, None, degree, False, fewer)
    xi = (two.xi[:m] + two.xi[m:]) / np.sqrt(2)
    zeta = np.concatenate([(two.zeta[:m] + two.zeta[m:]) / np.sqrt(2), two.zeta[:m] / np.sqrt(2)])
    return Rule(xi, two.weights, zeta, two.index, two.degree)


def _of_bridges(m: int, h: float, degree: int, fewer: int) -> Rule:
    """Increments, not truncated, and space-time areas of variance h/12, independent of them."""
    two = rule(2 * m, h, None, degree, False, fewer)
    H = two.xi[m:] / np.sqrt(12)
    zeta = np.concatenate([two.xi[:m], H])
    return Rule(two.xi[:m], two.weights, zeta, np.arange(two.weights.size), two.degree, bridges=H)
