"""The mean of a gradient along a segment, ∫₀¹∇H(y + τz)dτ, exact to rounding,
from the recorded operations of H.

A polynomial of degree ν is averaged by ⌈ν/2⌉ Gauss nodes, which are exact for its gradient. A term
G(ℓ(y)), with ℓ affine and G one of sin, cos, exp, log, 1/x, √, xᵃ, sinh, cosh, has the mean ∇ℓ
(G(ℓ₁) − G(ℓ₀))/δ, where ℓ₀ = ℓ(y), ℓ₁ = ℓ(y + z) and δ = ℓ₁ − ℓ₀. With m = ℓ₀ + δ/2 the quotient
has forms that lose no digits as z → 0:

    sin: cos(m) sinc(δ/2)          exp: e^max(ℓ₀, ℓ₁) E(−|δ|)        1/x: −1/(ℓ₀ℓ₁)
    cos: −sin(m) sinc(δ/2)         log: log1p(δ/ℓ₀)/δ                √: 1/(√ℓ₀ + √ℓ₁)
    xᵃ: a ℓ₀ᵃ⁻¹ L E(aL δ/ℓ₀) with L = log1p(δ/ℓ₀)/(δ/ℓ₀) and E(x) = expm1(x)/x.

A sum of such terms is averaged term by term. For other terms no closed form is known here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from sepv.core.average import gauss_legendre, mean_nodes
from sepv.record._derivative import gradient, hessian, jacobian, reachable
from sepv.record._numpy_protocol import select
from sepv.record._replay import substitute
from sepv.record._symbols import Symbol

# The most Gauss nodes of an average. With more, the rule takes longer than the adaptive quadrature
# of most steps.
AVERAGE_MAX_NODES = 16


class NoClosedForm(Exception):
    """Raised if the average of a gradient, or the flow of a field, has no closed form;
    the message says why.
    """


def degrees(output: Symbol, inputs: Any) -> dict[int, int | None]:
    """The degree in the inputs of each symbol that the output depends on;
    None for a symbol that is no polynomial.
    """
    wanted = {x.index for x in inputs}
    by_row: dict[int, int | None] = {}
    for symbol in reachable([output]):
        below = [by_row[i] for i in symbol.line.arguments]
        by_row[symbol.index] = 1 if symbol.index in wanted else _degree(symbol.line.name, below)
    return by_row


def _degree(name: str, below: list[int | None]) -> int | None:
    """The degree of an operation's result from the degrees of its arguments, `below`;
    None if it is no polynomial.
    """
    degrees = [n for n in below if n is not None]
    if len(degrees) < len(below):
        return None
    if name in ("add", "subtract", "negative"):
        return max(degrees)
    if name in ("multiply", "whole"):
        return sum(degrees)
    if name == "divide":
        return degrees[0] if degrees[1] == 0 else None
    return 0 if not any(degrees) else None


def degree(output: Any, inputs: Any) -> int | None:
    """The degree of an output as a polynomial in the inputs; None if it is not a polynomial."""
    symbol = inputs[0].tape.symbol(output)
    return degrees(symbol, inputs)[symbol.index]


class Mean(NamedTuple):
    """The averaged gradient ∫₀¹∇H(y + τz)dτ as symbols, (d,),
    and the number of Gauss nodes in its polynomial part.
    """

    value: Any
    nodes: int


def mean(output: Any, inputs: Any, z: Any) -> Mean:
    """The average of the gradient of an output, ∫₀¹∇output(y + τz)dτ, for inputs y (d,)
    and further symbols z (d,).

    Raises NoClosedForm unless the output is a polynomial plus terms c·G(ℓ) with constants c,
    functions G in `_QUOTIENT_RULES`, and arguments ℓ that are affine in the inputs.
    """
    tape = inputs[0].tape
    symbol = tape.symbol(output)
    degree_of = degrees(symbol, inputs)
    polynomial: Any = tape.constant(0.0)
    total = tape.symbols(np.zeros(len(inputs)))
    for factor, term in _terms(symbol, 1.0):
        if degree_of.get(term.index) is not None:
            polynomial = polynomial + factor * term
            continue
        total = total + factor * _quotient(term, inputs, z)
    nodes = mean_nodes(degree(polynomial, inputs) or 0)
    if nodes > AVERAGE_MAX_NODES:
        raise NoClosedForm(f"a polynomial H whose mean takes {nodes} Gauss nodes")
    # The derivative of the average is an average of H″, and so symmetric. The chain rule does not
    # use this symmetry.
    slope = gradient(polynomial, inputs)
    bend = hessian(slope, inputs)
    slopes = jacobian(total, z)
    for tau, weight in zip(*gauss_legendre(nodes), strict=True):
        at = inputs + tau * z
        value, further = weight * substitute(slope, inputs, at), weight * tau * substitute(bend, inputs, at)
        total, slopes = tape.symbols(total + value), tape.symbols(slopes + further)
    for symbol, row in zip(total, slopes, strict=True):
        tape.declare(symbol, inputs, dict(zip(z, row, strict=True)))
    return Mean(total, nodes)


def _terms(symbol: Symbol, factor: Any) -> list[tuple[Any, Symbol]]:
    """The terms of `factor` times `symbol`, each as (constant, symbol):
    several if the symbol is a sum, else one.
    """
    name, arguments = symbol.line.name, symbol.arguments
    if name in ("add", "subtract"):
        second = factor if name == "add" else -factor
        return [*_terms(arguments[0], factor), *_terms(arguments[1], second)]
    if name == "negative":
        return _terms(arguments[0], -factor)
    if name == "multiply" and arguments[0].number is not None:
        return _terms(arguments[1], factor * arguments[0].number)
    if name == "divide" and arguments[0].number not in (None, 1.0):
        return [(factor * arguments[0].number, 1 / arguments[1])]
    return [(factor, symbol)]


def _quotient(term: Symbol, inputs: Any, z: Any) -> Any:
    """The averaged gradient of a term G(ℓ) with affine ℓ: ∇ℓ (G(ℓ₁) − G(ℓ₀))/(ℓ₁ − ℓ₀), (d,).

    Raises NoClosedForm for other terms.
    """
    name, arguments = term.line.name, term.arguments
    inner = arguments[-1]
    rule = _QUOTIENT_RULES.get(name)
    reciprocal = name != "divide" or arguments[0].number == 1.0
    if rule is None or not reciprocal or degree(inner, inputs) not in (0, 1):
        raise NoClosedForm(f"{name} of what is not affine" if rule else f"{name}, which has no rule")
    slope = gradient(inner, inputs)
    delta = np.sum(slope * z)
    return slope * rule(inner, delta, term)


def _power(x: Any, delta: Any, term: Symbol) -> Any:
    exponent, ratio = term.line.value, delta / x
    logarithm = ratio.log1p_ratio()
    return exponent * x ** (exponent - 1) * logarithm * (exponent * logarithm * ratio).expm1_ratio()


def _logarithm(x: Any, delta: Any) -> Any:
    inverse = 1 / x
    return (delta * inverse).log1p_ratio() * inverse


def _exponential(x: Any, delta: Any) -> Any:
    """The mean of exp from x to x + delta, computed from the larger end:
    it overflows only if exp does so there.
    """
    up = delta > 0
    return (x + select(up, delta, 0.0)).exp() * select(up, -delta, delta).expm1_ratio()


# The quotient (G(ℓ₁) − G(ℓ₀))/(ℓ₁ − ℓ₀) for each G, from x = ℓ₀, delta = ℓ₁ − ℓ₀ and the term
# itself.
_QUOTIENT_RULES: dict[str, Callable[[Any, Any, Symbol], Any]] = {
    "sin": lambda x, delta, _: (x + 0.5 * delta).cos() * (0.5 * delta).sinc(),
    "cos": lambda x, delta, _: -((x + 0.5 * delta).sin() * (0.5 * delta).sinc()),
    "exp": lambda x, delta, _: _exponential(x, delta),
    "log": lambda x, delta, _: _logarithm(x, delta),
    "divide": lambda x, delta, _: -(1 / (x * (x + delta))),
    "sqrt": lambda x, delta, _: 1 / (x.sqrt() + (x + delta).sqrt()),
    "power": _power,
    # sinh(δ/2)/(δ/2) = e^(−δ/2) expm1(δ)/δ.
    "sinh": lambda x, delta, _: (x + 0.5 * delta).cosh() * (-0.5 * delta).exp() * delta.expm1_ratio(),
    "cosh": lambda x, delta, _: (x + 0.5 * delta).sinh() * (-0.5 * delta).exp() * delta.expm1_ratio(),
}
