"""One lane by itself: Newton's iteration with every test of `sepv.solve._newton` and `sepv.schemes.collocation`.

The problem is an argument, the address of a function, so that this file is compiled once for all kernels.
A lane comes here where it is not done after the steps that all lanes take together, or is in any trouble. Loops are
written out: an operation on arrays takes half a second to compile. Needs numba; loaded by
`sepv.simulate._engine.store`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from sepv.simulate._engine import module
from sepv.simulate._engine.functions import pivoted
from sepv.simulate._engine.signatures import CAREFUL, address, call_problem
from sepv.solve._ends import ROUNDING, STAGNATION
from sepv.solve._newton import MAX_HALVINGS, MAX_ITERATIONS

# What `shape` says: sizes, rows of S, places of I; the counts of nodes of all rules follow, then where they begin.
LANES, D, UNKNOWNS, KNOWN, UNKNOWN_ROWS, STEP_ROWS, STAGES, RULES, EXACT, WORK, EVALUATIONS, COUNTS = range(
    12
)

_kernel: Any = njit(error_model="numpy", nogil=True, cache=True)


@_kernel
def _state(y: Any, z: Any, table: Any, row: int, column: int, u: Any) -> None:
    """u = y + Σ_j z_j times the numbers of a row of the table from this column on."""
    d = y.size
    for i in range(d):
        u[i] = y[i]
        for j in range(z.size // d):
            u[i] += table[row, column + j] * z[j * d + i]


@_kernel
def _nodes(shape: Any, rule: int) -> Any:
    """The rows of the table that belong to a rule: first, and after the last."""
    first = shape[COUNTS + 2 * shape[RULES] + rule]
    return first, first + shape[COUNTS + rule]


@_kernel
def _averages(
    I: Any, y: Any, z: Any, P: Any, problem: Any, shape: Any, table: Any, rule: int, g: Any
) -> float:
    """g (s, d) by a rule; the largest component of a gradient."""
    d, s = y.size, shape[STAGES]
    u, t, none = np.empty(d), np.empty(d), np.empty((1, 1))
    for i in range(s):
        for r in range(d):
            g[i, r] = 0.0
    largest = 0.0
    first, last = _nodes(shape, rule)
    for n in range(first, last):
        _state(y, z, table, n, s, u)
        call_problem(problem, (module.GRADIENT, u, u, none, t, P))
        for r in range(d):
            largest = max(largest, abs(t[r]))
            for i in range(s):
                g[i, r] += table[n, i] * t[r]
    I[shape[EVALUATIONS]] += last - first
    return largest


@_kernel
def _agrees(I: Any, y: Any, z: Any, P: Any, problem: Any, shape: Any, table: Any, rule: int) -> bool:
    """Whether a finer rule gives the same averages, to the rounding of its own sums and of its points."""
    d, s = y.size, shape[STAGES]
    used, finer = np.empty((s, d)), np.empty((s, d))
    _averages(I, y, z, P, problem, shape, table, 2 * rule, used)
    size = _averages(I, y, z, P, problem, shape, table, 2 * rule + 1, finer)
    widest, difference, turn = 0.0, 0.0, 0.0
    first, last = _nodes(shape, 2 * rule + 1)
    for i in range(s):
        total = 0.0
        for n in range(first, last):
            total += abs(table[n, i])
        widest = max(widest, total)
        for r in range(d):
            difference = max(difference, abs(finer[i, r] - used[i, r]))
    u, a, b, none = np.empty(d), np.empty(d), np.empty(d), np.empty((1, 1))
    for end in range(2):
        # The weights of y1 are the last row.
        _state(y, z, table, table.shape[0] - 1, 0, u)
        for i in range(d):
            u[i] = u[i] if end == 1 else y[i]
        call_problem(problem, (module.GRADIENT, u, u, none, a, P))
        for i in range(d):
            u[i] *= 1.0 + 2.0**-26
        call_problem(problem, (module.GRADIENT, u, u, none, b, P))
        for i in range(d):
            turn = max(turn, abs(b[i] - a[i]) * 2.0**26)
    return difference <= 2.0**-52 * ((last - first) * size * widest + 4.0 * turn)


@_kernel
def _stages_system(
    I: Any, y: Any, z: Any, v: Any, P: Any, problem: Any, shape: Any, table: Any, rule: int, K: Any, F: Any
) -> None:
    """1 − K and F = z − R of all stages: see `sepv.schemes.collocation`."""
    d, s = y.size, shape[STAGES]
    g, none, turning = np.empty((s, d)), np.empty(d), np.empty(d)
    u, B, T, C = np.empty(d), np.empty((d, d)), np.empty((d, d)), np.empty((d, d))
    bent = np.zeros((s * s, d, d))
    _averages(I, y, z, P, problem, shape, table, rule, g)
    first, last = _nodes(shape, rule)
    for n in range(first, last):
        _state(y, z, table, n, s, u)
        call_problem(problem, (module.HESSIAN, u, u, C, none, P))
        for i in range(s * s):
            factor = table[n, i // s] * table[n, s + i % s]
            for l in range(d):
                for c in range(d):
                    bent[i, l, c] += factor * C[l, c]
    for i in range(s):
        # The stages are the rows before the last.
        _state(y, z, table, table.shape[0] - 1 - s + i, 0, u)
        call_problem(problem, (module.STRUCTURE, u, u, B, none, P))
        for r in range(d):
            turning[r] = g[i, r]
        call_problem(problem, (module.TURNED, u, turning, T, none, P))
        for r in range(d):
            field = 0.0
            for l in range(d):
                field += B[r, l] * g[i, l]
            F[i * d + r] = z[i * d + r] - v[0] * field
            for j in range(s):
                for c in range(d):
                    value = table[table.shape[0] - 1 - s + i, j] * T[r, c]
                    for l in range(d):
                        value += B[r, l] * bent[i * s + j, l, c]
                    K[i * d + r, j * d + c] = (1.0 if i == j and r == c else 0.0) - v[0] * value


@_kernel
def _inside(y: Any, z: Any, P: Any, problem: Any, shape: Any, table: Any, rule: int) -> bool:
    """Whether y1, and the stages and the points of the quadrature, are in the domain."""
    d, s = y.size, shape[STAGES]
    u, none = np.empty(d), np.empty((1, 1))
    if s == 0:
        for i in range(d):
            u[i] = y[i] + z[i]
        return call_problem(problem, (module.INSIDE, u, u, none, u, P)) != 0
    first, last = _nodes(shape, rule)
    good = True
    for n in range(first, last):
        _state(y, z, table, n, s, u)
        good = good and call_problem(problem, (module.INSIDE, u, u, none, u, P)) != 0
    for n in range(table.shape[0] - 1 - s, table.shape[0]):
        _state(y, z, table, n, 0, u)
        good = good and call_problem(problem, (module.INSIDE, u, u, none, u, P)) != 0
    return good


@_kernel
def _newton(  # noqa: PLR0912 - every test in one loop
    I: Any, y: Any, z: Any, v: Any, P: Any, problem: Any, shape: Any, table: Any, rule: int
) -> int:
    """z = R(z) from z, which it changes; the status."""
    n, d = z.size, y.size
    F, K, tried, x = np.empty(n), np.empty((n, n)), np.empty(n), np.empty(2 * d)
    before, limit = np.inf, module.FIRST
    for _ in range(MAX_ITERATIONS):
        I[shape[WORK]] += 1
        if shape[STAGES] == 0:
            for i in range(d):
                x[i], x[d + i] = y[i], z[i]
            call_problem(problem, (module.EQUATION, x, v, K, F, P))
        else:
            _stages_system(I, y, z, v, P, problem, shape, table, rule, K, F)
        residual, total, scale = 0.0, 0.0, 0.0
        for i in range(n):
            residual = max(residual, abs(F[i]))
            total += abs(F[i])
            scale = max(scale, abs(y[i % d]) + abs(z[i]))
        if not total < np.inf:
            return module.BROKEN
        if residual == 0.0:  # a state at rest is a solution, also where the Jacobian is singular
            return 0
        c = pivoted(K, F)
        m, total = 0.0, 0.0
        for i in range(n):
            m = max(m, abs(c[i]))
            total += abs(c[i])
        if not total < np.inf:
            return module.SINGULAR
        done = (m <= limit * scale and m * m <= module.LEFT * (scale * before)) or m <= module.TINY * scale
        small = m <= STAGNATION * scale and residual <= ROUNDING * scale
        done = done or (small and m >= 0.5 * before)
        before, limit, factor, found = m, STAGNATION, 1.0, False
        for _halving in range(MAX_HALVINGS):
            for i in range(n):
                tried[i] = z[i] - factor * c[i]
            if _inside(y, tried, P, problem, shape, table, rule):
                found = True
                break
            done = False
            factor *= 0.5
        if not found:
            return module.LEFT_DOMAIN
        for i in range(n):
            z[i] = tried[i]
        if done:
            return 0
    return module.NO_CONVERGENCE


@njit(CAREFUL, error_model="numpy", nogil=True, cache=True)
def careful(S: Any, I: Any, k: int, P: Any, problem: Any, shape: Any, table: Any) -> int:
    """Lane k by itself from z = 0, with finer rules until two agree where there are rules; its status."""
    L, d, unknowns = shape[LANES], shape[D], shape[UNKNOWNS]
    y, z, v = np.empty(d), np.zeros(unknowns), np.empty(shape[KNOWN])
    for i in range(d):
        y[i] = S[i * L + k]
    for i in range(v.size):
        v[i] = S[shape[STEP_ROWS] + i * L + k]
    for rule in range(max(1, shape[RULES])):
        code = _newton(I, y, z, v, P, problem, shape, table, 2 * rule)
        if code != 0:
            return code
        if shape[EXACT] != 0 or _agrees(I, y, z, P, problem, shape, table, rule):
            for i in range(unknowns):
                S[shape[UNKNOWN_ROWS] + i * L + k] = z[i]
            return 0
    return module.QUADRATURE


CAREFULLY = address(careful)
