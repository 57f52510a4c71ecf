"""Bounded increments: normal increments clipped as in Remark 2.1 of Cohen and Dujardin,
or increments of few values.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from sepv.errors import UsageError
from sepv.problem import Array
from sepv.schemes import PointLaw, point_law


def truncation_bound(h: float, k: int) -> float:
    """The bound A_h = √(2k|ln h|) of Remark 2.1 on |ΔW|/√h, for 0 < h < 1.

    Raises
    ------
    UsageError
        If k < 1 or h ≥ 1. For h ≥ 1, |ln h| does not measure how small h is, and h = 1 would set
        every increment to zero. Remark 2.1 assumes h < 1, and no other rule is used silently
        instead.
    """
    if not 0 < h < 1:
        raise UsageError(
            expected="0 < h < 1 for truncated increments (Remark 2.1)",
            received=f"h = {h!r}",
            remedy="a smaller step, or untruncated increments (truncation=None)",
        )
    if k != int(k) or k < 1:
        raise UsageError(
            expected="truncation k, an integer ≥ 1, or None", received=repr(k), remedy="the paper takes k = 2"
        )
    return math.sqrt(2 * k * abs(math.log(h)))


def truncate(dW: ArrayLike, h: float, k: int | None = 2, unit: float = 1.0) -> Array:
    """Truncate Wiener increments over a step h: ΔŴ = √h clip(ΔW/√h, ±A_h);
    for k = None return them unchanged.

    Parameters
    ----------
    dW : array_like of any shape
        Wiener increments of variance h.
    k : int, optional
        The k of A_h = √(2k|ln h|); 2 in the paper. The error is E[(ΔW − ΔŴ)²]
        ≤ h^(k+1)(1 + 2√(2k|ln h|)).
    unit : float, optional
        The time scale of the problem: A_h is computed from h/unit.
    """
    increments = np.asarray(dW, dtype=np.float64)
    if k is None:
        return increments
    bound = truncation_bound(h / unit, k) * math.sqrt(h)
    return np.clip(increments, -bound, bound)


def seen(
    dW: ArrayLike, h: float, k: int | None = 2, increments: str | PointLaw | None = None, unit: float = 1.0
) -> Array:
    """The increments that a scheme gets: truncated Wiener increments,
    or increments with few values.

    Parameters
    ----------
    dW : array_like of any shape
        Wiener increments of variance h.
    k : int, optional
        As for `truncate`. Only normal increments are truncated, because all others are bounded.
    unit : float, optional
        As for `truncate`.
    increments : "normal", "two-point", "three-point" or PointLaw, optional
        A PointLaw replaces each increment ΔW by √h times the law's quantile at the probability
        Φ(ΔW/√h).

    Examples
    --------
    >>> seen([-1.0, -0.1, 0.2, 2.0], 0.25, None, "two-point").tolist()
    [-0.5, -0.5, 0.5, 0.5]
    """
    law = point_law(increments)
    if law is None:
        return truncate(dW, h, k, unit)
    thresholds, values = points(h, law)
    return values[np.searchsorted(thresholds, np.asarray(dW, dtype=np.float64), side="right")]


def points(h: float, law: PointLaw | None) -> tuple[Array, Array]:
    """Thresholds of ΔW over a step h, and the values that replace ΔW between them;
    both are empty if `law` is None.
    """
    if law is None:
        return np.empty(0), np.empty(0)
    root = math.sqrt(h)
    return root * np.array(law.thresholds), root * np.array(law.values)
