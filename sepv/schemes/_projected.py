"""Explicit Runge-Kutta methods projected on the invariants: the strongest rival where steps are not stiff.

From the end y* of the explicit step of order p one goes along the gradients of the invariants there,

    y1 = y* − Σ_k λ_k ∇I_k(y*)   with   I_k(y1) = I_k(y0)

for H and every quadratic or linear Casimir: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006),
IV.4. The λ are found by the simplified Newton iteration whose matrix is that of the products ∇I_jᵀ∇I_k at y*. The
differences I_k(y) − I_k(y0) are computed as g_kᵀ(y − y0) with g_k = ∫₀¹∇I_k(y0 + τ(y − y0))dτ, which is the same number
without cancellation: a large constant in H costs nothing.

**Order.** y1 differs from y* by O(Δ^{p+1}): the orders are those of the explicit method. It is neither symmetric nor
the midpoint rule for quadratic H, and what it keeps, it keeps by moving the state along gradients, not by B.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from sepv.problem import Array, Problem, average_gradient, casimir_gradients
from sepv.problem._fields import dot
from sepv.schemes._explicit import end, explicit
from sepv.schemes._explicit_tableaux import TABLEAUX
from sepv.schemes._one_step import Solved, one_step
from sepv.schemes._scheme import Scheme
from sepv.solve._formula import Asked
from sepv.solve._solution import Solution, Status
from sepv.solve._stop_rule import ROUNDING

# Each iteration gains a factor of about |I″||y1 − y*|/|∇I|; a step that needs more than this is far too coarse.
MOST = 30
# Gradients closer to those before them than this, relative to their length, are the same to rounding: they add nothing.
DEPENDENT = 2.0**-40
# Changes below a quarter of a rounding of the state.
TINY = 2.0**-54


class Directions:
    """Gradients N_k (d, M) at y* and Gram and Schmidt's vectors q_k, each made orthogonal twice."""

    def __init__(self, gradients: list[Array]) -> None:
        self.q: list[Array] = []
        self.inverse: list[Array] = []
        self.products: list[list[Array]] = []
        for N in gradients:
            q = N
            for _ in range(2):
                for b, inverse in zip(self.q, self.inverse, strict=True):
                    q = q - b * (dot(b, q) * inverse)
            left, length = dot(q, q), dot(N, N)
            new = left > DEPENDENT**2 * length
            self.products.append([dot(b, N) for b in self.q])
            self.q.append(q)
            self.inverse.append(np.where(new, 1.0 / np.where(new, left, 1.0), 0.0))

    def correction(self, r: list[Array], lanes: np.ndarray) -> Array:
        """u in the span of the N_k with N_kᵀu = r_k, where they are independent."""
        weights: list[Array] = []
        for k, moved in enumerate(r):
            value = moved
            for w, product in zip(weights, self.products[k], strict=True):
                value = value - product[lanes] * w
            weights.append(value * self.inverse[k][lanes])
        return np.asarray(sum(q[:, lanes] * w for q, w in zip(self.q, weights, strict=True)))


def solve_projection(problem: Problem, order: int, y0: Array, delta: Array) -> Solution:
    """One step of a batch: y0 (d, M), Δ (M,). The unknown is z = y1 − y0, and its start z* = y* − y0."""
    tableau = TABLEAUX[order]
    with np.errstate(all="ignore"):
        full = end(tableau, Asked(problem, y0, y0), y0, None, delta[None])
        M = y0.shape[1]
        z, status = full.copy(), np.full(M, Status.NO_CONVERGENCE, dtype=np.int64)
        iterations, gradients = np.zeros(M, dtype=np.int64), np.full(M, len(tableau.A) + 1)
        residual, before = np.zeros(M), np.full(M, np.inf)
        scale = np.maximum(np.max(np.abs(y0), axis=0), np.max(np.abs(full), axis=0))
        casimirs, far = (problem.casimirs, problem.linear_casimirs), y0 + full
        directions = Directions([problem.gradient(far), *casimir_gradients(*casimirs, 2.0 * far)])
        lanes = np.arange(M)
        for _ in range(MOST):
            if not lanes.size:
                break
            start, moved = y0[:, lanes], z[:, lanes]
            mean = average_gradient(problem, start, start + moved)
            averages = [mean.value, *casimir_gradients(*casimirs, 2.0 * start + moved)]
            correction = directions.correction([dot(g, moved) for g in averages], lanes)
            change = np.max(np.abs(correction), axis=0)
            iterations[lanes] += 1
            gradients[lanes] += mean.evaluations
            z[:, lanes] -= correction
            residual[lanes] = change
            # What no longer shrinks is the rounding of r_k = g_kᵀz beside |∇I_k|, at most K·eps·|z| where K operations
            # stand behind g_k: no more of them than behind R in `sepv.solve._newton`.
            stays = (change >= 0.5 * before[lanes]) & (change <= ROUNDING * scale[lanes])
            done = (change <= TINY * scale[lanes]) | stays
            broken = ~np.isfinite(change)
            status[lanes[done]] = Status.CONVERGED
            status[lanes[~mean.reliable]] = Status.QUADRATURE
            status[lanes[broken]] = Status.OVERFLOW
            before[lanes] = change
            lanes = lanes[~done & ~broken & mean.reliable]
        y1 = y0 + z
        if problem.domain is not None:
            outside = ~np.asarray(problem.domain(y1), dtype=bool)
            status[outside & (status == Status.CONVERGED)] = Status.LEFT_DOMAIN
        structures = np.full(M, len(tableau.A))
    return Solution(y1, residual, iterations, gradients, structures, status, change=z)


@lru_cache(maxsize=4)
def projected(order: int) -> Scheme:
    """The projected method of order 4 or 8, else a UsageError, as a scheme with truncation k = 2·order."""
    plain = explicit(order)

    def solve(problem: Problem, y: Array, h: float, dW: Array) -> Solution:
        """One step of a batch with residual (of the projection), counts and status of each lane."""
        return solve_projection(problem, order, y, problem.random_step(h, dW))

    return one_step(
        f"projected-{order}",
        Solved(solve),
        # Not equivariance: orthogonal to a gradient means something in a metric, which linear maps do not keep.
        (frozenset(plain.claims) | {"energy", "casimir"}) - {"equivariance"},
        "explicit Runge-Kutta with the random step, and projection",
        order / 2,
    )
