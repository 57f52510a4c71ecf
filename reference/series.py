"""Power series whose coefficients are computed on demand, in the numbers of any arithmetic.

The Taylor coefficients of the solution of y′ = f(y) follow from (k + 1) y_{k+1} = [f(y)]_k, where f
is the problem's own formula, evaluated once on series. Each further coefficient costs one
convolution for each operation in f.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from sepv.reference.arithmetic import Arithmetic, Number, Vector
from sepv.reference.problem import Description, in_arithmetic

Dot = Callable[[Iterable[Number], Iterable[Number]], Number]


class PowerSeries:
    """A power series Σ_k a_k t^k. `rule(k)` gives a_k from a_0 … a_{k−1};
    `dot` is a scalar product of coefficients.
    """

    __slots__ = ("coefficients", "dot", "rule")

    def __init__(self, dot: Dot, rule: Callable[[int], Number], first: Vector | None = None) -> None:
        self.dot, self.rule, self.coefficients = dot, rule, first or []

    def __getitem__(self, k: int) -> Number:
        while len(self.coefficients) <= k:
            self.coefficients.append(self.rule(len(self.coefficients)))
        return self.coefficients[k]

    def upto(self, k: int) -> Vector:
        """The coefficients [a_0, …, a_k] of the series; missing ones are computed."""
        self[k]
        return self.coefficients[: k + 1]

    def __add__(self, other: Any) -> PowerSeries:
        if isinstance(other, PowerSeries):
            return PowerSeries(self.dot, lambda k: self[k] + other[k])
        return PowerSeries(self.dot, lambda k: self[k] if k else self[0] + other)

    def __neg__(self) -> PowerSeries:
        return PowerSeries(self.dot, lambda k: -self[k])

    def __sub__(self, other: Any) -> PowerSeries:
        return self + -other

    def __rsub__(self, other: Any) -> PowerSeries:
        return -self + other

    def __mul__(self, other: Any) -> PowerSeries:
        if isinstance(other, PowerSeries):
            return PowerSeries(self.dot, lambda k: self.convolved(self.upto(k), other.upto(k)))
        return PowerSeries(self.dot, lambda k: self[k] * other)

    def __truediv__(self, other: Any) -> PowerSeries:
        """The quotient q = a/b from b q = a: q_k = (a_k − Σ_{i<k} q_i b_{k−i})/b_0."""
        if not isinstance(other, PowerSeries):
            return PowerSeries(self.dot, lambda k: self[k] / other)

        def rule(k: int) -> Number:
            left = self[k] - self.convolved(quotient.upto(k - 1), other.upto(k)[1:]) if k else self[0]
            return left / other[0]

        quotient = PowerSeries(self.dot, rule)
        return quotient

    def __rtruediv__(self, other: Any) -> PowerSeries:
        return PowerSeries(self.dot, lambda k: 0 * self[0] if k else other) / self

    __radd__, __rmul__ = __add__, __mul__

    def convolved(self, a: Vector, b: Vector) -> Number:
        """The coefficient of t^k in the product of two series, Σ_i a_i b_{k−i} over i = 0 … k."""
        return self.dot(a, reversed(b))


def _derivative(a: PowerSeries, k: int) -> Vector:
    """The coefficients [1 a_1, …, k a_k] of t a′(t)."""
    return [i * v for i, v in enumerate(a.upto(k)) if i]


def series_over(base: Arithmetic) -> Arithmetic:
    """The arithmetic of power series with coefficients in `base`;
    constants remain numbers of `base`.
    """

    def sine_and_cosine(x: PowerSeries) -> tuple[PowerSeries, PowerSeries]:
        """Sine s and cosine c of a series x, by k s_k = Σ i x_i c_{k−i} and k c_k = −Σ i x_i
        s_{k−i}.
        """

        def sine_rule(k: int) -> Number:
            return x.convolved(_derivative(x, k), cosine.upto(k - 1)) / k if k else base.sin(x[0])

        def cosine_rule(k: int) -> Number:
            return -x.convolved(_derivative(x, k), sine.upto(k - 1)) / k if k else base.cos(x[0])

        sine, cosine = PowerSeries(base.dot, sine_rule), PowerSeries(base.dot, cosine_rule)
        return sine, cosine

    def log(x: PowerSeries) -> PowerSeries:
        """The logarithm l of a series x, from x l′ = x′, coefficient by coefficient."""
        slope = PowerSeries(base.dot, lambda k: (k + 1) * x[k + 1]) / x
        return PowerSeries(base.dot, lambda k: slope[k - 1] / k if k else base.log(x[0]))

    return replace(
        base,
        sin=lambda x: sine_and_cosine(x)[0],
        cos=lambda x: sine_and_cosine(x)[1],
        log=log,
        tables=None,
    )


def solution_series(data: Description, base: Arithmetic, y0: Vector, order: int) -> list[Vector]:
    """Taylor coefficients up to `order` of each component of the solution of y′ = f(y), y(0)
    = y0.
    """
    problem = in_arithmetic(data, series_over(base))
    y = [PowerSeries(base.dot, _unknown, [v]) for v in y0]
    f = problem.field(y)
    for k in range(order):
        following = [_coefficient(component, k) / (k + 1) for component in f]
        for series, value in zip(y, following, strict=True):
            series.coefficients.append(value)
    return [series.coefficients for series in y]


def _coefficient(a: Any, k: int) -> Number:
    """The coefficient a_k of a series or of a number, which is a constant series."""
    return a[k] if isinstance(a, PowerSeries) else a if k == 0 else 0 * a


def _unknown(k: int) -> Number:
    raise IndexError(f"the coefficient {k} of the solution is not known yet")
