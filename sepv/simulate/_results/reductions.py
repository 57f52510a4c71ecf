"""Moments and quantiles of functionals of paths, computed for each chunk and merged in the order of
the chunks.

Central moments of two samples are merged as in P. Pébay, *Formulas for robust, one-pass parallel
computation of covariances and arbitrary-order statistical moments*, SAND2008-6212. Because of the
fixed order of merging, results have the same bits for any workers. Chunks of another size give
other roundings.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sepv.errors import UsageError
from sepv.simulate._results.sketch import Sketch, sketch

# The fewest values with which a target can be reached: the standard error of few values may be
# small by chance.
TARGET_MIN_VALUES = 1024

Functionals = Mapping[str, Callable[[Any], Any]]


@dataclass(frozen=True)
class Summary:
    """Moments and quantiles of the values of a functional over many paths.

    Attributes
    ----------
    count : int
        The number of values in the summary.
    mean : float
    sums : (3,) of float
        Σ(x − mean)ᵏ for k = 2, 3, 4.
    minimum, maximum : float
    failed : int
        The number of paths left out because a step was not solved; the other fields describe the
        remaining paths.
    not_finite : int
        The number of paths left out because their value is not finite, although all their steps
        were solved.
    """

    count: int = 0
    mean: float = 0.0
    sums: tuple[float, float, float] = (0.0, 0.0, 0.0)
    minimum: float = math.inf
    maximum: float = -math.inf
    failed: int = 0
    not_finite: int = 0
    sketch: Sketch = field(default_factory=Sketch, repr=False)

    @property
    def variance(self) -> float:
        """The unbiased variance; NaN for fewer than two values."""
        return self.sums[0] / (self.count - 1) if self.count > 1 else math.nan

    @property
    def standard_error(self) -> float:
        """The standard error of the mean, estimated; NaN for fewer than two values."""
        return math.sqrt(self.variance / self.count) if self.count > 1 else math.nan

    @property
    def skewness(self) -> float:
        """The third standardised moment; NaN if all values are equal."""
        return self._standardised(1, 1.5)

    @property
    def kurtosis(self) -> float:
        """The fourth standardised moment, 3 for a normal variable; NaN if all values are equal."""
        return self._standardised(2, 2.0)

    def _standardised(self, which: int, power: float) -> float:
        if not self.sums[0] > 0:
            return math.nan
        return self.sums[which] / self.count / math.pow(self.sums[0] / self.count, power)

    def quantile(self, p: float) -> float:
        """The value of rank ⌊p(count − 1)⌋ (from 0), with a relative error of 1e-3;
        exact for p = 0 and p = 1.
        """
        if p in (0, 1) and self.count:
            return self.maximum if p else self.minimum
        return min(max(self.sketch.quantile(p), self.minimum), self.maximum)

    def merge(self, other: Summary) -> Summary:
        """The summary of the values of both summaries together."""
        left = {"failed": self.failed + other.failed, "not_finite": self.not_finite + other.not_finite}
        if not self.count or not other.count:
            whole = self if self.count else other
            return Summary(
                whole.count, whole.mean, whole.sums, whole.minimum, whole.maximum, sketch=whole.sketch, **left
            )
        a, b, n = float(self.count), float(other.count), float(self.count + other.count)
        (p2, p3, p4), (q2, q3, q4) = self.sums, other.sums
        d = other.mean - self.mean
        dn = d / n
        s2 = p2 + q2 + d * dn * a * b
        s3 = p3 + q3 + d * dn * dn * a * b * (a - b) + 3 * dn * (a * q2 - b * p2)
        s4 = (
            p4 + q4
            + d * dn * dn * dn * a * b * (a * a - a * b + b * b)
            + 6 * dn * dn * (a * a * q2 + b * b * p2)
            + 4 * dn * (a * q3 - b * p3)
        )  # fmt: skip
        return Summary(
            self.count + other.count, self.mean + dn * b, (s2, s3, s4), min(self.minimum, other.minimum),
            max(self.maximum, other.maximum), sketch=self.sketch.merge(other.sketch), **left,
        )  # fmt: skip


def summary(values: Any, status: Any) -> Summary:
    """Summarise the values (M,) of a functional over one chunk of M paths with the status codes
    `status` (M,).

    The arrays may be those of a card (CuPy): NumPy's functions then run there, and only the summary
    comes back.
    """
    got_through = status == 0
    finite = np.isfinite(values)
    kept = values[got_through & finite]
    failed, not_finite = int(np.count_nonzero(~got_through)), int(np.count_nonzero(got_through & ~finite))
    if not kept.size:
        return Summary(failed=failed, not_finite=not_finite)
    with np.errstate(over="ignore", invalid="ignore"):  # sums that overflow are inf or NaN, which is reported
        mean = float(np.mean(kept))
        gap = kept - mean
        square = gap * gap
        sums = (float(np.sum(square)), float(np.sum(square * gap)), float(np.sum(square * square)))
    return Summary(
        kept.size, mean, sums, float(kept.min()), float(kept.max()), failed, not_finite, sketch(kept)
    )


def reduce_chunk(functionals: Functionals, chunk: Any) -> dict[str, Summary]:
    """Summarise each functional over a chunk, which is an `Ensemble`.

    Raise UsageError if a functional does not give one number for each path.
    """
    found = {}
    paths = chunk.status.size
    for name, functional in functionals.items():
        values = functional(chunk)
        if not hasattr(values, "dtype"):
            values = np.asarray(values)
        if values.shape != (paths,) or values.dtype.kind not in "fiub":
            raise UsageError(
                expected=f"one real number for each path from the functional {name!r}: shape ({paths},)",
                received=f"shape {values.shape}, {values.dtype}",
                remedy="a function of the chunk's ensemble, such as lambda ends: ends.y[0]",
            )
        found[name] = summary(values.astype(np.float64), chunk.status)
    return found


def validate(reduce: Any, until: Any) -> None:
    """Raise UsageError if `reduce` is no mapping of functionals,
    or `until` no mapping of target standard errors.
    """
    if not isinstance(reduce, Mapping) or not reduce or not all(callable(f) for f in reduce.values()):
        raise UsageError(
            expected="reduce: functionals by name",
            received=f"{reduce!r:.120}",
            remedy="such as {'q': lambda ends: ends.y[0]}",
        )
    targets = until or {}
    if not isinstance(targets, Mapping) or not all(
        name in reduce and isinstance(t, (int, float)) and t > 0 for name, t in targets.items()
    ):
        raise UsageError(
            expected=f"until: a standard error > 0 for functionals among {', '.join(reduce)}",
            received=f"{until!r:.120}",
            remedy="such as {'q': 1e-3}",
        )


def reached(reduced: Mapping[str, Summary], until: Mapping[str, float]) -> bool:
    """True if the mean of every functional in `until` has a standard error of at most its target.

    With this stopping rule the usual confidence interval keeps its level as the target goes to 0
    (Y. S. Chow and H. Robbins, Ann. Math. Statist. 36, 1965). For a finite target, its level is a
    little lower. At least `TARGET_MIN_VALUES` values are required, so that chance does not stop a
    run early.
    """
    return all(
        reduced[name].count >= TARGET_MIN_VALUES and reduced[name].standard_error <= target
        for name, target in until.items()
    )
