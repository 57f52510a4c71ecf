"""How the engine takes the step of each scheme: by the record of its formula, or by code for explicit and staged ones.

R and K share what they have in common, since an expression written twice has one name: see `sepv.engine.text`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from sepv import formula
from sepv.engine.code import ProblemCode, Table, skew
from sepv.engine.text import Expression, Text
from sepv.explicit_tableaux import TABLEAUX
from sepv.schemes.both_invariants import formula as both_invariants
from sepv.schemes.energy_preserving import formula as energy_preserving
from sepv.schemes.midpoint import formula as midpoint
from sepv.tableaux import MAX_STAGES, gauss_tableau


@dataclass(frozen=True)
class Formula:
    """How the engine takes a step.

    Attributes
    ----------
    increment : (text, problem, y, z, delta) -> R of an explicit scheme
        `delta` is the name of the random step Δ.
    recorded : of a scheme whose equation z = R Newton's iteration solves, from its file
    gradients, structures : evaluations of ∇H and of B in an iteration.
    averaged : whether a gradient is an averaged one, which may take several evaluations of ∇H.
    """

    increment: Callable[[Text, ProblemCode, Sequence[str], Sequence[str], str], list[Expression]] | None
    implicit: bool
    gradients: int
    structures: int
    averaged: bool = False
    stages: int = 1
    recorded: formula.Formula | None = None

    def update(self, e: Text, z: Sequence[str]) -> list[str]:
        """y1 − y0."""
        return list(z)

    def states(self, e: Text, y: Sequence[str], z: Sequence[str]) -> list[list[str]]:
        """The states that must lie in the domain."""
        return [[e.let(f"{a} + {b}") for a, b in zip(y, z, strict=True)]]


def field(e: Text, B: Table, g: Sequence[Expression]) -> list[Expression]:
    """B g."""
    return [e.dot(row, g) for row in B]


def slope(e: Text, B: Table, derivative: Sequence[Table], g: Sequence[Expression], hessian: Table) -> Table:
    """B′[·]g + B·hessian."""
    d = len(g)
    table: Table = [[None] * d for _ in range(d)]
    for i in range(d):
        for k in range(d):
            value = e.dot(derivative[k][i], g)
            for j in range(d):
                value = e.plus(B[i][j], hessian[j][k], value)
            table[i][k] = value
    return table


def scaled(e: Text, factor: str, table: Table) -> Table:
    """factor·table for a skew table."""
    d = len(table)
    upper = {(i, j): e.product(factor, table[i][j]) for i in range(d) for j in range(i + 1, d)}
    return skew(d, upper, e)


def middle(e: Text, y: Sequence[str], z: Sequence[str]) -> list[str]:
    """ȳ = y + z/2."""
    return [a if b == "0.0" else str(e.plus("(0.5)", b, a)) for a, b in zip(y, z, strict=True)]


def rate(e: Text, problem: ProblemCode, y: Sequence[str], delta: str = "(1.0)") -> list[Expression]:
    """Δ f(y), f = B∇H multiplied out where that is a few monomials: explicit steps do not need B and ∇H apart."""
    if problem.field is not None:
        return [e.polynomial(p, y, delta) for p in problem.field]
    return [e.product(delta, v) for v in field(e, problem.structure(e, y), problem.gradient(e, y))]


def along_itself(
    e: Text, problem: ProblemCode, y: Sequence[str]
) -> tuple[list[Expression], list[Expression]]:
    """f and f′f."""
    B, g = problem.structure(e, y), problem.gradient(e, y)
    f = field(e, B, g)
    K = slope(e, B, problem.structure_derivative(e, y), g, problem.hessian(e, y))
    return f, [e.dot(row, f) for row in K]


def euler_heun(
    e: Text, problem: ProblemCode, y: Sequence[str], z: Sequence[str], delta: str
) -> list[Expression]:
    """h f(y0) + ½(f(ŷ) + f(y0)) S, ŷ = y0 + f(y0)(h + S)."""
    f = rate(e, problem, y)
    predicted = [str(e.plus(delta, v, a)) for v, a in zip(f, y, strict=True)]
    mean = [e.product("(0.5)", e.total([a, b])) for a, b in zip(rate(e, problem, predicted), f, strict=True)]
    return [e.plus(m, "noise", e.product("h", v)) for m, v in zip(mean, f, strict=True)]


def milstein(
    e: Text, problem: ProblemCode, y: Sequence[str], z: Sequence[str], delta: str
) -> list[Expression]:
    """f (h + S) + ½ f′f S²."""
    f, second = along_itself(e, problem, y)
    square = e.let("0.5 * noise * noise")
    return [e.plus(square, b, e.product(delta, a)) for a, b in zip(f, second, strict=True)]


def runge_kutta(order: int) -> Any:
    """The explicit method of this order with the step Δ."""
    tableau = TABLEAUX[order]

    def increment(
        e: Text, problem: ProblemCode, y: Sequence[str], z: Sequence[str], delta: str
    ) -> list[Expression]:
        moves: list[list[Expression]] = []
        for row in tableau.A:
            state: list[str] = list(y)
            for j, a in row.items():
                state = [str(e.plus(e.number(a), v, s)) for v, s in zip(moves[j], state, strict=True)]
            moves.append(rate(e, problem, state, delta))
        total: list[Expression] = [None] * len(y)
        for i, b in tableau.b.items():
            total = [e.plus(e.number(b), v, s) for v, s in zip(moves[i], total, strict=True)]
        return total

    return increment


def at(e: Text, y: Sequence[str], z: Sequence[str], integrals: Any) -> list[str]:
    """u = y + Σ_j integrals_j z_j, the stages one after the other in z."""
    d = len(y)
    state = list(y)
    for j, weight in enumerate(integrals):
        for k in range(d):
            if z[j * d + k] != "0.0":
                state[k] = str(e.plus(e.number(float(weight)), z[j * d + k], state[k]))
    return state


@dataclass(frozen=True)
class Collocation(Formula):
    """The s-stage method: z_i = Δ B(Y_i) g_i with g_i = b_i⁻¹∫ℓ_i∇H(u), y1 = y0 + Σ b_i z_i."""

    def sweep(
        self,
        e: Text,
        problem: ProblemCode,
        y: Sequence[str],
        z: Sequence[str],
        delta: str,
        averages: Sequence[Sequence[Expression]] | None,
    ) -> list[Expression]:
        """The right-hand sides at z, the stages one after the other; the g_i are the ∇H(Y_i) where not given."""
        R: list[Expression] = []
        for i, row in enumerate(gauss_tableau(self.stages).A):
            Y = at(e, y, z, row)
            g = problem.gradient(e, Y) if averages is None else averages[i]
            R += field(e, scaled(e, delta, problem.structure(e, Y)), g)
        return R

    def update(self, e: Text, z: Sequence[str]) -> list[str]:
        """Σ b_i z_i."""
        d = len(z) // self.stages
        sums: list[Expression] = [None] * d
        for j, b in enumerate(gauss_tableau(self.stages).b):
            sums = [e.plus(e.number(float(b)), z[j * d + k], sums[k]) for k in range(d)]
        return [str(s) for s in sums]

    def states(self, e: Text, y: Sequence[str], z: Sequence[str]) -> list[list[str]]:
        """y1 and the stages."""
        tableau = gauss_tableau(self.stages)
        return [at(e, y, z, row) for row in (tableau.b, *tableau.A)]


@dataclass(frozen=True)
class Projected(Formula):
    """An explicit increment, projected on the invariants; `gradients` and `structures` are those of the increment."""


EP = Formula(None, True, 1, 1, averaged=True, recorded=energy_preserving)
FORMULAS: dict[str, Formula] = {
    "energy-preserving": EP,
    "midpoint": Formula(None, True, 1, 1, recorded=midpoint),
    "both-invariants": Formula(None, True, 1, 1, averaged=True, recorded=both_invariants),
    "euler-heun": Formula(euler_heun, False, 2, 2),
    "milstein": Formula(milstein, False, 1, 1),
    "explicit-4": Formula(runge_kutta(4), False, 4, 4),
    "explicit-8": Formula(runge_kutta(8), False, 12, 12),
    "projected-4": Projected(runge_kutta(4), True, 4, 4, averaged=True),
    "projected-8": Projected(runge_kutta(8), True, 12, 12, averaged=True),
    "collocation-1": EP,
    **{f"collocation-{s}": Collocation(None, True, 1, s, True, s) for s in range(2, MAX_STAGES + 1)},
}
