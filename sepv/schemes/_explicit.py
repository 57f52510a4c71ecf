"""Explicit Runge-Kutta methods of order 4 and 8 with the random step Δ = h + Σ_j c_j ΔŴ_j:
no invariant is kept.

The solution of (1.1) is the deterministic flow at the random time t + Σ c_j W_j(t). So a method of
order p for y′ = f(y), used with the step Δ, has a local error C(y)Δ^{p+1} of root mean square
O(h^{(p+1)/2}) and mean O(h^{⌈(p+1)/2⌉}). For even p Milstein's theorem gives mean-square and weak
order p/2.
"""

from __future__ import annotations

from functools import lru_cache, partial

from sepv.core.formula import Fields, Values
from sepv.errors import require_one_of
from sepv.schemes._explicit_tableaux import TABLEAUX, ExplicitTableau
from sepv.schemes._one_step import RANDOM_STEP, Explicit, one_step
from sepv.schemes._scheme import Scheme


def end(tableau: ExplicitTableau, fields: Fields, y: Values, z: Values, step: Values) -> Values:  # noqa: ARG001 - explicit
    """The increment y1 − y of an explicit Runge-Kutta step with Δ = step[0].

    The increment is Δ Σ b_i f(Y_i) with the stages Y_i = y + Δ Σ_{j<i} a_ij f(Y_j) and the field
    f = B∇H.
    """
    slopes: list[Values] = []
    for row in tableau.A:
        state = y
        for j, a in row.items():
            state = state + (a * step[0]) * slopes[j]
        slopes.append(fields.field(state))
    (i, b), *others = tableau.b.items()
    total = (b * step[0]) * slopes[i]
    for i, b in others:
        total = total + (b * step[0]) * slopes[i]
    return total


@lru_cache(maxsize=4)
def explicit(order: int) -> Scheme:
    """The scheme of the classical method of order 4 or of Dormand and Prince's of order 8;
    UsageError for other orders.

    Increments are truncated to √(2kh|ln h|) with k = 2·order, as in Remark 2.1 of Cohen and
    Dujardin.
    """
    require_one_of("an order", order, TABLEAUX, "take 8")
    return one_step(
        f"explicit-{order}",
        Explicit(partial(end, TABLEAUX[order])),
        RANDOM_STEP,
        "explicit Runge-Kutta with the random step",
        order / 2,
    )
