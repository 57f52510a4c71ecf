"""Criteria that decide a statement, and the slopes that most of them use.

Each criterion has two bounds, one for "holds" and one for "fails". Between the two bounds the
verdict is "open".
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from sepv.record import EPS

# The verdict on a statement: it holds, it fails, or the measurement does not decide.
Verdict = Literal["holds", "fails", "open"]


def slope(x: ArrayLike, y: ArrayLike) -> float:
    """The least-squares slope of ln y against ln x."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def finest_slope(h: Sequence[float], errors: Sequence[float]) -> float:
    """The slope of ln error between the two finest h with errors above 10⁴ roundings of a state
    with |y| ≈ 1.
    """
    first, last = [n for n, e in enumerate(errors) if e > 1e4 * EPS][-2:]
    return float(np.log(errors[first] / errors[last]) / np.log(h[first] / h[last]))


def decide(true: bool, false: bool) -> Verdict:
    """The verdict on a statement: holds if `true`, fails if `false`, open if neither;
    they are never both true.
    """
    assert not (true and false)
    return "holds" if true else "fails" if false else "open"


def at_most(value: float, limit: float, refuted: float) -> Verdict:
    """The verdict on "the value is at most the limit"; it fails above `refuted`, a larger limit."""
    return decide(bool(value <= limit), bool(value > refuted))


def above(value: float, limit: float, refuted: float) -> Verdict:
    """The verdict on "the value is above the limit"; it fails below `refuted`, a smaller limit."""
    return decide(bool(value > limit), bool(value < refuted))


def near(value: float, target: float, within: float, refuted: float) -> Verdict:
    """The verdict on "the value is at most `within` from `target`";
    it fails beyond the distance `refuted`.
    """
    return decide(bool(abs(value - target) < within), bool(abs(value - target) > refuted))


def interval_near(low: float, high: float, target: float, within: float) -> Verdict:
    """The verdict on "the interval [low, high] lies in target ± within";
    it fails if they are disjoint.
    """
    inside = target - within < low and high < target + within
    return decide(inside, high < target - within or low > target + within)


def every(*verdicts: Verdict) -> Verdict:
    """The verdict on a statement of several parts: it holds if all parts hold,
    and fails if one part fails.
    """
    return decide(set(verdicts) <= {"holds"}, "fails" in verdicts)
