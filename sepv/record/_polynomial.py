"""Polynomials in d variables as data: exponents and coefficients.

As data, and not as Python functions, polynomials can be printed, shrunk by Hypothesis, compared,
and written as JSON with hex floats. mpmath can evaluate them at any precision by the formula that
is evaluated here in binary64.
"""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import isfinite
from numbers import Real
from typing import Any

from sepv._arguments import double
from sepv.errors import UsageError

Exponents = tuple[int, ...]
# The largest degree. For larger k, x^k is 0 or infinite for nearly every binary64 number x.
MAX_DEGREE = 1024
# The most products of two terms in a product of polynomials: seconds of work.
MAX_PRODUCTS = 2**22


@dataclass(frozen=True)
class Polynomial:
    """A polynomial Σ_t c_t Π_i y_i^(e_ti) with `terms` (e_t, c_t) in canonical order,
    without zero terms.

    The function `polynomial` builds one: it sorts, merges and checks the terms.
    """

    dimension: int
    terms: tuple[tuple[Exponents, float], ...]

    @cached_property
    def degree(self) -> int:
        """The total degree; 0 for a constant and for the zero polynomial."""
        return max((sum(e) for e, _ in self.terms), default=0)

    def __str__(self) -> str:
        return " + ".join(_term_text(e, c) for e, c in self.terms).replace("+ -", "- ") or "0"


def polynomial(dimension: int, terms: Mapping[Any, float] | Iterable[tuple[Exponents, float]]) -> Polynomial:
    """A polynomial from {exponents: coefficient}; equal exponents are added, zero terms dropped.

    Raises
    ------
    UsageError
        If an exponent tuple does not have `dimension` non-negative integers, or a coefficient is
        not finite.
    """
    merged: dict[Exponents, float] = {}
    for exponents, coefficient in terms.items() if isinstance(terms, Mapping) else terms:
        try:
            key = tuple(map(operator.index, exponents))
        except TypeError:
            key = (-1,)  # 2.5 is refused, not rounded to 2
        if len(key) != dimension or min(key, default=0) < 0:
            raise UsageError(
                expected=f"{dimension} exponents ≥ 0 for each term",
                received=repr(exponents),
                remedy="write one non-negative integer for each variable",
            )
        if sum(key) > MAX_DEGREE:
            raise UsageError(
                expected=f"a degree of at most {MAX_DEGREE}",
                received=f"exponents {key}",
                remedy="powers are tabulated one by one: such a degree is a function, not a table",
            )
        if not isinstance(coefficient, Real) or not isfinite(coefficient):
            raise UsageError(
                expected="coefficients that are finite real numbers",
                received=f"{coefficient!r} at exponents {key}",
                remedy="leave the term out, or give it a finite value",
            )
        merged[key] = merged.get(key, 0.0) + float(coefficient)
    return _canonical(dimension, merged)


def _canonical(dimension: int, merged: dict[Exponents, float]) -> Polynomial:
    nonzero = [(e, c) for e, c in merged.items() if c != 0.0]
    if len(nonzero) > 1:
        nonzero.sort(key=lambda t: (sum(t[0]), t[0][::-1]))
    return Polynomial(dimension, tuple(nonzero))


def constant(dimension: int, value: float) -> Polynomial:
    """The polynomial with one constant value."""
    return polynomial(dimension, {(0,) * dimension: value})


@lru_cache(maxsize=1024)
def variable(dimension: int, index: int) -> Polynomial:
    """The polynomial y_index, one of the coordinates."""
    return Polynomial(dimension, ((tuple(int(i == index) for i in range(dimension)), 1.0),))


def linear(coefficients: Sequence[float]) -> Polynomial:
    """The linear polynomial Σ b_k y_k."""
    d = len(coefficients)
    return polynomial(d, [(variable(d, k).terms[0][0], b) for k, b in enumerate(coefficients)])


def squares(weights: Sequence[float]) -> Polynomial:
    """The polynomial ½ Σ w_k y_k² with weights w_k."""
    d = len(weights)
    return polynomial(d, [(tuple(2 * int(i == k) for i in range(d)), 0.5 * w) for k, w in enumerate(weights)])


def add(*summands: Polynomial) -> Polynomial:
    """The sum of polynomials in the same variables."""
    nonzero = [p for p in summands if p.terms]
    if len(nonzero) <= 1:
        return nonzero[0] if nonzero else summands[0]
    merged: dict[Exponents, float] = {}
    for p in nonzero:
        for e, c in p.terms:
            merged[e] = merged.get(e, 0.0) + c
    return _canonical(nonzero[0].dimension, merged)


def multiply(p: Polynomial, q: Polynomial) -> Polynomial:
    """The product of two polynomials, exact if all products and sums of their coefficients are
    exact in binary64.

    Raises UsageError for more than MAX_PRODUCTS products of terms.
    """
    if len(p.terms) * len(q.terms) > MAX_PRODUCTS:
        raise UsageError(
            expected=f"polynomials whose product takes at most {MAX_PRODUCTS} products of terms",
            received=f"{len(p.terms)} and {len(q.terms)} terms",
            remedy="give such a system as functions: sepv.Problem",
        )
    terms = [(tuple(map(operator.add, e, f)), c * g) for e, c in p.terms for f, g in q.terms]
    if p.degree + q.degree > MAX_DEGREE or not all(isfinite(c) for _, c in terms):
        return polynomial(p.dimension, terms)  # which reports the error
    if len(q.terms) == 1 and all(c for _, c in terms):
        return Polynomial(p.dimension, tuple(terms))  # the same factor in each term keeps the order
    merged: dict[Exponents, float] = {}
    for e, c in terms:
        merged[e] = merged.get(e, 0.0) + c
    return _canonical(p.dimension, merged)


def scale(factor: float, p: Polynomial) -> Polynomial:
    """The polynomial `factor` times p."""
    if factor == 0:
        return Polynomial(p.dimension, ())
    scaled = tuple((e, factor * c) for e, c in p.terms)
    if all(c and isfinite(c) for _, c in scaled):
        return Polynomial(p.dimension, scaled)
    return polynomial(p.dimension, scaled)


def differentiate(p: Polynomial, index: int) -> Polynomial:
    """The partial derivative ∂p/∂y_index."""
    return gradient(p, index)[0]


def gradient(p: Polynomial, first: int = 0) -> tuple[Polynomial, ...]:
    """The partial derivatives of p by the variables from index `first` on,
    by default by all of them.
    """
    # Lowering one exponent in each term keeps the canonical order.
    partials: list[list[tuple[Exponents, float]]] = [[] for _ in range(first, p.dimension)]
    for e, c in p.terms:
        for i, terms in enumerate(partials, first):
            k = e[i]
            if k:
                terms.append(((*e[:i], k - 1, *e[i + 1 :]), k * c))
    zero = Polynomial(p.dimension, ())
    return tuple(_of_sorted(p.dimension, terms) if terms else zero for terms in partials)


def _of_sorted(dimension: int, terms: list[tuple[Exponents, float]]) -> Polynomial:
    """The polynomial with `terms` in canonical order; a coefficient that is not finite raises
    UsageError.
    """
    if all(map(isfinite, [c for _, c in terms])):
        return Polynomial(dimension, tuple(terms))
    return polynomial(dimension, terms)


def to_json(p: Polynomial) -> list[list[Any]]:
    """A polynomial as JSON data [[exponents, hex coefficient], …],
    from which `from_json` restores every bit.
    """
    return [[list(e), c.hex()] for e, c in p.terms]


def from_json(dimension: int, data: Any) -> Polynomial:
    """The inverse of `to_json`, for data that obey the schema of problems."""
    return polynomial(dimension, [(tuple(map(int, e)), double(c)) for e, c in data])


def _term_text(exponents: Exponents, coefficient: float) -> str:
    factors = [f"y{i + 1}" + (f"^{e}" if e > 1 else "") for i, e in enumerate(exponents) if e]
    if not factors:
        return repr(coefficient)
    sign = {1.0: "", -1.0: "-"}.get(coefficient)
    return (f"{coefficient!r} " if sign is None else sign) + " ".join(factors)
