"""The exact flow of a polynomial system as a power series in the time, in arbitrary precision."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sepv.reference.problem import context

from sepv.problem import PolynomialSystem
from sepv.record import Polynomial
from sepv.record import polynomial_gradient as gradient

Series = list[Any]


def flow_series(
    system: PolynomialSystem, y: Sequence[float], order: int, digits: int = 40
) -> list[list[Any]]:
    """Coefficients c_0, …, c_order with φ_θ(y) = Σ c_k θ^k + O(θ^{order+1}),
    each c_k as a list of d numbers.

    Because y′ = B(y)∇H(y), coefficient k of the right side, divided by k + 1, is coefficient k + 1
    of y.
    """
    ctx, d = context(digits), system.dimension
    slopes = gradient(system.hamiltonian)
    y_series = [[ctx.mpf(float(v))] for v in y]
    for k in range(order):
        g = [_value(p, y_series, k, ctx) for p in slopes]
        right = [[ctx.zero] * (k + 1) for _ in range(d)]
        for i, j, entry in system.structure:
            b = _value(entry, y_series, k, ctx)
            right[i] = [r + p for r, p in zip(right[i], _product(b, g[j], k, ctx), strict=True)]
            right[j] = [r - p for r, p in zip(right[j], _product(b, g[i], k, ctx), strict=True)]
        for component, r in zip(y_series, right, strict=True):
            component.append(r[k] / (k + 1))
    return [[component[k] for component in y_series] for k in range(order + 1)]


def _value(p: Polynomial, y: list[Series], order: int, ctx: Any) -> Series:
    """The value p(y) of a polynomial at a state of power series, as a series up to t^order."""
    total = [ctx.zero] * (order + 1)
    for exponents, coefficient in p.terms:
        term = [ctx.mpf(coefficient)] + [ctx.zero] * order
        for component, exponent in zip(y, exponents, strict=True):
            for _ in range(exponent):
                term = _product(term, component, order, ctx)
        total = [a + b for a, b in zip(total, term, strict=True)]
    return total


def _product(a: Series, b: Series, order: int, ctx: Any) -> Series:
    return [ctx.fsum(a[i] * b[n - i] for i in range(n + 1)) for n in range(order + 1)]
