"""The code of a polynomial problem, given as data."""

from __future__ import annotations

from collections.abc import Sequence

from sepv import polynomial as poly
from sepv.average import gauss_legendre
from sepv.engine.code import Table, quadratic_form
from sepv.engine.text import Expression, Text
from sepv.problem import PolynomialSystem
from sepv.problems.polynomial_system import structure_entries


class PolynomialCode:
    """Code for H, ∇H, H″, B, B′ and the averaged gradient, exact by ⌈ν/2⌉ Gauss nodes."""

    preamble = ""

    def __init__(self, data: PolynomialSystem) -> None:
        self.data = data
        self.dimension = data.dimension
        self.entries = structure_entries(data)
        self.slope = poly.gradient(data.hamiltonian)
        self.nodes = max(1, -(-data.hamiltonian.degree // 2))
        self.gradient_evaluations = self.nodes
        self.degree = max(data.hamiltonian.degree, 1)

    def hamiltonian(self, e: Text, y: Sequence[str]) -> Expression:
        """H(y)."""
        return e.polynomial(self.data.hamiltonian, y)

    def gradient(self, e: Text, y: Sequence[str]) -> list[Expression]:
        """∇H(y)."""
        return [e.polynomial(g, y) for g in self.slope]

    def hessian(self, e: Text, y: Sequence[str]) -> Table:
        """H″(y)."""
        d = self.dimension
        upper = {
            (i, k): e.polynomial(poly.differentiate(self.slope[i], k), y)
            for i in range(d)
            for k in range(i, d)
        }
        return [[upper[min(i, k), max(i, k)] for k in range(d)] for i in range(d)]

    def structure(self, e: Text, y: Sequence[str]) -> Table:
        """B(y)."""
        return [[e.polynomial(entry, y) for entry in row] for row in self.entries]

    def structure_derivative(self, e: Text, y: Sequence[str]) -> list[Table]:
        """∂B_ij/∂y_k at [k][i][j]."""
        return [
            [[e.polynomial(poly.differentiate(entry, k), y) for entry in row] for row in self.entries]
            for k in range(self.dimension)
        ]

    def mean_gradient(self, e: Text, y: Sequence[str], z: Sequence[str]) -> list[Expression]:
        """∫₀¹∇H(y + τz)dτ."""
        points, weights = gauss_legendre(self.nodes)
        sums: list[Expression] = [None] * self.dimension
        for tau, weight in zip(points, weights, strict=True):
            for i, g in enumerate(self.gradient(e, self._along(e, y, z, float(tau)))):
                sums[i] = e.plus(g, e.number(float(weight)), sums[i])
        return sums

    def mean_hessian(self, e: Text, y: Sequence[str], z: Sequence[str]) -> Table:
        """∫₀¹τH″(y + τz)dτ, the derivative of the mean gradient by z."""
        d = self.dimension
        points, weights = gauss_legendre(self.nodes)
        sums: Table = [[None] * d for _ in range(d)]
        for tau, weight in zip(points, weights, strict=True):
            table = self.hessian(e, self._along(e, y, z, float(tau)))
            factor = e.number(float(weight * tau))
            for i in range(d):
                for k in range(d):
                    sums[i][k] = e.plus(table[i][k], factor, sums[i][k])
        return sums

    def _along(self, e: Text, y: Sequence[str], z: Sequence[str], tau: float) -> list[str]:
        return [a if b == "0.0" else str(e.plus(e.number(tau), b, a)) for a, b in zip(y, z, strict=True)]

    def domain(self, e: Text, y: Sequence[str]) -> str | None:  # noqa: ARG002 - everywhere
        """Polynomials are defined everywhere."""
        return None

    def casimirs(self, e: Text, y: Sequence[str]) -> list[Expression]:
        """yᵀAy and bᵀy."""
        quadratic = [quadratic_form(e, A, y) for A in self.data.casimirs]
        return quadratic + [e.dot([e.number(v) for v in b], y) for b in self.data.linear_casimirs]
