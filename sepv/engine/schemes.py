"""The formulas of the schemes as code: R and ∂R/∂z of y1 = y0 + R(y0, z), z = y1 − y0, or R itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sepv.engine.code import ProblemCode, Table
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


def field(e: Text, B: Table, g: Sequence[Expression]) -> list[Expression]:
    """B g."""
    return [e.dot(row, g) for row in B]


def slope(
    e: Text, B: Table, derivative: Sequence[Table], g: Sequence[Expression], hessian: Table, half: str
) -> Table:
    """half·B′[·]g + B·hessian: the derivative of B(ȳ)g(z)."""
    d = len(g)
    halves = [e.product(half, v) for v in g]
    table: Table = [[None] * d for _ in range(d)]
    for i in range(d):
        for k in range(d):
            value = e.dot(derivative[k][i], halves)
            for j in range(d):
                value = e.plus(B[i][j], hessian[j][k], value)
            table[i][k] = value
    return table


def scaled(e: Text, factor: str, table: Table) -> Table:
    """factor·table."""
    return [[e.product(factor, v) for v in row] for row in table]


def middle(e: Text, y: Sequence[str], z: Sequence[str]) -> list[str]:
    """ȳ = y + z/2."""
    return [str(e.plus("(0.5)", b, a)) for a, b in zip(y, z, strict=True)]


def energy_preserving(
    e: Text, problem: ProblemCode, y: Sequence[str], z: Sequence[str], delta: str
) -> tuple[list[Expression], Table]:
    """(2.1): R = Δ B(ȳ) ∇̄H, K = Δ(½ B′(ȳ)[·]∇̄H + B(ȳ) ∫τH″dτ)."""
    mid = middle(e, y, z)
    B, g = problem.structure(e, mid), problem.mean_gradient(e, y, z)
    K = slope(e, B, problem.structure_derivative(e, mid), g, problem.mean_hessian(e, y, z), "0.5")
    return [e.product(delta, f) for f in field(e, B, g)], scaled(e, delta, K)


def midpoint(
    e: Text, problem: ProblemCode, y: Sequence[str], z: Sequence[str], delta: str
) -> tuple[list[Expression], Table]:
    """(3.4): R = Δ f(ȳ), K = ½ Δ f′(ȳ)."""
    mid = middle(e, y, z)
    B, g = problem.structure(e, mid), problem.gradient(e, mid)
    K = slope(e, B, problem.structure_derivative(e, mid), g, problem.hessian(e, mid), "(1.0)")
    half = e.let(f"0.5 * {delta}")
    return [e.product(delta, f) for f in field(e, B, g)], scaled(e, half, K)


FORMULAS: dict[str, Formula] = {
    "energy-preserving": Formula(energy_preserving, True, 1, 1, averaged=True),
    "midpoint": Formula(midpoint, True, 1, 1),
}
