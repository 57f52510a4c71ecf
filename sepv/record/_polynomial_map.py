"""Functions whose entries are polynomials, such as H, ∇H and B, evaluated at states and batches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, zip_longest
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sepv.record._arrays import Source
from sepv.record._polynomial import Polynomial

# The largest terms × sums × states for which one reduction over all terms is faster than a loop
# over layers of terms. The loop saves additions but calls NumPy more often. The number was
# measured, and matters for speed alone.
ONE_REDUCTION_MAX_SIZE = 8192
# A single state is evaluated by a Python function of numbers from this use on, when its compilation
# has paid, and if it has at most so many factors and terms. Measured, for speed alone.
COMPILED_FROM_USE, COMPILED_MAX_SIZE = 64, 256


@dataclass(frozen=True, eq=False)
class _Sums:
    """The sums of monomials of several polynomials, as index tables for their evaluation.

    Products and sums run strictly in order. With a BLAS product or NumPy's pairwise sum the bits
    for one state would depend on the other states of the batch.

    Attributes
    ----------
    top : the largest exponent of one variable
    factors : (most factors of a monomial, monomials + 1)
        The powers to multiply for each monomial: y_i^k has the number i + d·k. Short monomials are
        padded by y_1⁰ = 1. The last monomial is 1.
    places, coefficients : (terms of all sums,) each
        The numbers of the monomials of the sums, sum after sum, and their coefficients.
    starts : (sums + 1,)
        Where the terms of each sum begin. Nothing is padded, so that one long sum costs its own
        terms alone.
    rows : (rows,) or None
        The number of the sum of each polynomial, if some polynomials are equal, such as zero
        entries of B and B′, or entries of a Hessian in pairs. None if all polynomials differ.
    """

    top: int
    factors: NDArray[np.intp]
    places: NDArray[np.intp]
    coefficients: NDArray[np.float64]
    starts: NDArray[np.intp]
    rows: NDArray[np.intp] | None

    def __call__(self, y: NDArray[Any]) -> NDArray[Any]:
        """The values of all polynomials at states y (d, M), of shape (rows, M)
        with a row for each polynomial.
        """
        values = self._values(y)
        return values if self.rows is None else values.take(self.rows, axis=0)

    def of_one(self, d: int) -> Callable[[list[float], tuple[()]], list[float]] | None:
        """The values of all polynomials for the d components of one state, as a function of
        numbers; None until it has paid to compile it.
        """
        own = vars(self)
        own["uses"] = uses = own.get("uses", 0) + 1
        if uses < COMPILED_FROM_USE or self.factors.size + self.places.size > COMPILED_MAX_SIZE:
            return None
        if "function" not in own:
            own["function"] = Source(self._text(d), ()).function
        function: Callable[[list[float], tuple[()]], list[float]] = own["function"]
        return function

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "function"}

    def _text(self, d: int) -> str:
        """The operations of `_at_once` in the same order, except products with 1."""
        used = {n for n in self.factors.flat if n >= d}
        powers = sorted({i for n in used for i in range(n % d + d, n + 1, d)})
        lines = [f"p{n} = " + (f"p{n - d} * p{d + n % d}" if n >= 2 * d else f"y[{n - d}]") for n in powers]
        products = [" * ".join(f"p{n}" for n in numbers if n >= d) for numbers in self.factors.T]
        lines += [f"m{t} = {product or 1.0}" for t, product in enumerate(products)]
        terms = [f"{c!r} * m{t}" for t, c in zip(self.places, self.coefficients.tolist(), strict=True)]
        for n, (start, end) in enumerate(pairwise(self.starts)):
            lines.append(f"s{n} = " + " + ".join(["0.0", *terms[start:end]]))
        rows = range(len(self.starts) - 1) if self.rows is None else self.rows
        return "\n    ".join(["def evaluate(y, _):", *lines, f"return [{', '.join(f's{n}' for n in rows)}]"])

    def _values(self, y: NDArray[Any]) -> NDArray[Any]:
        """The values (sums, M) of the sums at states y (d, M); equal polynomials share one sum."""
        sums = len(self.starts) - 1
        if not self.places.size:
            return np.zeros((sums, y.shape[1]), dtype=np.result_type(y, np.float64))
        d = len(y)
        powers = np.empty(((self.top + 1) * d, y.shape[1]), dtype=y.dtype)
        powers[:d], powers[d : 2 * d] = 1, y[: self.top * d]
        for k in range(2 * d, len(powers), d):
            np.multiply(powers[k - d : k], y, out=powers[k : k + d])
        rule = (
            self._at_once
            if (1 + self._longest) * sums * y.shape[1] <= ONE_REDUCTION_MAX_SIZE
            else self._in_layers
        )
        return rule(powers)

    def _at_once(self, powers: NDArray[Any]) -> NDArray[Any]:
        one = len(self.factors) == 1
        # `take` is twice as fast as an index for few states.
        monomials = powers.take(self.factors[0] if one else self.factors, axis=0)
        monomials = monomials if one else np.multiply.reduce(monomials)
        places, coefficients = self._table
        terms = coefficients * monomials.take(places, axis=0)
        # np.add.reduce would sum a single column in pairs.
        values: NDArray[Any] = np.add.accumulate(terms)[-1] if terms.shape[2] == 1 else np.add.reduce(terms)
        return values

    def _in_layers(self, powers: NDArray[Any]) -> NDArray[Any]:
        """The values of all sums, added in steps n = 1, 2, …:
        step n adds the n-th term to every sum that has one.
        """
        monomials = powers[self.factors[0]]
        for numbers in self.factors[1:]:
            monomials *= powers[numbers]
        order, layers = self._layers
        totals = np.zeros((len(order), powers.shape[1]), dtype=np.result_type(powers, np.float64))
        for places, coefficients in layers:
            totals[: len(places)] += coefficients * monomials[places]
        values = np.empty_like(totals)
        values[order] = totals
        return values

    @cached_property
    def _longest(self) -> int:
        return int(np.diff(self.starts).max())

    @cached_property
    def _table(self) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """The terms (1 + most terms of a sum, sums) and (…, 1);
        row 0 and the padding of short sums are 0 · 1.
        """
        lengths = np.diff(self.starts)
        places = np.full((1 + self._longest, len(lengths)), self.factors.shape[1] - 1)
        coefficients = np.zeros((*places.shape, 1))
        sums = np.repeat(np.arange(len(lengths)), lengths)
        terms = 1 + np.arange(len(self.places)) - np.repeat(self.starts[:-1], lengths)
        places[terms, sums], coefficients[terms, sums, 0] = self.places, self.coefficients
        return places, coefficients

    @cached_property
    def _layers(self) -> tuple[NDArray[np.intp], list[tuple[NDArray[np.intp], NDArray[np.float64]]]]:
        """Tables for `_in_layers`: the numbers of the sums, longest first, and for n = 1, 2,
        … their n-th terms.
        """
        lengths = np.diff(self.starts)
        order = np.argsort(-lengths, kind="stable")
        firsts = self.starts[:-1][order]
        counts = np.searchsorted(-lengths[order], -np.arange(self._longest), side="left")
        here = [firsts[:count] + n for n, count in enumerate(counts)]
        return order, [(self.places[k], self.coefficients[k, None]) for k in here]


@dataclass(frozen=True)
class PolynomialMap:
    """Several polynomials evaluated together: each distinct monomial once,
    then one sum for each polynomial.

    The bits for one state do not depend on how many states are evaluated with it.
    """

    shape: tuple[int, ...]
    rows: tuple[Polynomial, ...]

    @cached_property
    def _sums(self) -> _Sums:
        d = self.rows[0].dimension
        # Each distinct polynomial is listed once. Equal ones are recognised by identity, except
        # that all zeros are one.
        distinct = {id(p) if p.terms else 0: p.terms for p in self.rows}
        monomials = sorted({e for terms in distinct.values() for e, _ in terms})
        index = {e: t for t, e in enumerate(monomials)}
        factors = [[i + d * k for i, k in enumerate(e) if k] for e in monomials]
        # Terms in the order of the monomials, for every polynomial.
        sums = [sorted([(index[e], c) for e, c in terms]) for terms in distinct.values()]
        numbers = {key: r for r, key in enumerate(distinct)}
        return _Sums(
            max(map(max, monomials), default=0),
            np.array([*zip_longest(*factors, [0], fillvalue=0)]),
            np.array([place for terms in sums for place, _ in terms], dtype=np.intp),
            np.array([c for terms in sums for _, c in terms], dtype=np.float64),
            np.cumsum([0, *map(len, sums)]),
            np.array([numbers[id(p) if p.terms else 0] for p in self.rows])
            if len(sums) < len(self.rows)
            else None,
        )

    @cached_property
    def _majorants(self) -> _Sums:
        return replace(self._sums, coefficients=np.abs(self._sums.coefficients))

    def __call__(self, y: ArrayLike) -> NDArray[Any]:
        """The values of all polynomials at y (d, ...), of shape (*shape, *y.shape[1:]),
        in the dtype of y.
        """
        return self._evaluate(np.asarray(y), self._sums)

    def majorant(self, y: ArrayLike) -> NDArray[Any]:
        """The sum Σ_t |c_t| Π_i |y_i|^e_ti for each polynomial at y,
        the scale of the rounding errors of its value.
        """
        return self._evaluate(np.abs(np.asarray(y)), self._majorants)

    def _evaluate(self, y: NDArray[Any], sums: _Sums) -> NDArray[Any]:
        if y.size == len(y) and y.dtype.char == "d" and (function := sums.of_one(len(y))):
            numbers = function(y.ravel().tolist(), ())
            if isfinite(sum(numbers)):  # else NumPy gives its warnings
                return np.array(numbers).reshape(self.shape + y.shape[1:])
        return sums(y.reshape(len(y), -1)).reshape((*self.shape, *y.shape[1:]))
