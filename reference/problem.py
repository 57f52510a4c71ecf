"""A problem description evaluated in arbitrary precision: H, ∇H, B and the averaged gradient.

Written from the description (polynomial data, or name and parameters) and from the paper's formulas,
not from the core's functions. Each evaluator owns its `MPContext`: no global precision is touched.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import mpmath

from sepv.errors import UsageError
from sepv.polynomial import Polynomial
from sepv.problem import NamedProblem, PolynomialSystem

Vector = list[Any]
Matrix = list[list[Any]]


@lru_cache(maxsize=8)
def context(digits: int) -> Any:
    """An `MPContext` of this many decimal digits, made once for each."""
    ctx = mpmath.mp.clone()
    ctx.dps = digits
    return ctx


class ExactProblem:
    """H, ∇H, H″, B and Casimirs of one description at `digits` digits. Vectors are lists of mpf."""

    def __init__(self, data: PolynomialSystem | NamedProblem, digits: int) -> None:
        self.ctx = context(digits)
        self.data = data
        if isinstance(data, PolynomialSystem):
            _polynomial(self, data)
        else:
            _NAMED[data.name](self, {k: [self.ctx.mpf(v) for v in values] for k, values in data.parameters})

    dimension: int
    noise: Vector
    casimirs: list[Matrix]
    linear_casimirs: list[Vector]
    hamiltonian: Callable[[Vector], Any]
    gradient: Callable[[Vector], Vector]
    structure: Callable[[Vector], Matrix]
    mean_gradient: Callable[[Vector, Vector], Vector]

    def state(self, y: Sequence[float]) -> Vector:
        """A binary64 state, exactly."""
        return [self.ctx.mpf(float(v)) for v in y]

    def random_step(self, h: float, dW: Sequence[float]) -> Any:
        """Δ = h + Σ c_j ΔW_j."""
        return self.ctx.mpf(float(h)) + self.ctx.fsum(
            c * float(w) for c, w in zip(self.noise, dW, strict=True)
        )

    def field(self, y: Vector) -> Vector:
        """f(y) = B(y)∇H(y)."""
        return self.apply(self.structure(y), self.gradient(y))

    def apply(self, A: Matrix, v: Vector) -> Vector:
        """A v."""
        return [self.ctx.fdot(row, v) for row in A]

    def casimir_values(self, y: Vector) -> Vector:
        """All quadratic Casimirs yᵀAy, then all linear ones bᵀy."""
        quadratic = [self.ctx.fdot(y, self.apply(A, y)) for A in self.casimirs]
        return quadratic + [self.ctx.fdot(b, y) for b in self.linear_casimirs]


@lru_cache(maxsize=512)
def exact_problem(data: PolynomialSystem | NamedProblem, digits: int = 50) -> ExactProblem:
    """The evaluator of a description, made once for each precision."""
    if isinstance(data, NamedProblem) and data.name not in _NAMED:
        raise UsageError(
            expected=f"a problem known to the references: polynomial data, or one of {', '.join(_NAMED)}",
            received=repr(data.name),
            remedy="describe the problem as polynomial data",
        )
    return ExactProblem(data, digits)


@lru_cache(maxsize=64)
def gauss_nodes(nodes: int, digits: int) -> list[tuple[Any, Any]]:
    """Gauss-Legendre nodes and weights on [0, 1]: Newton on P_n from Tricomi's first guess."""
    ctx = context(digits)
    found = []
    for i in range(nodes):
        x = ctx.cos(ctx.pi * (4 * i + 3) / (4 * nodes + 2))
        for _ in range(100):
            p, previous = x, ctx.one
            for k in range(1, nodes):
                p, previous = ((2 * k + 1) * x * p - k * previous) / (k + 1), p
            slope = nodes * (x * p - previous) / (x * x - 1)
            x, old = x - p / slope, x
            if abs(x - old) <= ctx.eps:
                break
        found.append(((1 + x) / 2, 1 / ((1 - x * x) * slope**2)))
    return found


def _polynomial(self: ExactProblem, data: PolynomialSystem) -> None:
    ctx, d = self.ctx, data.dimension
    terms = [(e, ctx.mpf(c)) for e, c in data.hamiltonian.terms]
    entries = [(i, j, _exact_terms(ctx, entry)) for i, j, entry in data.structure]
    partials = [
        [(tuple(k - (n == i) for n, k in enumerate(e)), c * e[i]) for e, c in terms if e[i]] for i in range(d)
    ]

    def value(monomials: list[tuple[tuple[int, ...], Any]], y: Vector) -> Any:
        total = ctx.zero
        for exponents, coefficient in monomials:
            term = coefficient
            for component, exponent in zip(y, exponents, strict=True):
                if exponent:
                    term = term * component**exponent
            total += term
        return total

    def structure(y: Vector) -> Matrix:
        B = [[ctx.zero] * d for _ in range(d)]
        for i, j, monomials in entries:
            B[i][j] = value(monomials, y)
            B[j][i] = -B[i][j]
        return B

    def gradient(y: Vector) -> Vector:
        return [value(p, y) for p in partials]

    nodes = gauss_nodes(max(1, -(-data.hamiltonian.degree // 2)), ctx.dps)

    def mean_gradient(y0: Vector, y1: Vector) -> Vector:
        slopes = [
            (weight, gradient([a + tau * (b - a) for a, b in zip(y0, y1, strict=True)]))
            for tau, weight in nodes
        ]
        return [ctx.fsum(weight * g[i] for weight, g in slopes) for i in range(d)]

    self.dimension, self.noise = d, [ctx.mpf(c) for c in data.noise]
    self.casimirs = [[[ctx.mpf(a) for a in row] for row in A] for A in data.casimirs]
    self.linear_casimirs = [[ctx.mpf(b) for b in v] for v in data.linear_casimirs]
    self.hamiltonian = lambda y: value(terms, y)
    self.gradient, self.structure, self.mean_gradient = gradient, structure, mean_gradient


def _exact_terms(ctx: Any, p: Polynomial) -> list[tuple[tuple[int, ...], Any]]:
    return [(e, ctx.mpf(c)) for e, c in p.terms]


def _oscillator(self: ExactProblem, parameters: dict[str, Vector]) -> None:
    """§4.1, y = (p, x)."""
    ctx = self.ctx
    _canonical(self, parameters)
    self.hamiltonian = lambda y: (y[0] ** 2 + y[1] ** 2) / 2
    self.gradient = lambda y: [y[0], y[1]]
    self.mean_gradient = lambda y0, y1: [(a + b) / ctx.mpf(2) for a, b in zip(y0, y1, strict=True)]


def _pendulum(self: ExactProblem, parameters: dict[str, Vector]) -> None:
    """§4.3, y = (p, q)."""
    ctx = self.ctx
    _canonical(self, parameters)
    self.hamiltonian = lambda y: y[0] ** 2 / 2 - ctx.cos(y[1])
    self.gradient = lambda y: [y[0], ctx.sin(y[1])]

    def mean_gradient(y0: Vector, y1: Vector) -> Vector:
        half = (y1[1] - y0[1]) / 2
        return [(y0[0] + y1[0]) / 2, ctx.sin(y0[1] + half) * ctx.sinc(half)]

    self.mean_gradient = mean_gradient


def _canonical(self: ExactProblem, parameters: dict[str, Vector]) -> None:
    """Equation (1.3)."""
    one, zero = self.ctx.one, self.ctx.zero
    self.dimension, self.noise, self.casimirs, self.linear_casimirs = 2, parameters["noise"], [], []
    self.structure = lambda _: [[zero, -one], [one, zero]]


def _rigid_body(self: ExactProblem, parameters: dict[str, Vector]) -> None:
    """§4.2."""
    ctx, inertia = self.ctx, parameters["inertia"]
    self.dimension, self.noise, self.linear_casimirs = 3, parameters["noise"], []
    self.casimirs = [[[ctx.mpf(int(i == j)) for j in range(3)] for i in range(3)]]
    self.hamiltonian = lambda y: ctx.fsum(v * v / moment for v, moment in zip(y, inertia, strict=True)) / 2
    self.gradient = lambda y: [v / moment for v, moment in zip(y, inertia, strict=True)]
    self.structure = lambda y: [[ctx.zero, -y[2], y[1]], [y[2], ctx.zero, -y[0]], [-y[1], y[0], ctx.zero]]
    self.mean_gradient = lambda y0, y1: self.gradient([(a + b) / 2 for a, b in zip(y0, y1, strict=True)])


def _lotka_volterra(self: ExactProblem, parameters: dict[str, Vector]) -> None:
    """§4.4."""
    ctx = self.ctx
    a, b, d, nu, mu = (parameters[k][0] for k in ("a", "b", "d", "nu", "mu"))
    self.dimension, self.noise, self.casimirs, self.linear_casimirs = 3, parameters["noise"], [], []
    self.hamiltonian = lambda y: a * b * y[0] + y[1] - a * y[2] + nu * ctx.ln(y[1]) - mu * ctx.ln(y[2])
    self.gradient = lambda y: [a * b, 1 + nu / y[1], -a - mu / y[2]]

    def structure(y: Vector) -> Matrix:
        p, q, r = d * y[0] * y[1], b * d * y[0] * y[2], -y[1] * y[2]
        return [[ctx.zero, p, q], [-p, ctx.zero, r], [-q, -r, ctx.zero]]

    def mean_reciprocal(x0: Any, x1: Any) -> Any:
        ratio = (x1 - x0) / x0
        return (ctx.log1p(ratio) / ratio if ratio else ctx.one) / x0

    self.structure = structure
    self.mean_gradient = lambda y0, y1: [
        a * b,
        1 + nu * mean_reciprocal(y0[1], y1[1]),
        -a - mu * mean_reciprocal(y0[2], y1[2]),
    ]


_NAMED: dict[str, Callable[[ExactProblem, dict[str, Vector]], None]] = {
    "harmonic-oscillator": _oscillator,
    "pendulum": _pendulum,
    "rigid-body": _rigid_body,
    "lotka-volterra": _lotka_volterra,
}
