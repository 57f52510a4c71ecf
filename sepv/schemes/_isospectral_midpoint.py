"""The isospectral midpoint rule on n copies of so(3)*: a Poisson integrator without an exponential map.

S. Ephrati, E. Jansson, A. Lang and E. Luesink, An exponential map free implicit midpoint method for stochastic
Lie-Poisson systems (arXiv 2408.16701), after K. Modin and M. Viviani (Found. Comput. Math. 20, 2020). With X = hat(x)
and M = hat(m), m = h∇H_0(x) + Σ c_j ΔŴ_j ∇H_j(x),

    W_0 = (1 − ½M)X(1 + ½M),  W_1 = (1 + ½M)X(1 − ½M)

up to the sign of M. hat(m)hat(x)hat(m) = −(mᵀx)hat(m) makes of this, with f = B(x)m and B(x)v = ±x × v,

    y0 = x − ½f + ¼(mᵀx)m,   y1 = x + ½f + ¼(mᵀx)m,

an equation for x and a formula for y1. |y1| = |y0| in each copy, because f is orthogonal to x and m. The paper proves
that the rule is a Poisson map, mean-square order ½ and weak order 1; where the noises commute the mean-square order is
1, as y1 then lacks nothing of the order of h.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sepv.errors import Skipped
from sepv.problem import Array, Problem, Systems
from sepv.problem._hamiltonians import noise_gradients
from sepv.problems._canonical import HAT
from sepv.schemes._one_step import EVERY, each_noise, no_jacobian, one_step, solved_by
from sepv.schemes._order_claims import Orders
from sepv.schemes._scheme import as_lanes
from sepv.solve import Increment
from sepv.solve import solve as solve_implicit
from sepv.solve._solution import Solution


def parts(problem: Problem, x: Array, step: Array) -> tuple[Array, Array]:
    """f = B(x)m and (mᵀx)m, (d, M) both, the second copy by copy."""
    m = step[0] * problem.gradient(x)
    for part, gradient in zip(step[1:], noise_gradients(problem), strict=True):
        m = m + part * gradient(x)
    f, bent = np.empty_like(x), np.empty_like(x)
    for n in range(0, len(x), 3):
        (a, b, c), (p, q, r) = x[n : n + 3], m[n : n + 3]
        f[n : n + 3] = b * r - c * q, c * p - a * r, a * q - b * p
        bent[n : n + 3] = (a * p + b * q + c * r) * m[n : n + 3]
    return f, bent


def increment(problem: Problem, y0: Array, x: Array, step: Array) -> Increment:
    """½f(x) − ¼(mᵀx)m, of which x = y0 + … is the solution; all gradients count as one evaluation."""
    ones = np.ones(y0.shape[1], dtype=np.int64)
    f, bent = parts(problem, x, step)
    return Increment(0.5 * f - 0.25 * bent, ones, ones, ones.astype(bool))


def require_spins(problem: Problem, y: Array) -> None:
    """B(y)v = y × v in blocks of three.

    Raises
    ------
    Skipped
        For another structure.
    """
    expected = np.zeros((len(y), len(y), y.shape[1]))
    for n in range(0, len(y) - len(y) % 3, 3):
        for i, j, k, sign in HAT:
            expected[n + i, n + j] = sign * y[n + k]
            expected[n + j, n + i] = -sign * y[n + k]
    if len(y) % 3 or not np.array_equal(problem.structure(y), expected):
        raise Skipped(
            f"the structure of {problem.name} is not that of so(3) in blocks of three, B(y)v = y × v"
        )


def solve(problem: Problem, y: Array, h: float, dW: Array) -> Solution:
    """One step of a batch with residual (of the equation for x), counts and status of each lane."""
    state, noise = as_lanes(problem, y, h, dW)
    require_spins(problem, state)
    step = each_noise(problem, h, noise)
    found = solve_implicit(problem, state, step, increment, no_jacobian)
    f, _ = parts(problem, found.value, step)
    # y1 − y0 = f: the sum of what y0 and y1 have in common is not formed again.
    return replace(found, value=state + f, change=f)


scheme = one_step(
    "isospectral-midpoint",
    solved_by(solve),
    EVERY | {"identity", "casimir", "poisson-map", "symmetry", "noise-sum"},
    "Ephrati, Jansson, Lang and Luesink, arXiv 2408.16701",
    weak_order=1.0,
    mean_square_order=Orders(0.5, commutative=1.0),
    solve=solve,
    systems=Systems.SO3_HAMILTONIANS,
)
