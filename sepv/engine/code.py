"""What the engine needs of a problem: its functions as scalar code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from sepv.engine.text import Expression, Text
from sepv.formula import Formula
from sepv.polynomial import Polynomial

Table = list[list[Expression]]


class ProblemCode(Protocol):
    """The functions of a problem, each written into a `Text` for given names of the components.

    `y` are the names of the d components, `z` those of the increment y1 − y.
    """

    dimension: int
    degree: int  # of a polynomial H, 0 of any other

    @property
    def preamble(self) -> str:
        """What a module needs before the kernel."""

    @property
    def gradient_evaluations(self) -> int:
        """Evaluations of ∇H that a mean gradient takes."""

    @property
    def rate(self) -> float:
        """What an iteration gains at least near the solution: the relative error of Newton's matrix."""

    @property
    def field(self) -> Sequence[Polynomial] | None:
        """B∇H multiplied out, where that is a few monomials: good enough for a start."""

    def __hash__(self) -> int:
        """Records of code are compared by identity."""

    def cost(self, formula: Formula, step: Sequence[str]) -> tuple[int, int]:
        """Evaluations of ∇H, and of B or what stands for it, that R takes."""

    def increment(
        self, e: Text, formula: Formula, y: Sequence[str], z: Sequence[str], step: Sequence[str]
    ) -> list[Expression]:
        """R(y, z; step)."""

    def equation(
        self, e: Text, formula: Formula, y: Sequence[str], z: Sequence[str], step: Sequence[str]
    ) -> tuple[list[Expression], Table]:
        """R of z = R(y, z; step) and K = ∂R/∂z."""

    def hamiltonian(self, e: Text, y: Sequence[str]) -> Expression:
        """H(y)."""

    def gradient(self, e: Text, y: Sequence[str]) -> list[Expression]:
        """∇H(y)."""

    def hessian(self, e: Text, y: Sequence[str]) -> Table:
        """H″(y)."""

    def structure(self, e: Text, y: Sequence[str]) -> Table:
        """B(y)."""

    def structure_derivative(self, e: Text, y: Sequence[str]) -> list[Table]:
        """∂B_ij/∂y_k at [k][i][j]."""

    def mean_gradient(self, e: Text, y: Sequence[str], z: Sequence[str]) -> list[Expression]:
        """∫₀¹∇H(y + τz)dτ, exact to rounding."""

    def domain(self, e: Text, y: Sequence[str]) -> str | None:
        """Whether y is in the domain; None for everywhere."""

    def casimirs(self, e: Text, y: Sequence[str]) -> list[Expression]:
        """The quadratic Casimirs, then the linear ones."""

    def casimir_gradients(self, e: Text, ends: Sequence[str]) -> Table:
        """Their gradients averaged along a segment, whose ends have the sum `ends`."""


def skew(d: int, upper: dict[tuple[int, int], Expression], e: Text) -> Table:
    """The skew table with the given entries above the diagonal."""
    table: Table = [[None] * d for _ in range(d)]
    for (i, j), value in upper.items():
        table[i][j], table[j][i] = value, e.product("(-1.0)", value)
    return table
