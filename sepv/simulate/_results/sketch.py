"""Quantiles of many numbers in little memory: counts in buckets whose edges are powers of γ.

The method is that of C. Masson, J. E. Rim and H. K. Lee, *DDSketch*, Proc. VLDB 12 (2019). For a
relative accuracy α and γ = (1 + α)/(1 − α), the number x > 0 falls into bucket i = ⌈ln x / ln γ⌉,
and 2γ^i/(γ + 1) is within α x of every x of that bucket. Counts are integers, so sketches merge
exactly and in any order. A t-digest, the usual alternative, depends on the order, and its error has
no bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sepv.errors import UsageError
from sepv.record import TINY

# The relative accuracy α of a quantile. The counts for a normal variable take about 100 kB for any
# number of values.
ACCURACY = 1e-3
# ln γ, and the offset that makes every index positive.
_LOG_GAMMA = math.log1p(ACCURACY) - math.log1p(-ACCURACY)
_OFFSET = math.ceil(-math.log(TINY) / _LOG_GAMMA) + 2
# The logarithm of the largest finite number. Numbers below TINY, the smallest normal number, count
# as 0.
_LOG_LARGEST = math.log(float(np.finfo(np.float64).max))


@dataclass(frozen=True)
class Sketch:
    """The counts (K,) of numbers in buckets with the keys (K,).

    keys : int32, increasing: sign·(i + offset) for bucket i, and 0 for the number 0. The offset
        makes every i + offset positive, so that keys are ordered as the numbers are.
    """

    keys: NDArray[np.int32] = field(default_factory=lambda: np.empty(0, dtype=np.int32))
    counts: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    def merge(self, other: Sketch) -> Sketch:
        """The sketch of the numbers of both sketches together."""
        keys, place = np.unique(np.concatenate([self.keys, other.keys]), return_inverse=True)
        counts = np.zeros(keys.size, dtype=np.int64)
        np.add.at(counts, place, np.concatenate([self.counts, other.counts]))
        return Sketch(keys, counts)

    def quantile(self, p: float) -> float:
        """The number of rank ⌊p(n − 1)⌋ (from 0) of all n numbers in order of size,
        with relative error α.

        Raise UsageError for p outside [0, 1], and if the sketch has counted no numbers.
        """
        if not 0 <= p <= 1 or not self.keys.size:
            raise UsageError(
                expected="p between 0 and 1, and at least one number",
                received=f"p = {p!r}, {int(self.counts.sum())} numbers",
                remedy="0.5 is the median",
            )
        upto = np.cumsum(self.counts)
        key = int(self.keys[np.searchsorted(upto, math.floor(p * (int(upto[-1]) - 1)), side="right")])
        if key == 0:
            return 0.0
        # 2γ^i/(γ + 1), with the power taken last so that it does not overflow.
        size = (abs(key) - _OFFSET) * _LOG_GAMMA - math.log1p(0.5 * math.expm1(_LOG_GAMMA))
        return math.copysign(math.exp(min(size, _LOG_LARGEST)), key)


def sketch(values: Any) -> Sketch:
    """The sketch of finite numbers `values` (M,), an array of NumPy or of a card;
    the counts are NumPy's.
    """
    size = np.abs(values)
    index = np.ceil(np.log(np.maximum(size, TINY)) / _LOG_GAMMA).astype(np.int32) + _OFFSET
    keys, counts = _counted(np.where(size < TINY, 0, np.where(values < 0, -index, index)))
    return Sketch(at_home(keys).astype(np.int32), at_home(counts).astype(np.int64))


def _counted(keys: Any) -> tuple[Any, Any]:
    """The different keys in order, and how often each occurs: by a table if they are many,
    else by sorting.
    """
    lowest, highest = (int(keys.min()), int(keys.max())) if keys.size else (0, 0)
    if keys.size < highest - lowest:
        return tuple(np.unique(keys, return_counts=True))  # type: ignore[return-value]
    counts = np.bincount(keys - lowest)
    there = np.flatnonzero(counts)
    return there + lowest, counts[there]


def at_home(array: Any) -> Any:
    """NumPy's array of an array's numbers; CuPy's arrays give theirs by the method `get`."""
    return array.get() if hasattr(array, "get") else array
