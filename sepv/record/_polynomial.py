"""Polynomials in d variables as data: exponents and coefficients.

Data, not closures: a polynomial prints, shrinks, is compared, travels as JSON with hex floats, and is
evaluated by mpmath at any precision exactly as it is evaluated here in binary64.
"""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sepv.errors import UsageError

Exponents = tuple[int, ...]
# Beyond it x^k is 0 or infinite for nearly every binary64 number x.
MAX_DEGREE = 1024


@dataclass(frozen=True)
class Polynomial:
    """Σ_t coefficients[t] · Π_i y_i ** exponents[t][i], in canonical order, without zero terms.

    Build one with `polynomial`, which sorts, merges and checks.
    """

    dimension: int
    terms: tuple[tuple[Exponents, float], ...]

    @property
    def degree(self) -> int:
        """Total degree; 0 for a constant and for the zero polynomial."""
        return max((sum(e) for e, _ in self.terms), default=0)

    def __str__(self) -> str:
        return " + ".join(_term_text(e, c) for e, c in self.terms).replace("+ -", "- ") or "0"


def polynomial(
    dimension: int, terms: Mapping[Exponents, float] | Iterable[tuple[Exponents, float]]
) -> Polynomial:
    """A polynomial from {exponents: coefficient}; equal exponents are added, zero terms dropped.

    Raises
    ------
    UsageError
        Where an exponent tuple does not have `dimension` non-negative integers, or a coefficient is
        not finite.
    """
    merged: dict[Exponents, float] = {}
    for exponents, coefficient in terms.items() if isinstance(terms, Mapping) else terms:
        key = tuple(map(int, exponents))
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
        if not isfinite(coefficient):
            raise UsageError(
                expected="finite coefficients",
                received=f"{coefficient!r} at exponents {key}",
                remedy="leave the term out, or give it a finite value",
            )
        merged[key] = merged.get(key, 0.0) + float(coefficient)
    return _canonical(dimension, merged)


def _canonical(dimension: int, merged: dict[Exponents, float]) -> Polynomial:
    kept = [(e, c) for e, c in merged.items() if c != 0.0]
    if len(kept) > 1:
        kept.sort(key=lambda t: (sum(t[0]), t[0][::-1]))
    return Polynomial(dimension, tuple(kept))


def constant(dimension: int, value: float) -> Polynomial:
    """The constant polynomial."""
    return polynomial(dimension, {(0,) * dimension: value})


@lru_cache(maxsize=1024)
def variable(dimension: int, index: int) -> Polynomial:
    """The coordinate y_index."""
    return Polynomial(dimension, ((tuple(int(i == index) for i in range(dimension)), 1.0),))


def add(*summands: Polynomial) -> Polynomial:
    """The sum of polynomials in the same variables."""
    some = [p for p in summands if p.terms]
    if len(some) <= 1:
        return some[0] if some else summands[0]
    merged: dict[Exponents, float] = {}
    for p in some:
        for e, c in p.terms:
            merged[e] = merged.get(e, 0.0) + c
    return _canonical(some[0].dimension, merged)


def multiply(p: Polynomial, q: Polynomial) -> Polynomial:
    """The product; exact where the coefficients' products and sums are (small dyadic rationals)."""
    terms = [(tuple(map(operator.add, e, f)), c * g) for e, c in p.terms for f, g in q.terms]
    if p.degree + q.degree > MAX_DEGREE or not all(isfinite(c) for _, c in terms):
        return polynomial(p.dimension, terms)  # which says what is wrong
    if len(q.terms) == 1 and all(c for _, c in terms):
        return Polynomial(p.dimension, tuple(terms))  # the same exponents more in each term keep the order
    merged: dict[Exponents, float] = {}
    for e, c in terms:
        merged[e] = merged.get(e, 0.0) + c
    return _canonical(p.dimension, merged)


def scale(factor: float, p: Polynomial) -> Polynomial:
    """factor · p."""
    if factor == 0:
        return Polynomial(p.dimension, ())
    scaled = tuple((e, factor * c) for e, c in p.terms)
    if all(c and isfinite(c) for _, c in scaled):
        return Polynomial(p.dimension, scaled)
    return polynomial(p.dimension, [(e, factor * c) for e, c in p.terms])


def differentiate(p: Polynomial, index: int) -> Polynomial:
    """∂p/∂y_index."""
    lowered = tuple(
        [((*e[:index], e[index] - 1, *e[index + 1 :]), c * e[index]) for e, c in p.terms if e[index]]
    )
    if all(isfinite(c) for _, c in lowered):
        return Polynomial(p.dimension, lowered)  # one exponent less in each term keeps the canonical order
    return polynomial(p.dimension, lowered)


def gradient(p: Polynomial) -> tuple[Polynomial, ...]:
    """(∂p/∂y_1, …, ∂p/∂y_d)."""
    return tuple(differentiate(p, i) for i in range(p.dimension))


# What a call of NumPy costs beside a product or sum of two numbers, about: measured, for speed alone. The arrays take
# a call for each power, layer of factors and layer of terms (three for those), the numbers an operation for each state.
CALL = 35


@dataclass(frozen=True, eq=False)
class _Monomials:
    """Products of powers.

    Attributes
    ----------
    factors : for each monomial the powers to multiply, those with exponent 0 left out; y_i^k has the number i + d·k
    top : the largest exponent of one variable
    variables : d
    """

    factors: list[tuple[int, ...]]
    top: int
    variables: int

    @cached_property
    def chain(self) -> tuple[list[tuple[int, int]], list[int]]:
        """(product so far, power) of each partial product, made once; where each monomial is then found.

        Products are numbered on after the powers; a monomial of one factor is a power.
        """
        first = (self.top + 1) * self.variables
        known: dict[tuple[int, ...], int] = {(): 0}  # y_1⁰
        steps: list[tuple[int, int]] = []
        for factors in self.factors:
            for n in range(1, len(factors) + 1):
                if factors[:n] not in known:
                    known[factors[:n]] = factors[0] if n == 1 else first + len(steps)
                    if n > 1:
                        steps.append((known[factors[: n - 1]], factors[n - 1]))
        return steps, [known[factors] for factors in self.factors]

    @cached_property
    def layers(self) -> list[Any]:
        """In arrays: the n-th factors of all monomials, y_1⁰ where there is none."""
        most = max(map(len, self.factors), default=0) or 1
        return [np.array([f[n] if n < len(f) else 0 for f in self.factors]) for n in range(most)]


@dataclass(frozen=True, eq=False)
class _Sums:
    """The sums of some monomials, as they are computed.

    Products and sums run strictly in order, over numbers for few states and over arrays for many (not by a BLAS
    product or NumPy's pairwise sum): both ways give the same bits.

    Attributes
    ----------
    count : how many sums
    rows : (sum, ((coefficient, monomial), …)), those without terms left out, in decreasing number of terms
    """

    count: int
    monomials: _Monomials
    rows: list[tuple[int, list[tuple[float, int]]]]

    @cached_property
    def few(self) -> float:
        """Up to how many states a loop over numbers is quicker than arrays."""
        made, longest = self.monomials, max((len(terms) for _, terms in self.rows), default=0)
        one = sum(map(len, made.factors)) + sum(len(terms) for _, terms in self.rows)
        calls = made.top + max(map(len, made.factors), default=0) + 2 * longest
        return CALL * calls / (one + made.top * made.variables + 20)

    @cached_property
    def _numbers(self) -> NDArray[np.intp]:
        """Those of the rows."""
        return np.array([r for r, _ in self.rows], dtype=np.intp)

    @cached_property
    def _layers(self) -> tuple[list[tuple[Any, Any]], Any]:
        """In arrays: the n-th terms of all rows, (coefficients, monomials), and the numbers of the rows."""
        terms = []
        for n in range(len(self.rows[0][1]) if self.rows else 0):
            layer = [row[n] for _, row in self.rows if n < len(row)]
            terms.append((np.array([[c] for c, _ in layer]), np.array([t for _, t in layer])))
        return terms, self._numbers

    def absolute(self) -> _Sums:
        """With the absolute values of the coefficients."""
        rows = [(r, [(abs(c), t) for c, t in terms]) for r, terms in self.rows]
        return _Sums(self.count, self.monomials, rows)

    def __call__(self, y: NDArray[Any]) -> NDArray[Any]:
        """(count, M) for y of shape (d, M)."""
        few = y.shape[1] <= self.few and y.dtype == np.float64
        return self._by_numbers(y) if few else self._by_arrays(y)

    def _by_numbers(self, y: NDArray[Any]) -> NDArray[Any]:
        steps, places = self.monomials.chain
        sums = np.zeros((self.count, y.shape[1]))
        for lane, state in enumerate(y.T.tolist()):
            last = [1.0] * len(state)
            values = last.copy()
            for _ in range(self.monomials.top):
                last = [a * b for a, b in zip(last, state, strict=True)]
                values += last
            for so_far, factor in steps:
                values.append(values[so_far] * values[factor])
            monomials = [values[place] for place in places]
            totals = []
            for _, terms in self.rows:
                total = 0.0
                for c, t in terms:
                    total += c * monomials[t]
                totals.append(total)
            sums[self._numbers, lane] = totals
        return sums

    def _by_arrays(self, y: NDArray[Any]) -> NDArray[Any]:
        values = np.zeros((self.count, y.shape[1]), dtype=np.result_type(y, np.float64))
        if not self.rows:
            return values
        factors, (terms, rows) = self.monomials.layers, self._layers
        powers = np.ones((self.monomials.top + 1, *y.shape), dtype=y.dtype)
        for k in range(self.monomials.top):
            powers[k + 1] = powers[k] * y
        powers = powers.reshape(-1, y.shape[1])
        monomials = powers[factors[0]]
        for numbers in factors[1:]:
            monomials *= powers[numbers]
        totals = np.zeros((len(rows), y.shape[1]), dtype=values.dtype)
        for coefficients, numbers in terms:
            totals[: len(numbers)] += coefficients * monomials[numbers]
        values[rows] = totals
        return values


@dataclass(frozen=True)
class PolynomialMap:
    """Several polynomials evaluated together: their distinct monomials once, then one sum a row.

    The bits of one state do not depend on how many states are evaluated with it.
    """

    shape: tuple[int, ...]
    rows: tuple[Polynomial, ...]

    @cached_property
    def _sums(self) -> _Sums:
        d = self.rows[0].dimension
        monomials = sorted({e for p in self.rows for e, _ in p.terms})
        index = {e: t for t, e in enumerate(monomials)}
        # In the order of the monomials, not of the terms.
        rows = [
            (r, [(c, t) for t, c in sorted([(index[e], c) for e, c in p.terms])])
            for r, p in enumerate(self.rows)
            if p.terms
        ]
        rows.sort(key=lambda row: -len(row[1]))
        factors = [tuple([i + d * k for i, k in enumerate(e) if k]) for e in monomials]
        top = max((k for e in monomials for k in e), default=0)
        return _Sums(len(self.rows), _Monomials(factors, top, d), rows)

    @cached_property
    def _majorants(self) -> _Sums:
        return self._sums.absolute()

    def __call__(self, y: ArrayLike) -> NDArray[Any]:
        """Values of shape (*shape, *y.shape[1:]) at y of shape (d, ...), in the dtype of y."""
        return self._evaluate(np.asarray(y), self._sums)

    def majorant(self, y: ArrayLike) -> NDArray[Any]:
        """Σ |c_t| Π |y_i|^e_i: what rounding errors of the sum are relative to."""
        return self._evaluate(np.abs(np.asarray(y)), self._majorants)

    def _evaluate(self, y: NDArray[Any], sums: _Sums) -> NDArray[Any]:
        return sums(y.reshape(len(y), -1)).reshape((*self.shape, *y.shape[1:]))


def majorant(function: Any, y: NDArray[Any]) -> NDArray[Any]:
    """What rounding errors of a function of y are relative to: its own `majorant`, else |value|."""
    own = getattr(function, "majorant", None)
    return np.asarray(np.abs(function(y)) if own is None else own(y))


def to_json(p: Polynomial) -> list[list[Any]]:
    """[[exponents, hex coefficient], …]; `from_json` gives back the same polynomial to the bit."""
    return [[list(e), c.hex()] for e, c in p.terms]


def from_json(dimension: int, data: Any) -> Polynomial:
    """The inverse of `to_json`."""
    try:
        terms = [(tuple(int(k) for k in e), parse_float(c)) for e, c in data]
    except (TypeError, ValueError) as error:
        raise UsageError(
            expected="a list of [exponents, coefficient] pairs, coefficients as hex floats or numbers",
            received=f"{data!r:.200}",
            remedy='write for example [[[2, 0], "0x1p-1"]] for y1²/2',
        ) from error
    return polynomial(dimension, terms)


def parse_float(value: Any) -> float:
    """A float from a hex string ("0x1.8p-1") or a number."""
    return float.fromhex(value) if isinstance(value, str) else float(value)


def _term_text(exponents: Exponents, coefficient: float) -> str:
    factors = [f"y{i + 1}" + (f"^{e}" if e > 1 else "") for i, e in enumerate(exponents) if e]
    if not factors:
        return repr(coefficient)
    sign = {1.0: "", -1.0: "-"}.get(coefficient)
    return (f"{coefficient!r} " if sign is None else sign) + " ".join(factors)
