"""Gauss nodes as a Runge-Kutta table: the Lagrange basis on the nodes, and its integrals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from sepv.reference.arithmetic import Arithmetic, Number, Vector, total


@dataclass(frozen=True)
class StageTable:
    """The s Gauss nodes on [0, 1] with their Lagrange basis ℓ_1, …, ℓ_s.

    Attributes
    ----------
    c, b : nodes, weights b_j = ∫₀¹ℓ_j
    a : rows
        a_ij = ∫₀^{c_i} ℓ_j.
    coefficients : rows
        ℓ_j as a polynomial, lowest power first.
    """

    c: Vector
    b: Vector
    a: list[Vector]
    coefficients: list[Vector]

    def basis(self, tau: Number) -> Vector:
        """The values ℓ_1(τ), …, ℓ_s(τ) of the Lagrange basis."""
        return [horner(row, tau) for row in self.coefficients]

    def integrals(self, tau: Number) -> Vector:
        """The integrals ∫₀^τ ℓ_1, …, ∫₀^τ ℓ_s of the Lagrange basis."""
        return [tau * horner([p / (k + 1) for k, p in enumerate(row)], tau) for row in self.coefficients]


@lru_cache(maxsize=64)
def stage_table(stages: int, arithmetic: Arithmetic) -> StageTable:
    """The table of Gauss nodes and Lagrange basis for this number of stages,
    in the numbers of this arithmetic.
    """
    if arithmetic.tables:
        maker, convert = arithmetic.tables
        made = stage_table(stages, maker)
        rows = [[convert(v) for v in row] for row in (made.c, made.b, *made.a, *made.coefficients)]
        return StageTable(rows[0], rows[1], rows[2 : stages + 2], rows[stages + 2 :])
    c, one = [node for node, _ in arithmetic.gauss(stages)], arithmetic.number(1.0)
    coefficients = []
    for j in range(stages):
        row = [one]
        for k in range(stages):
            if k != j:
                # times (τ − c_k)/(c_j − c_k)
                lower, upper = [-c[k] * p for p in row], row
                row = [
                    total(
                        part[n - shift]
                        for shift, part in ((0, lower), (1, upper))
                        if 0 <= n - shift < len(part)
                    )
                    / (c[j] - c[k])
                    for n in range(len(row) + 1)
                ]
        coefficients.append(row)
    table = StageTable(c, [], [], coefficients)
    return StageTable(c, table.integrals(one), [table.integrals(node) for node in c], coefficients)


def horner(row: Vector, tau: Number) -> Number:
    """The value Σ_k row_k τ^k of a polynomial at τ, by Horner's rule."""
    value = row[-1]
    for coefficient in reversed(row[:-1]):
        value = value * tau + coefficient
    return value


@lru_cache(maxsize=64)
def weighted_rule(stages: int, nodes: int, arithmetic: Arithmetic) -> list[tuple[Vector, Vector]]:
    """The quadrature of ∫₀¹(ℓ_i/b_i)g: for each node τ of weight w,
    all numbers w ℓ_i(τ)/b_i and integrals ∫₀^τ ℓ_j.
    """
    if arithmetic.tables:
        maker, convert = arithmetic.tables
        return [
            ([convert(v) for v in weights], [convert(v) for v in integrals])
            for weights, integrals in weighted_rule(stages, nodes, maker)
        ]
    table = stage_table(stages, arithmetic)
    return [
        (
            [weight * basis / b for basis, b in zip(table.basis(node), table.b, strict=True)],
            table.integrals(node),
        )
        for node, weight in arithmetic.gauss(nodes)
    ]
