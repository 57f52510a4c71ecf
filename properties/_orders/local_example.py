"""Examples for messages of violated laws about one step: a state y0,
the expected result and the scheme's result.
"""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
from sepv.properties._failed_step import row
from sepv.properties._orders import local_errors as local
from sepv.properties._orders.gaussian import point_rule

from sepv.problem import Array, Problem
from sepv.schemes import Scheme, guarded, point_law


def mean_example(scheme: Scheme, problem: Problem, h: float) -> str:
    """Describe the state where E[y1 − y0] differs most from E[φ − y0], with the exact solution φ,
    or return "".
    """
    states, came, expected = _means(scheme, problem, h)
    apart = np.linalg.norm((came - expected)[: problem.dimension], axis=0)
    s = int(np.argmax(apart)) if apart.size else 0
    if not apart.size or not apart[s] > 0:
        return ""
    first = slice(0, problem.dimension)
    return (
        f"{problem.name}, from y0 = {row(states[:, s])} with h = {h:.6g}: E[y1 − y0] = {row(expected[first, s])} "
        f"expected, {row(came[first, s])} came"
    )


def weak_example(scheme: Scheme, problem: Problem, h: float) -> str:
    """Describe the largest error of a second moment of y1 − y0,
    or of the mean of y1 − y0 if its error is larger.
    """
    states, came, expected = _means(scheme, problem, h)
    pairs = list(combinations_with_replacement(range(problem.dimension), 2))
    apart = np.abs(came - expected)[: problem.dimension + len(pairs)]
    apart[problem.dimension :] /= 2  # the test functions are Taylor coefficients
    if not apart.size or np.argmax(apart.max(axis=1)) < problem.dimension:
        return mean_example(scheme, problem, h)
    n, s = np.unravel_index(np.argmax(apart), apart.shape)
    i, j = (k + 1 for k in pairs[n - problem.dimension])
    return (
        f"{problem.name}, from y0 = {row(states[:, s])} with h = {h:.6g}: for z = y1 − y0, E[z{i} z{j}] = "
        f"{expected[n, s]:.12g} expected, {came[n, s]:.12g} came"
    )


def _means(scheme: Scheme, problem: Problem, h: float) -> tuple[Array, Array, Array]:
    """Return states (d, S), and the means (A, S) of monomials of degree 1 and 2 in y1 − y0 and in φ
    − y0.
    """
    states, m, law = local.local_states(scheme, problem), problem.noises, point_law(scheme.increments)
    nodes = local.step_rule(scheme, problem, h)
    taken = nodes if law is None else point_rule(m, law)
    y, failed = local.one_step(guarded(scheme), problem, states, h, taken)
    came = _monomials(y - states[..., None]) @ taken.weights
    known, _ = local.solutions_at(problem, states, [(h, nodes)])
    if failed or not known:
        return states, came[:, :0], came[:, :0]
    if not local.moments_only(problem):
        known = [_monomials(known[0] - states[..., None]) @ nodes.weights]
    return states, came, known[0][: len(came)]


def _monomials(z: Array) -> Array:
    """Return the A monomials (A, S, n) of degree one and two in the components of z (d, S, n)."""
    pairs = combinations_with_replacement(range(len(z)), 2)
    return np.concatenate([z, np.stack([z[i] * z[j] for i, j in pairs])])


def step_example(scheme: Scheme, problem: Problem, h: float) -> str:
    """Describe y1 − y0, and the exact φ − y0, for the increment and state that contribute most to
    E|y1 − φ|².
    """
    states = local.local_states(scheme, problem)
    nodes = local.step_rule(scheme, problem, h)
    y, failed = local.one_step(guarded(scheme), problem, states, h, nodes)
    if local.moments_only(problem):
        return ""
    found, _ = local.ends_at(problem, states, [(h, nodes)])
    if failed or not found:
        return ""
    parts = np.sum((y - found[0]) ** 2, axis=0) * nodes.weights
    s = int(np.argmax(parts.sum(axis=1)))
    n = int(np.argmax(parts[s]))
    expected, came = (end[:, s, n] - states[:, s] for end in (found[0], y))
    return (
        f"{problem.name}, from y0 = {row(states[:, s])} with h = {h:.6g}, ΔW = {row(np.sqrt(h) * nodes.xi[:, n])}: "
        f"y1 − y0 = {row(expected)} expected, {row(came)} came"
    )
