"""Kinds of numbers in which a formula can be evaluated,
each with the functions that problems and schemes need.

A formula is written once, with + − × ÷ and integer powers, and evaluated in binary64, in decimal
digits (mpmath), in balls (`sepv.reference.balls`) or as a power series (`sepv.reference.series`).
No derivative is written out: a number may carry an infinitesimal part ε with ε² = 0, and the ε-part
of R(x + εv) is R′(x)v. In binary64 and in mpmath ε is the imaginary unit times a number so small
that its square is lost in any sum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from operator import mul
from typing import Any

import mpmath

Number = Any
Vector = list[Number]
Matrix = list[Vector]
Function = Callable[[Number], Number]
Rule = Sequence[tuple[Number, Number]]


@dataclass(frozen=True)
class Arithmetic:
    """The arithmetic of one kind of numbers: how to make them,
    and the functions that the problems use.

    Attributes
    ----------
    number : float -> number
        Converts a binary64 number without a rounding.
    sinc, log1p_ratio : number -> number
        sin(x)/x and log(1 + x)/x, both 1 at 0.
    gauss : n -> [(node, weight), …]
        The Gauss-Legendre quadrature rule with n nodes on [0, 1].
    nudged : (value, slope) -> number
        The number value + ε slope.
    slope : number -> number
        The ε-part of a number.
    dot : (numbers, numbers) -> number
        The scalar product Σ a_i b_i, by the library's own function if it has a faster one.
    tables : (arithmetic, convert), optional
        A more precise arithmetic that computes the tables of methods with stages, and a function
        that converts an entry. So the tables have no rounding errors of this arithmetic.
    """

    number: Callable[[float], Number]
    sin: Function
    cos: Function
    log: Function
    sinc: Function
    log1p_ratio: Function
    gauss: Callable[[int], Rule]
    nudged: Callable[[Number, Number], Number]
    slope: Function
    dot: Callable[[Iterable[Number], Iterable[Number]], Number] = lambda a, b: total(map(mul, a, b))
    tables: tuple[Arithmetic, Function] | None = None


def total(terms: Iterable[Number]) -> Number:
    """Sum one or more numbers in their order, without a starting zero,
    which would be a number of another kind.

    The built-in `sum` would not do: from Python 3.12 on it compensates the roundings of floats,
    which changes digits.
    """
    iterator = iter(terms)
    result = next(iterator)
    for term in iterator:
        result = result + term
    return result


def power(x: Number, k: int) -> Number:
    """The power x^k, k ≥ 1, by products alone: mpmath's own powers of complex numbers lose a small
    imaginary part.
    """
    if k == 1:
        return x
    root = power(x, k // 2)
    return root * root * x if k % 2 else root * root


@lru_cache(maxsize=8)
def context(digits: int) -> Any:
    """An mpmath context of `digits` decimal digits, made once for each value;
    the global precision is unchanged.
    """
    ctx = mpmath.mp.clone()
    ctx.dps = digits
    return ctx


@lru_cache(maxsize=64)
def gauss_nodes(nodes: int, digits: int) -> list[tuple[Number, Number]]:
    """Gauss-Legendre nodes and weights on [0, 1], ascending,
    by Newton's method on P_n from Tricomi's first guess.
    """
    ctx = context(digits + 10)
    roots = []
    for i in range(nodes):
        x = ctx.cos(ctx.pi * (4 * i + 3) / (4 * nodes + 2))
        for _ in range(100):
            p, previous = x, ctx.one
            for k in range(1, nodes):
                p, previous = ((2 * k + 1) * x * p - k * previous) / (k + 1), p
            slope = nodes * (x * p - previous) / (x * x - 1)
            x, old = x - p / slope, x
            if abs(x - old) <= 10 * ctx.eps:
                break
        roots.append(((1 + x) / 2, 1 / ((1 - x * x) * slope**2)))
    exact = context(digits)
    return [(exact.mpf(node), exact.mpf(weight)) for node, weight in reversed(roots)]


@lru_cache(maxsize=64)
def _float_nodes(nodes: int) -> list[tuple[float, float]]:
    return [(float(node), float(weight)) for node, weight in gauss_nodes(nodes, 30)]


@lru_cache(maxsize=8)
def decimal(digits: int) -> Arithmetic:
    """The arithmetic of mpmath with this many digits; ε is 10^−1000 i,
    which mpmath's unbounded exponents allow.
    """
    ctx = context(digits)
    epsilon = ctx.mpf(10) ** -1000

    def lifted(f: Function, derivative: Function) -> Function:
        return _lifted(lambda x: f(ctx.mpf(x)), derivative, ctx.mpc)

    def log(x: Number) -> Number:
        return ctx.ln(_positive(x))

    def log1p_ratio(x: Number) -> Number:
        _positive(1 + x)
        return ctx.log1p(x) / x if x else ctx.one

    return Arithmetic(
        number=lambda x: ctx.mpf(float(x)),
        sin=lifted(ctx.sin, ctx.cos),
        cos=lifted(ctx.cos, lambda x: -ctx.sin(x)),
        log=lifted(log, lambda x: 1 / x),
        sinc=lifted(ctx.sinc, lambda x: sinc_slope(x, ctx.cos(x), ctx.sinc(x))),
        log1p_ratio=lifted(log1p_ratio, lambda x: log1p_ratio_slope(x, log1p_ratio(x))),
        gauss=lambda n: gauss_nodes(n, digits),
        nudged=lambda value, slope: ctx.mpc(value, epsilon * slope),
        slope=lambda x: x.imag / epsilon if isinstance(x, ctx.mpc) else ctx.zero,
        dot=ctx.fdot,
    )


# ε in binary64: its square is lost in any sum, and its product with a state down to 1e-180 does not
# underflow.
_EPSILON = 2.0**-400


def _lifted(f: Function, derivative: Function, kind: type[Any] = complex) -> Function:
    """The function f of numbers, also of those with an ε-part, which are of the type `kind`."""

    def of(x: Number) -> Number:
        return kind(f(x.real), derivative(x.real) * x.imag) if isinstance(x, kind) else f(x)

    return of


def _log1p_ratio(x: float) -> float:
    return math.log1p(x) / x if x else 1.0


def _sinc(x: float) -> float:
    return math.sin(x) / x if x else 1.0


BINARY64 = Arithmetic(
    number=float,
    sin=_lifted(math.sin, math.cos),
    cos=_lifted(math.cos, lambda x: -math.sin(x)),
    log=_lifted(math.log, lambda x: 1 / x),
    sinc=_lifted(_sinc, lambda x: sinc_slope(x, math.cos(x), _sinc(x))),
    log1p_ratio=_lifted(_log1p_ratio, lambda x: log1p_ratio_slope(x, _log1p_ratio(x))),
    gauss=_float_nodes,
    nudged=lambda value, slope: complex(value, _EPSILON * slope),
    slope=lambda x: x.imag / _EPSILON if isinstance(x, complex) else 0.0,
    tables=(decimal(30), float),
)
"""The arithmetic of floats, for first guesses and Jacobians only.

Its functions raise ArithmeticError or ValueError.
"""


def sinc_slope(x: Number, cos: Number, sinc: Number) -> Number:
    """The derivative sinc′(x) = (cos x − sinc x)/x; for |x| < 1e-3 its series, to 1e-10,
    enough for Jacobians.
    """
    return -x / 3 * (1 - x * x / 10) if abs(x) < 1e-3 else (cos - sinc) / x


def log1p_ratio_slope(x: Number, value: Number) -> Number:
    """The derivative (1/(1 + x) − log(1 + x)/x)/x of log(1 + x)/x; for |x| < 1e-3 its series,
    to about 1e-12.
    """
    if abs(x) < 1e-3:
        return -1 / 2 + x * (2 / 3 - x * (3 / 4 - x * (4 / 5)))
    return (1 / (1 + x) - value) / x


def _positive(x: Number) -> Number:
    if not x > 0:
        raise ValueError("logarithm of a number that is not positive")
    return x
