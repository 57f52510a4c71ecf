"""A problem description evaluated in a chosen arithmetic: H, ∇H, B, the averaged gradient,
Casimirs.

The formulas are written from the description (polynomial data, or name and parameters) and from the
paper. They call none of the functions of `sepv.problem` and `sepv.problems`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

from sepv.reference.arithmetic import (
    BINARY64,
    Arithmetic,
    Matrix,
    Number,
    Rule,
    Vector,
    context,
    decimal,
    power,
    total,
)

from sepv.errors import UsageError
from sepv.problem import GivenProblem, NamedProblem, PolynomialSystem
from sepv.record import Exponents, Polynomial

Description = PolynomialSystem | NamedProblem
# Entries (i, j, B_ij) of B with i < j; zeros are left out, and B_ji = −B_ij.
Skew = list[tuple[int, int, Number]]
Monomials = list[tuple[Number, list[tuple[int, int]]]]


class ExactProblem:
    """One problem in one arithmetic: H, ∇H, B and Casimirs.
    Vectors are lists of numbers of the arithmetic.
    """

    def __init__(self, data: Description, arithmetic: Arithmetic) -> None:
        self.data, self.arithmetic = data, arithmetic
        self.number = arithmetic.number
        if isinstance(data, PolynomialSystem):
            _polynomial(self, data)
        else:
            _NAMED[data.name](self, {k: [self.number(v) for v in values] for k, values in data.parameters})

    ctx: Any = None
    dimension: int
    degree: int | None = None
    noise: Vector
    casimirs: list[Matrix]
    linear_casimirs: list[Vector]
    hamiltonian: Callable[[Vector], Number]
    gradient: Callable[[Vector], Vector]
    structure: Callable[[Vector], Skew]
    mean_gradient: Callable[[Vector, Vector], Vector]
    # Casimirs given as polynomials, in their order.
    polynomial_casimirs: Callable[[Vector], Vector] = staticmethod(lambda _: [])
    # The functions g and C and the average of ∇C if B(y)v = g(y)(v × ∇C(y)) in dimension 3, else
    # None.
    factor: Callable[[Vector], Number] | None = None
    casimir: Callable[[Vector], Number] | None = None
    mean_casimir_gradient: Callable[[Vector, Vector], Vector] | None = None
    # True for states in the domain of H and B.
    inside: Callable[[Vector], bool] = staticmethod(lambda _: True)
    # Structures of several noises, [c_1 G_1, …, c_m G_m](y); several Hamiltonians are written as
    # structures.
    noise_structures: Callable[[Vector], list[Skew]] | None = None

    def state(self, y: Sequence[float]) -> Vector:
        """The binary64 state y in the numbers of the arithmetic, without a rounding."""
        return [self.number(v) for v in y]

    def field(self, y: Vector) -> Vector:
        """The field f(y) = B(y)∇H(y)."""
        return self.turned(self.structure(y), self.gradient(y))

    def turned(self, B: Skew, v: Vector) -> Vector:
        """The product B v of a skew matrix B, given by its entries above the diagonal,
        and a vector v.
        """
        rows: Vector = [None] * len(v)
        for i, j, entry in B:
            up, down = entry * v[j], entry * v[i]
            rows[i] = up if rows[i] is None else rows[i] + up
            rows[j] = -down if rows[j] is None else rows[j] - down
        return [0 * w if row is None else row for row, w in zip(rows, v, strict=True)]

    def field_slope(self, y: Vector, v: Vector) -> Vector:
        """The directional derivative f′(y)v of the field f, as the ε-part of f(y + εv)."""
        nudged = [self.arithmetic.nudged(a, b) for a, b in zip(y, v, strict=True)]
        return [self.arithmetic.slope(w) for w in self.field(nudged)]

    def mean_gradient_by(self, rule: Rule, y0: Vector, y1: Vector) -> Vector:
        """The averaged gradient ∫₀¹∇H(y0 + τ(y1 − y0))dτ by quadrature."""
        slopes = [
            (weight, self.gradient([a + node * (b - a) for a, b in zip(y0, y1, strict=True)]))
            for node, weight in rule
        ]
        return [total(weight * g[i] for weight, g in slopes) for i in range(self.dimension)]

    def uncertainty(self, *_states: Any) -> float:
        """Zero, the error of H(y1) − H(y0) as evaluated here,
        which laws add to their bounds of rounding.
        """
        return 0.0

    def casimir_values(self, y: Vector) -> Vector:
        """All quadratic Casimirs yᵀAy, then all linear ones bᵀy."""
        quadratic = [
            total(a * y[i] * y[j] for i, row in enumerate(A) for j, a in enumerate(row))
            for A in self.casimirs
        ]
        return quadratic + [total(b * v for b, v in zip(row, y, strict=True)) for row in self.linear_casimirs]


@lru_cache(maxsize=512)
def exact_problem(data: Description | GivenProblem, digits: int = 50) -> Any:
    """The `ExactProblem` of a description in mpmath, made once for each precision;
    `ctx` is its mpmath context.

    Raises
    ------
    UsageError
        If the references do not know the problem's name.
    """
    if isinstance(data, GivenProblem):
        from sepv.reference.given_functions import GivenFunctions

        return GivenFunctions(data, digits)
    problem = in_arithmetic(data, decimal(digits))
    problem.ctx = context(digits)
    return problem


@lru_cache(maxsize=512)
def binary64_problem(data: Description) -> ExactProblem:
    """The `ExactProblem` of a description in Python's floats."""
    return in_arithmetic(data, BINARY64)


def in_arithmetic(data: Description, arithmetic: Arithmetic) -> ExactProblem:
    """The `ExactProblem` of a description in this arithmetic."""
    if isinstance(data, NamedProblem) and data.name not in _NAMED:
        raise UsageError(
            expected=f"a problem known to the references: polynomial data, or one of {', '.join(_NAMED)}",
            received=repr(data.name),
            remedy="describe the problem as polynomial data",
        )
    return ExactProblem(data, arithmetic)


def _polynomial(self: ExactProblem, data: PolynomialSystem) -> None:
    number, d = self.number, data.dimension
    zero = number(0.0)
    terms = _monomials(self, data.hamiltonian.terms)
    entries = [(i, j, _monomials(self, entry.terms)) for i, j, entry in data.structure]
    partials = [_partial(terms, i) for i in range(d)]
    rule = self.arithmetic.gauss(max(1, -(-data.hamiltonian.degree // 2)))

    def gradient(y: Vector) -> Vector:
        return _values(partials, y, zero)

    self.dimension, self.degree = d, data.hamiltonian.degree
    self.noise = [number(c) for c in data.noise]
    self.casimirs = [[[number(a) for a in row] for row in A] for A in data.casimirs]
    self.linear_casimirs = [[number(b) for b in v] for v in data.linear_casimirs]
    self.hamiltonian = lambda y: _value(terms, y, zero)
    places, parts = [(i, j) for i, j, _ in entries], [p for *_, p in entries]
    self.structure = lambda y: [(*at, v) for at, v in zip(places, _values(parts, y, zero), strict=True)]
    self.gradient = gradient
    self.mean_gradient = lambda y0, y1: self.mean_gradient_by(rule, y0, y1)
    others = [_monomials(self, C.terms) for C in data.polynomial_casimirs]
    self.polynomial_casimirs = lambda y: _values(others, y, zero)
    if data.nambu is not None:
        _nambu(self, *data.nambu)
    if data.noise_structures:
        tables = [[(i, j, _monomials(self, e.terms)) for i, j, e in G] for G in data.noise_structures]
        self.noise_structures = lambda y: [
            [(i, j, c * _value(p, y, zero)) for i, j, p in G] for c, G in zip(self.noise, tables, strict=True)
        ]
    if data.noise_hamiltonians:
        slopes = [[_partial(_monomials(self, H.terms), i) for i in range(d)] for H in data.noise_hamiltonians]
        self.noise_structures = lambda y: [
            _commuting_structure(self, y, c, [_value(p, y, zero) for p in slope])
            for c, slope in zip(self.noise, slopes, strict=True)
        ]


def _commuting_structure(self: ExactProblem, y: Vector, c: Number, slope: Vector) -> Skew:
    """The matrix c (v wᵀ − w vᵀ)/|w|², v = B∇H_j, w = ∇H_0 less its parts along Casimirs'
    gradients; 0 if v = w = 0.

    Raises
    ------
    ArithmeticError
        If w = 0 but v ≠ 0, because there is no such matrix.
    """
    v, w = self.turned(self.structure(y), slope), self.gradient(y)
    normals = [[2 * total(a * b for a, b in zip(row, y, strict=True)) for row in A] for A in self.casimirs]
    rows: list[Vector] = []
    for normal in [*normals, *self.linear_casimirs]:
        n = _without(normal, rows)
        if total(a * a for a in n):
            rows.append(n)
    w = _without(w, rows)
    square = total(a * a for a in w)
    if not square:
        if any(v):
            raise ArithmeticError("a structure is undefined: ∇H_0 = 0 where B∇H_j is not")
        return []
    return [
        (i, j, c * (v[i] * w[j] - w[i] * v[j]) / square) for i in range(len(y)) for j in range(i + 1, len(y))
    ]


def _without(v: Vector, orthogonal: list[Vector]) -> Vector:
    """Remove from v its parts along the vectors `orthogonal`, which are orthogonal to each
    other.
    """
    for n in orthogonal:
        share = total(a * b for a, b in zip(v, n, strict=True)) / total(a * a for a in n)
        v = [a - share * b for a, b in zip(v, n, strict=True)]
    return v


def _nambu(self: ExactProblem, factor: Polynomial, casimir: Polynomial) -> None:
    zero = self.number(0.0)
    g, C = _monomials(self, factor.terms), _monomials(self, casimir.terms)
    partials = [_partial(C, i) for i in range(3)]
    rule = self.arithmetic.gauss(max(1, -(-casimir.degree // 2)))

    def mean(y0: Vector, y1: Vector) -> Vector:
        points = [(w, [a + x * (b - a) for a, b in zip(y0, y1, strict=True)]) for x, w in rule]
        return [total(w * _value(p, at, zero) for w, at in points) for p in partials]

    self.factor, self.casimir = lambda y: _value(g, y, zero), lambda y: _value(C, y, zero)
    self.mean_casimir_gradient = mean


def _monomials(self: ExactProblem, terms: tuple[tuple[Exponents, float], ...]) -> Monomials:
    """The terms of a polynomial, each as its coefficient and [(index, exponent), …] of its
    variables.
    """
    return [(self.number(c), [(i, k) for i, k in enumerate(e) if k]) for e, c in terms]


def _partial(terms: Monomials, i: int) -> Monomials:
    """The terms of the derivative ∂p/∂y_i of a polynomial p."""
    derivative = []
    for c, powers in terms:
        k = dict(powers).get(i, 0)
        if k:
            derivative.append((c * k, [(n, e - (n == i)) for n, e in powers if e > (n == i)]))
    return derivative


def _value(terms: Monomials, y: Vector, zero: Number) -> Number:
    return _values([terms], y, zero)[0]


def _values(rows: Sequence[Monomials], y: Vector, zero: Number) -> Vector:
    """Values of several polynomials at one point; each power y_i^k is computed once for all of
    them.
    """
    known: dict[tuple[int, int], Number] = {}
    values = []
    for terms in rows:
        result = zero
        for c, powers in terms:
            term = c
            for factor in powers:
                value = known.get(factor)
                if value is None:
                    value = known[factor] = power(y[factor[0]], factor[1])
                term = term * value
            result = result + term
        values.append(result)
    return values


def _oscillator(self: ExactProblem, parameters: dict[str, Vector]) -> None:
    """Define the oscillator of §4.1, y = (p, x)."""
    _canonical(self, parameters)
    half, self.degree = self.number(0.5), 2
    self.hamiltonian = lambda y: half * (y[0] * y[0] + y[1] * y[1])
    self.gradient = lambda y: [y[0], y[1]]
    self.mean_gradient = lambda y0, y1: [half * (a + b) for a, b in zip(y0, y1, strict=True)]


def _pendulum(self: ExactProblem, parameters: dict[str, Vector]) -> None:
    """Define the pendulum of §4.3, y = (p, q)."""
    _canonical(self, parameters)
    half, sin, cos, sinc = self.number(0.5), self.arithmetic.sin, self.arithmetic.cos, self.arithmetic.sinc
    self.hamiltonian = lambda y: half * y[0] * y[0] - cos(y[1])
    self.gradient = lambda y: [y[0], sin(y[1])]

    def mean_gradient(y0: Vector, y1: Vector) -> Vector:
        """The averaged gradient of the pendulum, by ∫₀¹sin(q0 + τδ)dτ = sin(q0 + δ/2)
        sin(δ/2)/(δ/2), δ = q1 − q0.
        """
        turn = half * (y1[1] - y0[1])
        return [half * (y0[0] + y1[0]), sin(y0[1] + turn) * sinc(turn)]

    self.mean_gradient = mean_gradient


def _canonical(self: ExactProblem, parameters: dict[str, Vector]) -> None:
    """Define the canonical structure, equation (1.3)."""
    entry = self.number(-1.0)
    self.dimension, self.noise, self.casimirs, self.linear_casimirs = 2, parameters["noise"], [], []
    self.structure = lambda _: [(0, 1, entry)]


def _rigid_body(self: ExactProblem, parameters: dict[str, Vector]) -> None:
    """Define the rigid body of §4.2."""
    I1, I2, I3 = parameters["inertia"]
    half, one, zero = (self.number(v) for v in (0.5, 1.0, 0.0))
    self.dimension, self.degree, self.noise, self.linear_casimirs = 3, 2, parameters["noise"], []
    self.casimirs = [[[one if i == j else zero for j in range(3)] for i in range(3)]]
    self.hamiltonian = lambda y: half * (y[0] * y[0] / I1 + y[1] * y[1] / I2 + y[2] * y[2] / I3)
    self.gradient = lambda y: [y[0] / I1, y[1] / I2, y[2] / I3]
    self.structure = lambda y: [(0, 1, -y[2]), (0, 2, y[1]), (1, 2, -y[0])]
    twice = [2 * I1, 2 * I2, 2 * I3]
    self.mean_gradient = lambda y0, y1: [(a + b) / I for a, b, I in zip(y0, y1, twice, strict=True)]
    # B = hat(y) and hat(y)v = −(v × y), so that g = −1 and C = ½|y|².
    self.factor = lambda y: 0 * y[0] - 1
    self.casimir = lambda y: half * (y[0] * y[0] + y[1] * y[1] + y[2] * y[2])
    self.mean_casimir_gradient = lambda y0, y1: [half * (a + b) for a, b in zip(y0, y1, strict=True)]


def _lotka_volterra(self: ExactProblem, parameters: dict[str, Vector]) -> None:
    """Define the Lotka-Volterra system of §4.4."""
    a, b, d, nu, mu = (parameters[k][0] for k in ("a", "b", "d", "nu", "mu"))
    log, log1p_ratio = self.arithmetic.log, self.arithmetic.log1p_ratio
    self.inside = lambda y: all(v > 0 for v in y)
    self.dimension, self.noise, self.casimirs, self.linear_casimirs = 3, parameters["noise"], [], []
    self.hamiltonian = lambda y: a * b * y[0] + y[1] - a * y[2] + nu * log(y[1]) - mu * log(y[2])
    # The term 0·y1 makes the constant a number of the same kind as the others.
    self.gradient = lambda y: [a * b + 0 * y[0], 1 + nu / y[1], -a - mu / y[2]]
    self.structure = lambda y: [(0, 1, d * y[0] * y[1]), (0, 2, b * d * y[0] * y[2]), (1, 2, -y[1] * y[2])]

    def mean_reciprocal(x0: Number, x1: Number) -> Number:
        """The mean of 1/x from x0 to x1: ∫₀¹dτ/(x0 + τ(x1 − x0)) = log(1 + r)/(r x0)
        with r = (x1 − x0)/x0.
        """
        return log1p_ratio((x1 - x0) / x0) / x0

    self.mean_gradient = lambda y0, y1: [
        a * b,
        1 + nu * mean_reciprocal(y0[1], y1[1]),
        -a - mu * mean_reciprocal(y0[2], y1[2]),
    ]
    self.factor = lambda y: -y[0] * y[1] * y[2]
    self.casimir = lambda y: log(y[0]) + b * d * log(y[1]) - d * log(y[2])
    self.mean_casimir_gradient = lambda y0, y1: [
        k * mean_reciprocal(u, v) for k, u, v in zip((1, b * d, -d), y0, y1, strict=True)
    ]


_NAMED: dict[str, Callable[[ExactProblem, dict[str, Vector]], None]] = {
    "harmonic-oscillator": _oscillator,
    "pendulum": _pendulum,
    "rigid-body": _rigid_body,
    "lotka-volterra": _lotka_volterra,
}
