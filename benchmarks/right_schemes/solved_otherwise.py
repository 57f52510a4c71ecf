"""Variants of scheme (2.1) with other solvers and summations than sepv's;
each claims what sepv's (2.1) claims.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from sepv.core.formula import Increment
from sepv.errors import Skipped
from sepv.problem import Array, Problem, matvec
from sepv.record import EPS, gauss_legendre
from sepv.schemes import Implicit, Scheme, Step, as_lanes, energy_preserving, energy_preserving_jacobian

CLAIMS_OF_THE_CORE = frozenset(energy_preserving.claims)
# Laws about paths, which schemes that are too slow for thousands of paths do not claim.
_PATHS = {"rounding", "mean-square-order", "weak-order", "right-limit", "reproducibility"}

# Gauss nodes for an H of no stated degree: exact to degree 40.
_EXACT_NODES = 20
# Sweeps of a fixed-point iteration with a contraction factor of 0.95.
_FIXED_POINT_SWEEPS = 700
# A few roundings relative to |y|: a smaller correction that no longer shrinks is rounding.
_STAGNATION = 16 * EPS

# The right side R(problem, y0, y1, Δ) of (2.1).
_Right = Callable[[Problem, Array, Array, Any], Array]


class Refused(ArithmeticError):
    """A step was not solved. A scheme of a third party may raise such an exception of its own."""


def _nodes(problem: Problem) -> int:
    return _EXACT_NODES if problem.degree is None else max(1, -(-problem.degree // 2))


def _by_nodes(problem: Problem, y0: Array, y1: Array, nodes: int) -> Array:
    """The averaged gradient ∫₀¹∇H dτ in the problem's closed form,
    else by Gauss nodes from the last to the first.
    """
    if problem.mean_gradient is not None:
        return problem.mean_gradient(y0, y1)
    total = np.zeros_like(y0)
    for tau, weight in reversed(list(zip(*gauss_legendre(nodes), strict=True))):
        total = total + weight * problem.gradient((1 - tau) * y0 + tau * y1)
    return total


def _right(problem: Problem, y0: Array, y1: Array, delta: Any) -> Array:
    """The right side Δ B((y0 + y1)/2) ∇̄H of (2.1), ∇̄H being the averaged gradient."""
    return delta * matvec(problem.structure((y0 + y1) / 2), _by_nodes(problem, y0, y1, _nodes(problem)))


def _swept(problem: Problem, y0: Array, delta: Array, right: _Right = _right) -> Array:
    """The solution y0 + z by iterating z ← R(y0 + z) to stagnation, path by path, for y0 (d, M)
    and Δ (M,).
    """
    z, active = np.zeros_like(y0), np.arange(y0.shape[1])
    before = np.full(y0.shape[1], np.inf)
    with np.errstate(all="ignore"):
        for _ in range(_FIXED_POINT_SWEEPS):
            a = y0[:, active]
            new = right(problem, a, a + z[:, active], delta[active])
            move = np.max(np.abs(new - z[:, active]), axis=0)
            scale = np.max(np.abs(a), axis=0) + np.max(np.abs(new), axis=0)
            done = (move == 0) | ((move >= before[active]) & (move <= _STAGNATION * scale))
            z[:, active], before[active] = new, move
            if not np.all(np.isfinite(move)):
                break
            active = active[~done]
            if not active.size:
                return y0 + z
    raise Refused("the fixed-point iteration does not converge")


def of_lanes(update: Callable[[Problem, Array, Array], Array]) -> Step:
    """A step from update(problem, y0 (d, M), Δ (M,))."""

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y0, noise = as_lanes(problem, y, h, dW)
        return update(problem, y0, problem.random_step(h, noise)).reshape(np.shape(y))

    return step


def _of_one(update: Callable[[Problem, Array, float], Any]) -> Step:
    """A step for one state from update(problem, y0, Δ), as most people write a step."""

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        return np.asarray(update(problem, y, float(h + np.dot(problem.c, dW))), dtype=np.float64)

    return step


def _extended(problem: Problem, y0: Array, delta: Array) -> Array:
    """(2.1) in the platform's longest float, rounded once:
    nearly always the binary64 number next to the solution.
    """
    wide = _swept(problem, y0.astype(np.longdouble), delta.astype(np.longdouble))
    return wide.astype(np.float64)


def _loop(problem: Problem, y: Array, delta: float) -> Array:
    """(2.1) as a plain loop over floats."""
    d, points = len(y), list(zip(*gauss_legendre(_nodes(problem)), strict=True))
    y1, last = y.copy(), math.inf
    for _ in range(_FIXED_POINT_SWEEPS):
        if problem.mean_gradient is not None:
            g = problem.mean_gradient(y, y1)
        else:
            g = np.zeros(d)
            for tau, weight in points:
                g += weight * problem.gradient(y + tau * (y1 - y))
        B = problem.structure(0.5 * (y + y1))
        new = np.empty(d)
        for i in range(d):
            total = 0.0
            for j in range(d):
                total += float(B[i, j]) * float(g[j])
            new[i] = y[i] + delta * total
        move = float(np.max(np.abs(new - y1)))
        y1, before, last = new, last, move
        if not math.isfinite(move):
            break
        if move == 0 or (move >= before and move <= _STAGNATION * float(np.max(np.abs(y1)))):
            return y1
    raise Refused("no convergence")


def _to_an_ulp(problem: Problem, y: Array, delta: float) -> Array:
    """(2.1) by sweeps until the correction is rounding of the largest component,
    however small the others are.
    """
    y1, last = y, math.inf
    for _ in range(_FIXED_POINT_SWEEPS):
        y1, before, old = y + _right(problem, y, y1, delta), last, y1
        last, size = float(np.max(np.abs(y1 - old))), float(np.max(np.abs(y1)))
        if last <= (_STAGNATION if last >= before else EPS) * size < math.inf:
            return y1
    raise Refused("no convergence")


def _exact_sum(values: Iterable[float]) -> float:
    try:
        return math.fsum(values)
    except ValueError as error:  # infinities of both signs, or a NaN
        raise Refused("a sum overflows") from error


def _lists(problem: Problem, y: Array, delta: float) -> list[float]:
    """(2.1) by sweeps over Python lists, with every sum rounded once (`math.fsum`)."""
    start, points = y.tolist(), list(zip(*gauss_legendre(_EXACT_NODES), strict=True))
    z, last = [0.0] * len(start), math.inf
    for _ in range(_FIXED_POINT_SWEEPS):
        y1 = [a + b for a, b in zip(start, z, strict=True)]
        if problem.mean_gradient is not None:
            g = problem.mean_gradient(np.array(start), np.array(y1)).tolist()
        else:
            rows = [
                problem.gradient(np.array([a + t * b for a, b in zip(start, z, strict=True)])).tolist()
                for t, _ in points
            ]
            g = [_exact_sum(w * v for (_, w), v in zip(points, column, strict=True)) for column in zip(*rows)]  # noqa: B905
        if not all(map(math.isfinite, g)):
            break
        B = problem.structure(np.array([a + 0.5 * b for a, b in zip(start, z, strict=True)])).tolist()
        new = [delta * _exact_sum(b * v for b, v in zip(row, g, strict=True)) for row in B]
        move = max(abs(a - b) for a, b in zip(new, z, strict=True))
        z, before, last = new, last, move
        if not math.isfinite(move):
            break
        if move == 0 or (move >= before and move <= _STAGNATION * max(map(abs, start + new))):
            return [a + b for a, b in zip(start, z, strict=True)]
    raise Refused("no convergence")


def _root(problem: Problem, y: Array, delta: float) -> Array:
    """(2.1) by Powell's hybrid method; its residual is compared with the tolerance that the scheme
    states.
    """
    from scipy.optimize import root

    found = root(lambda z: z - _right(problem, y, y + z, delta), np.zeros_like(y), method="hybr", tol=1e-13)
    left = np.max(np.abs(found.x - _right(problem, y, y + found.x, delta)))
    if not left <= ROOT_TOLERANCE * max(np.max(np.abs(y)), np.max(np.abs(y + found.x))):
        raise FloatingPointError(f"scipy.optimize.root: {found.message}")
    return y + np.asarray(found.x)


ROOT_TOLERANCE = 1e-12


def _line_search(problem: Problem, y: Array, delta: float) -> Array:
    """(2.1) by Newton's method with a Jacobian of differences and halved steps;
    LinAlgError for a singular Jacobian.
    """
    d, z = len(y), np.zeros_like(y)

    def F(z: Array) -> Array:
        return z - _right(problem, y, y + z, delta)

    value, best = F(z), math.inf
    for _ in range(60):
        size = float(np.max(np.abs(value)))
        scale = float(np.max(np.abs(y)) + np.max(np.abs(z)))
        if size == 0 or (size >= best and size <= _STAGNATION * scale):
            return y + z
        best = min(best, size)
        width = math.sqrt(EPS) * (scale + size)
        slope = np.stack([(F(z + width * e) - value) / width for e in np.eye(d)], axis=1)
        move = np.linalg.solve(slope, value)
        share = 1.0
        while share > 2.0**-20:
            trial = z - share * move
            new = F(trial)
            if np.max(np.abs(new)) < size or size <= _STAGNATION * scale:
                break
            share /= 2
        else:
            raise ArithmeticError("the line search finds no smaller residual")
        z, value = trial, new
    raise ArithmeticError("Newton's method does not converge")


def _by_midpoint(problem: Problem, y0: Array, delta: Array) -> Array:
    """(2.1) with the midpoint m as the unknown: m = y0 + ½R(y0, 2m − y0), y1 = 2m − y0."""

    def half(problem: Problem, start: Array, m: Array, share: Array) -> Array:
        return 0.5 * _right(problem, start, 2 * m - start, share)

    return 2 * _swept(problem, y0, delta, half) - y0


def _clenshaw_curtis(problem: Problem, y0: Array, y1: Array, step: Array) -> Array:
    """(2.1) with 33 Chebyshev points, exact to degree 33."""
    points, weights = _chebyshev(32)
    if problem.mean_gradient is not None:
        average = problem.mean_gradient(y0, y1)
    else:
        average = sum(w * problem.gradient(y0 + t * (y1 - y0)) for t, w in zip(points, weights, strict=True))
    return step[0] * matvec(problem.structure(0.5 * y0 + 0.5 * y1), average)


def _chebyshev(n: int) -> tuple[Array, Array]:
    """Nodes and weights of Clenshaw and Curtis on [0, 1], n even: Σ_k of 2/(1 − 4k²) cos 2kθ,
    halved at both ends.
    """
    theta = np.pi * np.arange(n + 1) / n
    k = np.arange(1, n // 2 + 1)
    factor = np.where(k == n // 2, 1.0, 2.0)
    weights = (1 - np.cos(2 * np.outer(theta, k)) @ (factor / (4 * k**2 - 1))) / n
    weights[[0, -1]] /= 2
    return 0.5 * (1 - np.cos(theta)), weights


def _twenty(problem: Problem, y0: Array, y1: Array, step: Array) -> Array:
    """(2.1) with 20 Gauss nodes as NumPy has them, whose last weights are off by a few tens of
    eps.
    """
    if problem.mean_gradient is not None:
        average = problem.mean_gradient(y0, y1)
    else:
        points, weights = np.polynomial.legendre.leggauss(_EXACT_NODES)
        terms = [
            w * problem.gradient(y0 + 0.5 * (x + 1) * (y1 - y0)) for x, w in zip(points, weights, strict=True)
        ]
        average = 0.5 * sum(terms[1:], terms[0])
    return step[0] * matvec(problem.structure(y0 + 0.5 * (y1 - y0)), average)


def _solved(R: Callable[[Problem, Array, Array, Array], Array]) -> Implicit:
    """A step by the core's solver and Newton matrix for a right side R that has its own
    quadrature.
    """

    def increment(problem: Problem, y0: Array, y1: Array, step: Array) -> Increment:
        once = np.ones(y0.shape[1], dtype=np.int64)
        return Increment(R(problem, y0, y1, step), once, once, once.astype(bool))

    return Implicit(increment, energy_preserving_jacobian)


def _digits(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """(2.1) in mpmath with thirty digits, rounded to binary64."""
    from sepv.reference.steps import reference_step

    if problem.data is None:
        raise Skipped(f"{problem.name} is not given as data, which mpmath needs")
    solved = reference_step("energy-preserving", problem.data, y.tolist(), h, dW.tolist(), 30)
    return np.array([float(v) for v in solved.y1])


def like_the_core(name: str, step: Step, source: str, batched: bool = True, **changes: Any) -> Scheme:
    """A scheme with this step and all claims of (2.1),
    but without *reproducibility* if it takes no batches.
    """
    claims = CLAIMS_OF_THE_CORE if batched else CLAIMS_OF_THE_CORE - {"reproducibility"}
    changed = {"claims": claims, **changes}
    return replace(
        energy_preserving, name=name, step=step, source=source, solve=None, batched=batched, **changed
    )


OTHERWISE_SOLVED: tuple[Scheme, ...] = (
    like_the_core("fixed-point", of_lanes(_swept), "(2.1) by fixed-point iteration to stagnation"),
    like_the_core("twenty-nodes", _solved(_twenty), "(2.1) with 20 Gauss nodes"),
    like_the_core(
        "clenshaw-curtis",
        _solved(_clenshaw_curtis),
        "(2.1) with Chebyshev points",
    ),
    like_the_core(
        "reversed-sums",
        _solved(lambda problem, y0, y1, step: _right(problem, y0, y1, step[0])),
        "(2.1) with quadrature from the last node to the first",
    ),
    like_the_core("midpoint-unknown", of_lanes(_by_midpoint), "(2.1), the midpoint being the unknown"),
    like_the_core("extended-precision", of_lanes(_extended), "(2.1) in long floats, rounded once"),
    like_the_core("python-loop", _of_one(_loop), "(2.1) as a plain loop for one state", False),
    like_the_core(
        "to-an-ulp", _of_one(_to_an_ulp), "(2.1) by sweeps to an ulp of the largest component", False
    ),
    like_the_core("lists-and-fsum", _of_one(_lists), "(2.1) with lists and exact sums", False),
    like_the_core(
        "scipy-root",
        _of_one(_root),
        "(2.1) by scipy.optimize.root",
        False,
        solver_tolerance=ROOT_TOLERANCE,
    ),
    like_the_core("line-search", _of_one(_line_search), "(2.1) by Newton's method with a line search", False),
    like_the_core(
        "mpmath-rounded",
        _digits,
        "(2.1) in mpmath, rounded",
        False,
        claims=CLAIMS_OF_THE_CORE - _PATHS,
        mean_square_order=None,
        weak_order=None,
    ),
)
