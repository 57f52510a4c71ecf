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
from sepv.problem._hamiltonians import combined_gradient
from sepv.problem._structures import each_noise
from sepv.problems._common import HAT
from sepv.schemes._one_step import EVERY, Solved, no_jacobian, one_step
from sepv.schemes._order_claims import Orders
from sepv.solve import solve as solve_implicit
from sepv.solve._solution import Increment, Solution, once


def parts(problem: Problem, x: Array, step: Array) -> tuple[Array, Array]:
    """The vectors f = B(x)m and (mᵀx)m, both (d, M), the second copy by copy."""
    m = combined_gradient(problem, x, step)
    f, bent = np.empty_like(x), np.empty_like(x)
    for n in range(0, len(x), 3):
        (a, b, c), (p, q, r) = x[n : n + 3], m[n : n + 3]
        f[n : n + 3] = b * r - c * q, c * p - a * r, a * q - b * p
        bent[n : n + 3] = (a * p + b * q + c * r) * m[n : n + 3]
    return f, bent


def increment(problem: Problem, y0: Array, x: Array, step: Array) -> Increment:  # noqa: ARG001 - as for all
    """The right side ½f(x) − ¼(mᵀx)m of the equation for x; all gradients count as one evaluation."""
    f, bent = parts(problem, x, step)
    return once(0.5 * f - 0.25 * bent)


def require_spins(problem: Problem, y: Array) -> None:
    """Raise Skipped where the structure is not B(y)v = y × v in blocks of three."""
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
    require_spins(problem, y)
    step = each_noise(problem, h, dW)
    found = solve_implicit(problem, y, step, increment, no_jacobian)
    f, _ = parts(problem, found.value, step)
    # y1 − y0 = f, without the cancellation of the parts that y0 and y1 share.
    return replace(found, value=y + f, change=f)


scheme = one_step(
    "isospectral-midpoint",
    Solved(solve),
    EVERY | {"identity", "casimir", "poisson-map", "symmetry", "noise-sum"},
    "Ephrati, Jansson, Lang and Luesink, arXiv 2408.16701",
    weak_order=1.0,
    mean_square_order=Orders(0.5, commutative=1.0),
    systems=Systems.SO3_HAMILTONIANS,
)
