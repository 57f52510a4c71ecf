"""Explicit Runge-Kutta methods projected on the invariants:
(2.1)'s strongest rival if a problem is not stiff.

The end y* of the explicit step of order p is corrected along a direction v_k for each invariant
I_k,

    y1 = y* − Σ_k λ_k v_k   with   I_k(y1) = I_k(y0)

for H and every quadratic or linear Casimir: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical
Integration (2006), IV.4. The directions are `sepv.problem.projections` at y*. The numbers λ are
found by the simplified Newton iteration with the products ∇I_jᵀv_k at y*. The differences I_k(y)
− I_k(y0) are computed as g_kᵀ(y − y0) with g_k = ∫₀¹∇I_k(y0 + τ(y − y0))dτ, so that no digits
cancel, even with a large constant in H.

**Order.** y1 differs from y* by O(Δ^{p+1}), so that the orders are those of the explicit method.
The method is not symmetric, and for quadratic H it is not the midpoint rule.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from sepv.core.arrays import Lanes
from sepv.core.formula import CountedFields
from sepv.core.newton import Flagged, Status, newton
from sepv.core.step import Solution
from sepv.problem import Array, Problem, average_gradient, casimir_gradients, dot, projections
from sepv.schemes._explicit import end, explicit
from sepv.schemes._explicit_tableaux import TABLEAUX
from sepv.schemes._one_step import Solved, one_step
from sepv.schemes._scheme import Scheme


def solve_projection(problem: Problem, order: int, y0: Array, delta: Array) -> Solution:
    """Solve one step of a batch of M paths from y0 (d, M) with random steps `delta` (M,).

    The unknown is z = y1 − y0, and the iteration starts from y* − y0, the increment of the explicit
    method.
    """
    tableau, M = TABLEAUX[order], y0.shape[1]
    casimirs, evaluations = (problem.casimirs, problem.linear_casimirs), np.zeros(M, dtype=np.int64)

    def advance(values: Any, lanes: Lanes) -> tuple[Array, Array, Flagged]:
        """The change Σ_k λ_k v_k that is too much, which is residual and correction of a simplified
        iteration.
        """
        start, z = y0[:, lanes], np.reshape(values, (len(values), -1))
        mean = average_gradient(problem, start, start + z)
        evaluations[lanes] += mean.evaluations
        averages = [*casimir_gradients(*casimirs, 2.0 * start + z), mean.value]
        moved = along.of(lanes).correction([dot(g, z) for g in averages])
        return moved, moved, Flagged(np.logical_not(mean.reliable), True)

    with np.errstate(all="ignore"):
        full = end(tableau, CountedFields(problem, y0, y0), y0, None, delta[None])
        far = y0 + full
        slopes = casimir_gradients(*casimirs, 2.0 * far)
        along = projections(problem.structure(far), problem.gradient(far), slopes)
        root = newton(advance, np.abs(y0), full, np.arange(M))
        y1, status = y0 + root.value, root.status
        if problem.domain is not None:
            outside = ~np.asarray(problem.domain(y1), dtype=bool)
            status[outside & (status == Status.CONVERGED)] = Status.LEFT_DOMAIN
    gradients, structures = evaluations + len(tableau.A) + 1, np.full(M, len(tableau.A) + 1)
    return Solution(y1, root.residual, root.iterations, gradients, structures, status, change=root.value)


@lru_cache(maxsize=4)
def projected(order: int) -> Scheme:
    """The scheme of the projected method of order 4 or 8; any other order raises UsageError.

    Increments are truncated to √(2kh|ln h|) (Remark 2.1) with k = 2·order. Residuals are those of
    the projection.
    """
    plain = explicit(order)

    def solve(problem: Problem, y: Array, h: float, dW: Array) -> Solution:
        return solve_projection(problem, order, y, problem.random_step(h, dW))

    return one_step(
        f"projected-{order}",
        Solved(solve),
        # Equivariance is not claimed, because the directions depend on lengths, which linear maps
        # change.
        (frozenset(plain.claims) | {"energy", "casimir"}) - {"equivariance"},
        "explicit Runge-Kutta with the random step, and projection",
        order / 2,
    )
