"""Interval arithmetic: bounds of a recorded function over a box of states (R. E. Moore,
*Interval Analysis*, 1966).

An interval [low, high] holds all values of an expression whose inputs lie in intervals. Bounds are
not rounded outward: they serve as scales of rounding errors, for which a relative error of a few
roundings is no matter. An operation that is undefined somewhere in its interval, such as 1/x next
to 0, gives an infinite bound. Ends may be arrays, one for each box of a batch.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sepv.record._functions import FUNCTIONS
from sepv.record._replay import ARITHMETIC, replay
from sepv.record._symbols import Symbol

Array = NDArray[np.float64]


class Interval(NamedTuple):
    """The interval of all numbers from `low` to `high`."""

    low: Any
    high: Any


class Truth(NamedTuple):
    """The values of a condition on a box: `always` where it holds everywhere, `ever` somewhere."""

    always: Any
    ever: Any


def magnitudes(outputs: Iterable[Symbol], inputs: Iterable[Symbol], low: Array, high: Array) -> Array:
    """The largest |value| of each recorded output (n, ...) over the box from `low` to `high`,
    (d, ...).
    """
    boxes = {x.index: Interval(a, b) for x, a, b in zip(inputs, low, high, strict=True)}
    with np.errstate(all="ignore"):
        found = replay(outputs, boxes, _function, lambda v: Interval(v, v), _power, _OPERATIONS)
        sizes = [np.maximum(np.abs(a), np.abs(b)) + np.zeros(low.shape[1:]) for a, b in found]
    return np.asarray(np.nan_to_num(np.array(sizes), nan=np.inf, posinf=np.inf))


def _hull(*values: Any) -> Interval:
    """The smallest interval with all `values`; 0·∞ counts as 0,
    the limit of the products with a finite end.
    """
    finite = [np.where(np.isnan(v), 0.0, v) for v in values]
    return Interval(np.minimum.reduce(finite), np.maximum.reduce(finite))


def _multiply(a: Interval, b: Interval) -> Interval:
    if a is b:
        return _squared(a)
    return _hull(a.low * b.low, a.low * b.high, a.high * b.low, a.high * b.high)


def _squared(a: Interval) -> Interval:
    low, high = _hull(a.low * a.low, a.high * a.high)
    return Interval(np.where(_has_zero(a), 0.0, low), high)


def _has_zero(a: Interval) -> Any:
    return (np.asarray(a.low) <= 0) & (np.asarray(a.high) >= 0)


def _divide(a: Interval, b: Interval) -> Interval:
    low, high = _hull(1 / np.asarray(b.low), 1 / np.asarray(b.high))
    return _multiply(a, Interval(np.where(_has_zero(b), -np.inf, low), np.where(_has_zero(b), np.inf, high)))


def _power(a: Interval, exponent: float) -> Interval:
    """The powers a^p: defined for a ≥ 0, and for whole p everywhere except at 0 if p < 0."""
    low, high = np.float_power(a.low, exponent), np.float_power(a.high, exponent)
    least, most = np.fmin(low, high), np.fmax(low, high)
    whole = exponent == round(exponent)
    undefined = (_has_zero(a) & (exponent < 0)) | ((np.asarray(a.low) < 0) & (not whole))
    least = np.where(_has_zero(a) & (whole and exponent % 2 == 0), 0.0, least)
    return Interval(np.where(undefined, -np.inf, least), np.where(undefined, np.inf, most))


def _wave(a: Interval, value: Callable[[Any], Any], crest: float) -> Interval:
    """The values of sin or cos, whose maxima lie at `crest` + 2πn and whose minima lie half a
    period later.
    """
    low, high = _hull(value(a.low), value(a.high))

    def passes(place: float) -> Any:
        return np.floor((np.asarray(a.high) - place) / math.tau) >= np.ceil(
            (np.asarray(a.low) - place) / math.tau
        )

    return Interval(np.where(passes(crest + math.pi), -1.0, low), np.where(passes(crest), 1.0, high))


def _function(name: str, a: Interval) -> Interval:
    """An elementary function of an interval: monotone ones by their ends,
    others by what is known of their extrema.
    """
    value = FUNCTIONS[name].value
    if name in ("sin", "cos"):
        return _wave(a, value, math.pi / 2 if name == "sin" else 0.0)
    low, high = np.asarray(value(a.low)), np.asarray(value(a.high))
    ends = Interval(np.fmin(low, high), np.fmax(low, high))
    if name == "cosh":
        return Interval(np.where(_has_zero(a), 1.0, ends.low), ends.high)
    if name == "tan":
        pole = np.floor(np.asarray(a.low) / math.pi + 0.5) != np.floor(np.asarray(a.high) / math.pi + 0.5)
        return Interval(np.where(pole, -np.inf, ends.low), np.where(pole, np.inf, ends.high))
    if name in ("sinc", "sinc_slope"):  # |sinc| ≤ 1, and |sinc′| ≤ ½ by the mean of |x cos xτ| τ
        most = 1.0 if name == "sinc" else 0.5
        return Interval(np.full_like(low, -most), np.full_like(high, most))
    # The others are monotone. Outside their domain they are NaN.
    outside = np.isnan(low) | np.isnan(high)
    return Interval(np.where(outside, -np.inf, ends.low), np.where(outside, np.inf, ends.high))


def _select(condition: Any, a: Any, b: Any) -> Interval:
    either = _hull(a.low, b.low).low, _hull(a.high, b.high).high
    first, never = condition.always, np.logical_not(condition.ever)
    return Interval(
        *(np.where(first, x, np.where(never, y, z)) for x, y, z in zip(a, b, either, strict=True))
    )


_OPERATIONS: dict[str, Callable[..., Any]] = {
    **ARITHMETIC,
    "add": lambda a, b: Interval(a.low + b.low, a.high + b.high),
    "subtract": lambda a, b: Interval(a.low - b.high, a.high - b.low),
    "multiply": _multiply,
    "whole": _multiply,
    "divide": _divide,
    "negative": lambda a: Interval(-a.high, -a.low),
    "greater": lambda a, b: Truth(a.low > b.high, a.high > b.low),
    "greater_equal": lambda a, b: Truth(a.low >= b.high, a.high >= b.low),
    "equal": lambda a, b: Truth(
        (a.low == a.high) & (a.low == b.low) & (b.low == b.high), (a.low <= b.high) & (b.low <= a.high)
    ),
    "and": lambda a, b: Truth(a.always & b.always, a.ever & b.ever),
    "or": lambda a, b: Truth(a.always | b.always, a.ever | b.ever),
    "not": lambda a: Truth(np.logical_not(a.ever), np.logical_not(a.always)),
    "select": _select,
}
