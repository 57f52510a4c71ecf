"""Quantiles of many numbers in little memory: counts in buckets whose edges are powers of γ.

The sketch of C. Masson, J. E. Rim and H. K. Lee, *DDSketch*, Proc. VLDB 12 (2019): with γ = (1 + α)/(1 − α) the
number x > 0 falls into bucket i = ⌈ln x / ln γ⌉, and 2γ^i/(γ + 1) is within α x of every x of that bucket. Counts are
integers, so sketches merge exactly, in any order; a t-digest depends on the order, and its error has no bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sepv.errors import UsageError
from sepv.record import TINY

# Relative error of a quantile. The counts of a normal variable then take some 100 kB, for any number of values.
ACCURACY = 1e-3
# ln γ, and the offset that makes every index positive.
_LOG_GAMMA = math.log1p(ACCURACY) - math.log1p(-ACCURACY)
_OFFSET = math.ceil(-math.log(TINY) / _LOG_GAMMA) + 2
# Numbers smaller than the smallest normal one count as 0.
_LARGEST = math.log(float(np.finfo(np.float64).max))


@dataclass(frozen=True)
class Sketch:
    """A sketch: counts (K,) by bucket.

    keys : (K,) int32, increasing: sign·(i + offset) with an offset that makes i positive, so that keys are ordered as
        the numbers are; 0 is 0
    """

    keys: NDArray[np.int32] = field(default_factory=lambda: np.empty(0, dtype=np.int32))
    counts: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    def merge(self, other: Sketch) -> Sketch:
        """The sketch of both samples together."""
        keys, place = np.unique(np.concatenate([self.keys, other.keys]), return_inverse=True)
        counts = np.zeros(keys.size, dtype=np.int64)
        np.add.at(counts, place, np.concatenate([self.counts, other.counts]))
        return Sketch(keys, counts)

    def quantile(self, p: float) -> float:
        """The number of rank ⌊p(n − 1)⌋ (from 0) in order of size, to within α of itself.

        A UsageError for p outside [0, 1], and where nothing was counted.
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
        return math.copysign(math.exp(min(size, _LARGEST)), key)


def sketch(values: Any) -> Sketch:
    """The sketch of finite numbers, (M,)."""
    numbers = np.asarray(values, dtype=np.float64)
    size = np.abs(numbers)
    index = np.ceil(np.log(np.maximum(size, TINY)) / _LOG_GAMMA).astype(np.int32) + _OFFSET
    keys, counts = np.unique(
        np.where(size < TINY, 0, np.where(numbers < 0, -index, index)).astype(np.int32), return_counts=True
    )
    return Sketch(keys, counts.astype(np.int64))
