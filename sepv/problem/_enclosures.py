"""Bounds of a problem's functions over the box of a step, from their recorded operations,
and H in any arithmetic.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from sepv.core.arrays import Array
from sepv.core.problem import Function
from sepv.record import CannotRecord, Tape, gradient, jacobian, magnitudes

# The number of pieces of a segment, each with a box of its own, if the box of the whole segment has
# no finite bound.
PIECES = 16


class EnclosedRecord(NamedTuple):
    """The symbols of a state y (d,), of the entries of a function of y,
    and of their derivatives (entries, d).
    """

    y: Any
    values: Any
    slopes: Any


@lru_cache(maxsize=256)
def recorded(function: Function, dimension: int, *, differentiated: bool = False) -> EnclosedRecord | None:
    """The record of a function of y or, if `differentiated`, of its gradient.

    It is None if the function cannot be recorded.
    """
    tape = Tape()
    y = tape.vector(dimension)
    try:
        symbols = tape.symbols(function(y))
    except Exception:  # a user's function may raise anything if it is called with symbols
        return None
    try:
        values = np.asarray(gradient(symbols, y) if differentiated else symbols, dtype=object).ravel()
        return EnclosedRecord(y, values, jacobian(values, y))
    except CannotRecord:
        return None


def over_box(
    function: Function, y0: Array, y1: Array, beyond: Any = 0.0, *, differentiated: bool = False
) -> Array | None:
    """A bound of |F| + |F′||y| over the box with corners y0 and y1 (d, ...),
    enlarged by `beyond` on each side.

    F is the function or, if `differentiated`, its gradient; the result is (entries of F, ...).
    Where it is infinite, because the box leaves the domain of F, it is the largest bound over
    PIECES boxes along the segment from y0 to y1. Entries that are infinite there too are 0. None if
    the function cannot be recorded.
    """
    record = recorded(function, len(y0), differentiated=differentiated)
    if record is None:
        return None
    whole = _bounds(record, np.minimum(y0, y1) - beyond, np.maximum(y0, y1) + beyond)
    if np.isfinite(whole).all():
        return whole
    share = np.linspace(0, 1, PIECES + 1).reshape(-1, *(1,) * y0.ndim)
    places = np.moveaxis(y0 + share * (y1 - y0), 0, -1)
    a, b = places[..., :-1], places[..., 1:]
    pieces = _bounds(record, np.minimum(a, b), np.maximum(a, b)).max(axis=-1)
    found = np.where(np.isfinite(whole), whole, pieces)
    return np.where(np.isfinite(found), found, 0.0)


def _bounds(record: EnclosedRecord, low: Array, high: Array) -> Array:
    d, n = len(record.y), len(record.values)
    sizes = magnitudes([*record.values, *record.slopes.ravel()], record.y, low, high)
    slopes = sizes[n:].reshape(n, d, *low.shape[1:])
    with np.errstate(invalid="ignore"):  # 0·∞ of a component that is 0
        terms = slopes * np.maximum(np.abs(low), np.abs(high))
    return np.asarray(sizes[:n] + np.nan_to_num(terms, nan=0.0, posinf=np.inf).sum(axis=1))
