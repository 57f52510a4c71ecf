"""The formulas of the schemes as code: R and ∂R/∂z of y1 = y0 + R(y0, z), z = y1 − y0, or R itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sepv.engine.code import ProblemCode, Table, skew
from sepv.engine.text import Expression, Text


@dataclass(frozen=True)
class Formula:
    """How the engine takes a step.

    Attributes
    ----------
    increment : (text, problem, y, z, delta) -> R, K
        R and, for implicit schemes, K = ∂R/∂z. `delta` is the name of the random step Δ.
    gradients, structures : evaluations of ∇H and of B in an iteration.
    averaged : whether a gradient is an averaged one, which may take several evaluations of ∇H.
    """

    increment: Callable[
        [Text, ProblemCode, Sequence[str], Sequence[str], str], tuple[list[Expression], Table]
    ]
    implicit: bool
    gradients: int
    structures: int
    averaged: bool = False
    stages: int = 1

    def update(self, e: Text, z: Sequence[str]) -> list[str]:  # noqa: ARG002 - for more stages
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


def energy_preserving(
    e: Text, problem: ProblemCode, y: Sequence[str], z: Sequence[str], delta: str
) -> tuple[list[Expression], Table]:
    """(2.1): R = Δ B(ȳ) ∇̄H, K = Δ(½ B′(ȳ)[·]∇̄H + B(ȳ) ∫τH″dτ)."""
    mid = middle(e, y, z)
    B, g = scaled(e, delta, problem.structure(e, mid)), problem.mean_gradient(e, y, z)
    half = e.let(f"0.5 * {delta}")
    halves = [e.product(half, v) for v in g]
    K = slope(e, B, problem.structure_derivative(e, mid), halves, problem.mean_hessian(e, y, z))
    return field(e, B, g), K


def midpoint(
    e: Text, problem: ProblemCode, y: Sequence[str], z: Sequence[str], delta: str
) -> tuple[list[Expression], Table]:
    """(3.4): R = Δ f(ȳ), K = ½ Δ f′(ȳ)."""
    mid = middle(e, y, z)
    B, g = problem.structure(e, mid), problem.gradient(e, mid)
    half = e.let(f"0.5 * {delta}")
    halves = [e.product(half, v) for v in g]
    K = slope(e, scaled(e, half, B), problem.structure_derivative(e, mid), halves, problem.hessian(e, mid))
    return field(e, scaled(e, delta, B), g), K


FORMULAS: dict[str, Formula] = {
    "energy-preserving": Formula(energy_preserving, True, 1, 1, averaged=True),
    "midpoint": Formula(midpoint, True, 1, 1),
}
