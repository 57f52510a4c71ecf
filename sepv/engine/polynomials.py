"""The code of a polynomial problem, given as data."""

from __future__ import annotations

from collections.abc import Sequence

from sepv import polynomial as poly
from sepv.engine.code import Table, casimir_gradients, quadratic_form
from sepv.engine.text import Expression, Text
from sepv.errors import UsageError
from sepv.polynomial import Polynomial
from sepv.problem import PolynomialSystem
from sepv.problems.polynomial_system import structure_entries
from sepv.quadrature import gauss_legendre


class PolynomialCode:
    """Code for H, ∇H, H″, B, B′ and the averaged gradient, exact by ⌈ν/2⌉ Gauss nodes."""

    preamble = ""
    rate = 2.0**-40  # exact derivatives, to rounding

    def __init__(self, data: PolynomialSystem) -> None:
        self.data = data
        self.dimension = data.dimension
        self.entries = structure_entries(data)
        self.slope = poly.gradient(data.hamiltonian)
        self.nodes = max(1, -(-data.hamiltonian.degree // 2))
        self.gradient_evaluations = self.nodes
        self.degree = max(data.hamiltonian.degree, 1)
        self.nambu = None if data.nambu is None else PolynomialNambu(*data.nambu)
        self.field = multiplied_out(self.entries, self.slope) if self.degree <= 2 else None

    def hamiltonian(self, e: Text, y: Sequence[str]) -> Expression:
        """H(y)."""
        return e.polynomial(self.data.hamiltonian, y)

    def gradient(self, e: Text, y: Sequence[str]) -> list[Expression]:
        """∇H(y)."""
        return [e.polynomial(g, y) for g in self.slope]

    def hessian(self, e: Text, y: Sequence[str]) -> Table:
        """H″(y)."""
        return hessian(e, self.slope, y)

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
        return mean_gradient(e, self.slope, self.nodes, y, z)

    def mean_hessian(self, e: Text, y: Sequence[str], z: Sequence[str]) -> Table:
        """∫₀¹τH″(y + τz)dτ, the derivative of the mean gradient by z."""
        return mean_hessian(e, self.slope, self.nodes, y, z)

    def domain(self, e: Text, y: Sequence[str]) -> str | None:  # noqa: ARG002 - everywhere
        """Polynomials are defined everywhere."""
        return None

    def casimirs(self, e: Text, y: Sequence[str]) -> list[Expression]:
        """yᵀAy and bᵀy."""
        quadratic = [quadratic_form(e, A, y) for A in self.data.casimirs]
        return quadratic + [e.dot([e.number(v) for v in b], y) for b in self.data.linear_casimirs]

    def casimir_gradients(self, e: Text, ends: Sequence[str]) -> Table:
        """A(y0 + y1), and b."""
        return casimir_gradients(e, self.data.casimirs, self.data.linear_casimirs, ends)


def multiplied_out(
    structure: Sequence[Sequence[Polynomial]], gradient: Sequence[Polynomial]
) -> list[Polynomial] | None:
    """B∇H as polynomials; None where a coefficient overflows."""
    try:
        return [
            poly.add(*(poly.multiply(b, g) for b, g in zip(row, gradient, strict=True))) for row in structure
        ]
    except UsageError:
        return None


class PolynomialNambu:
    """Code for polynomials g and C."""

    def __init__(self, factor: Polynomial, casimir: Polynomial) -> None:
        self.g, self.slope = factor, poly.gradient(casimir)
        self.nodes = max(1, -(-casimir.degree // 2))

    def factor(self, e: Text, y: Sequence[str]) -> Expression:
        """g(y)."""
        return e.polynomial(self.g, y)

    def factor_gradient(self, e: Text, y: Sequence[str]) -> list[Expression]:
        """∇g(y)."""
        return [e.polynomial(p, y) for p in poly.gradient(self.g)]

    def mean_gradient(self, e: Text, y: Sequence[str], z: Sequence[str]) -> list[Expression]:
        """∫₀¹∇C(y + τz)dτ."""
        return mean_gradient(e, self.slope, self.nodes, y, z)

    def mean_hessian(self, e: Text, y: Sequence[str], z: Sequence[str]) -> Table:
        """∫₀¹τC″(y + τz)dτ."""
        return mean_hessian(e, self.slope, self.nodes, y, z)


def hessian(e: Text, slope: Sequence[Polynomial], y: Sequence[str]) -> Table:
    """The symmetric table of the derivatives of a gradient."""
    d = len(slope)
    upper = {(i, k): e.polynomial(poly.differentiate(slope[i], k), y) for i in range(d) for k in range(i, d)}
    return [[upper[min(i, k), max(i, k)] for k in range(d)] for i in range(d)]


def mean_gradient(
    e: Text, slope: Sequence[Polynomial], nodes: int, y: Sequence[str], z: Sequence[str]
) -> list[Expression]:
    """The average of a gradient along y + τz, by a Gauss rule that is exact for it."""
    points, weights = gauss_legendre(nodes)
    sums: list[Expression] = [None] * len(slope)
    for tau, weight in zip(points, weights, strict=True):
        state = _along(e, y, z, float(tau))
        for i, p in enumerate(slope):
            sums[i] = e.plus(e.polynomial(p, state), e.number(float(weight)), sums[i])
    return sums


def mean_hessian(
    e: Text, slope: Sequence[Polynomial], nodes: int, y: Sequence[str], z: Sequence[str]
) -> Table:
    """Its derivative by z."""
    d = len(slope)
    points, weights = gauss_legendre(nodes)
    sums: Table = [[None] * d for _ in range(d)]
    for tau, weight in zip(points, weights, strict=True):
        table = hessian(e, slope, _along(e, y, z, float(tau)))
        factor = e.number(float(weight * tau))
        for i in range(d):
            for k in range(d):
                sums[i][k] = e.plus(table[i][k], factor, sums[i][k])
    return sums


def _along(e: Text, y: Sequence[str], z: Sequence[str], tau: float) -> list[str]:
    return [a if b == "0.0" else str(e.plus(e.number(tau), b, a)) for a, b in zip(y, z, strict=True)]
