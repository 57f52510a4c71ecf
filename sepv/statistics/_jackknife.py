"""Intervals for statistics of means over paths, by a jackknife over groups of paths."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sepv.statistics._quantiles import students_t

Array = NDArray[np.float64]

# The number of groups of paths for the jackknife. More groups would have too few paths for a mean square over a group
# that is nearly normal; fewer would have a larger t-quantile (here with 31 degrees of freedom).
GROUPS = 32


@dataclass(frozen=True)
class Estimate:
    """An estimate with a two-sided interval, value ± half, which misses the true value with probability alpha."""

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
    """Estimate a statistic of n means over paths, the means of samples (n, paths), with an interval by the jackknife.

    The statistic is computed without each of GROUPS groups of paths in turn. Student's t with GROUPS − 1 degrees of
    freedom gives the interval.
    """
    parts = np.array_split(samples, GROUPS, axis=1)
    groups = np.stack([part.sum(axis=1) for part in parts])
    sizes = np.array([part.shape[1] for part in parts], dtype=np.float64)
    total, count = groups.sum(axis=0), sizes.sum()
    whole = float(statistic(total / count))
    left_out = [float(statistic((total - g) / (count - n))) for g, n in zip(groups, sizes, strict=True)]
    return Estimate(whole, jackknife_half(np.array(left_out), alpha), alpha)


def jackknife_half(left_out: Array, alpha: float) -> float:
    """Half the width of the interval of level 1 − alpha, from values (G,) of a statistic without each of G groups.

    The interval is that of Student's t with G − 1 degrees of freedom (R. G. Miller, Biometrika 61, 1974).
    """
    groups = left_out.size
    error = np.sqrt((groups - 1) / groups * np.sum((left_out - left_out.mean()) ** 2))
    return float(students_t(alpha / 2, groups - 1) * error)
