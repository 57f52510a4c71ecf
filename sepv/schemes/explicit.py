"""Explicit Runge-Kutta methods of order 4 and 8 with the random step Δ = h + Σ_j c_j ΔŴ_j: the honest rivals.

y(t) is the deterministic flow at the random time t + Σ c_j W_j(t), so that a method of order p for y′ = f(y), used with
the step Δ, has a local error C(y)Δ^{p+1} of root mean square O(h^{(p+1)/2}) and mean O(h^{⌈(p+1)/2⌉}): for even p
mean-square and weak order p/2 by Milstein's theorem. They keep neither H nor Casimirs.
"""

from __future__ import annotations

from functools import lru_cache

from sepv.errors import UsageError
from sepv.explicit_tableaux import TABLEAUX, ExplicitTableau
from sepv.fields import vector_field
from sepv.problem import Array, Problem
from sepv.scheme import Scheme, as_lanes, truncation_for


def end(problem: Problem, tableau: ExplicitTableau, y0: Array, delta: Array, start: Array) -> Array:
    """start + Δ Σ b_i f(Y_i) for y0 (d, M) and Δ (M,): the step's end from y0, its increment from zero."""
    slopes: list[Array] = []
    for row in tableau.A:
        state = y0
        for j, a in row.items():
            state = state + (a * delta) * slopes[j]
        slopes.append(vector_field(problem, state))
    for i, b in tableau.b.items():
        start = start + (b * delta) * slopes[i]
    return start


@lru_cache(maxsize=4)
def explicit(order: int) -> Scheme:
    """The method of order 4 (classical) or 8 (Dormand and Prince), as a scheme with truncation k = 2·order.

    Raises
    ------
    UsageError
        For another order.
    """
    if order not in TABLEAUX:
        raise UsageError(
            expected=f"an order, one of {', '.join(map(str, TABLEAUX))}",
            received=repr(order),
            remedy="take 8",
        )
    tableau = TABLEAUX[order]

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        """One step, for y of shape (d,) or (d, M) and dW of shape (m,) or (m, M)."""
        y0, noise = as_lanes(problem, y, h, dW)
        return end(problem, tableau, y0, problem.random_step(h, noise), y0).reshape(y.shape)

    return Scheme(
        name=f"explicit-{order}",
        step=step,
        claims=(
            "contract",
            "reproducibility",
            "identity",
            "noise-sum",
            "random-step",
            "expansion",
            "equivariance",
            "truncation",
        ),
        mean_square_order=order / 2,
        weak_order=order / 2,
        source="explicit Runge-Kutta with the random step",
        truncation=truncation_for(order / 2),
        batched=True,
    )
