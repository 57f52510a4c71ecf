"""Intervals for statistics of means over paths, by a jackknife over groups of paths."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sepv.statistics._quantiles import students_t

Array = NDArray[np.float64]

# The number of groups of paths for the jackknife. With more groups, each would have too few paths
# for a nearly normal mean square. With fewer, the t-quantile (here with 31 degrees of freedom)
# would be larger.
JACKKNIFE_GROUPS = 32


@dataclass(frozen=True)
class Estimate:
    """An estimate with a two-sided interval, value ± half,
    which misses the true value with probability alpha.
    """

    value: float
    half: float
    alpha: float

    @property
    def low(self) -> float:
        """The lower end of the interval."""
        return self.value - self.half

    @property
    def high(self) -> float:
        """The upper end of the interval."""
        return self.value + self.half


def jackknife(samples: Array, statistic: Callable[[Array], float], alpha: float) -> Estimate:
    """Estimate `statistic`, a function of the n means over paths of `samples` (n, paths),
    and its interval.

    The paths are divided into JACKKNIFE_GROUPS groups, and the statistic is computed again with
    each group left out in turn. The jackknife's interval is that of Student's t with
    JACKKNIFE_GROUPS − 1 degrees of freedom.
    """
    parts = np.array_split(samples, JACKKNIFE_GROUPS, axis=1)
    groups = np.stack([part.sum(axis=1) for part in parts])
    sizes = np.array([part.shape[1] for part in parts], dtype=np.float64)
    total, count = groups.sum(axis=0), sizes.sum()
    whole = float(statistic(total / count))
    left_out = [float(statistic((total - g) / (count - n))) for g, n in zip(groups, sizes, strict=True)]
    return Estimate(whole, jackknife_half(np.array(left_out), alpha), alpha)


def jackknife_half(left_out: Array, alpha: float) -> float:
    """Half the width of the interval of level 1 − alpha, from G values of a statistic,
    each with one group left out.

    The interval is that of Student's t with G − 1 degrees of freedom (R. G. Miller, Biometrika 61,
    1974).
    """
    groups = left_out.size
    error = np.sqrt((groups - 1) / groups * np.sum((left_out - left_out.mean()) ** 2))
    return float(students_t(alpha / 2, groups - 1) * error)
