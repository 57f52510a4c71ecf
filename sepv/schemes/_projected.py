"""Explicit Runge-Kutta methods projected on the invariants: (2.1)'s strongest rival if a problem is not stiff.

The end y* of the explicit step of order p is corrected along a direction v_k for each invariant I_k,

    y1 = y* − Σ_k λ_k v_k   with   I_k(y1) = I_k(y0)

for H and every quadratic or linear Casimir: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006),
IV.4. The directions are `sepv.problem.projections` at y*. The numbers λ are found by the simplified Newton iteration
with the products ∇I_jᵀv_k at y*. The differences I_k(y) − I_k(y0) are computed as g_kᵀ(y − y0) with
g_k = ∫₀¹∇I_k(y0 + τ(y − y0))dτ, so that no digits cancel, even with a large constant in H.

**Order.** y1 differs from y* by O(Δ^{p+1}), so that the orders are those of the explicit method. The method is not
symmetric, and for quadratic H it is not the midpoint rule.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from sepv.problem import Algebra, Array, Problem, average_gradient, casimir_gradients, dot, projections
from sepv.schemes._explicit import end, explicit
from sepv.schemes._explicit_tableaux import TABLEAUX
from sepv.schemes._one_step import Solved, one_step
from sepv.schemes._scheme import Scheme
from sepv.solve import CountedFields, Equations, Evaluation, Increment, Lanes, Solution, Status, newton

# Newton's iteration if R already contains the inverse of the simplified matrix: the correction is z − R itself.
SIMPLIFIED = Algebra(lambda _, F: F, lambda K: np.ones(K.shape[-1], dtype=bool), lambda _, size: 0 * size)


def solve_projection(problem: Problem, order: int, y0: Array, delta: Array) -> Solution:
    """Solve one step of a batch of M paths from y0 (d, M) with random steps `delta` (M,).

    The unknown is z = y1 − y0, and the iteration starts from y* − y0, the increment of the explicit method.
    """
    tableau, M = TABLEAUX[order], y0.shape[1]
    casimirs = problem.casimirs, problem.linear_casimirs

    def evaluate(z: Array, lanes: Lanes) -> Evaluation:
        """The right side R of z = R(z): z minus Σ_k λ_k v_k, which corrects the change of the invariants."""
        start = y0[:, lanes]
        mean = average_gradient(problem, start, start + z)
        averages = [*casimir_gradients(*casimirs, 2.0 * start + z), mean.value]
        moved = along.of(lanes).correction([dot(g, z) for g in averages])
        none = np.zeros((0, 0, lanes.size))
        return Evaluation(Increment(z - moved, mean.evaluations, lanes * 0, mean.reliable), lambda: (none, 0))

    with np.errstate(all="ignore"):
        full = end(tableau, CountedFields(problem, y0, y0), y0, None, delta[None])
        far = y0 + full
        slopes = casimir_gradients(*casimirs, 2.0 * far)
        along = projections(problem.structure(far), problem.gradient(far), slopes)
        equations = Equations(np.abs(y0), evaluate, algebra=SIMPLIFIED)
        solution = newton(equations, full, np.arange(M), differences=False)
        y1, status = y0 + solution.value, solution.status
        if problem.domain is not None:
            outside = ~np.asarray(problem.domain(y1), dtype=bool)
            status[outside & (status == Status.CONVERGED)] = Status.LEFT_DOMAIN
    gradients, structures = solution.gradient_evaluations + len(tableau.A) + 1, np.full(M, len(tableau.A) + 1)
    return Solution(
        y1, solution.residual, solution.iterations, gradients, structures, status, change=solution.value
    )


@lru_cache(maxsize=4)
def projected(order: int) -> Scheme:
    """The scheme of the projected method of order 4 or 8; any other order raises UsageError.

    Increments are truncated to √(2kh|ln h|) (Remark 2.1) with k = 2·order. Residuals are those of the projection.
    """
    plain = explicit(order)

    def solve(problem: Problem, y: Array, h: float, dW: Array) -> Solution:
        return solve_projection(problem, order, y, problem.random_step(h, dW))

    return one_step(
        f"projected-{order}",
        Solved(solve),
        # Equivariance is not claimed, because the directions depend on lengths, which linear maps change.
        (frozenset(plain.claims) | {"energy", "casimir"}) - {"equivariance"},
        "explicit Runge-Kutta with the random step, and projection",
        order / 2,
    )
