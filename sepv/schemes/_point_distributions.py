"""Increments with two or three values, which weak schemes may use in place of normal increments.

A weak order q needs only that the increments have the moments up to 2q + 1 of N(0, h) (G. N.
Milstein, Numerical Integration of Stochastic Differential Equations, 1995, §9; Kloeden and Platen
1992, §14.1-2):

    two points,   P(ΔW = ±√h) = ½:                       moments up to the third, weak order 1;
    three points, P(ΔW = ±√(3h)) = 1/6, P(ΔW = 0) = 2/3: moments up to the fifth, weak order 2.

Such increments are bounded, so that an implicit step needs no truncation. They are not increments
of a Wiener process, so that no scheme converges in mean square with them. Each increment √h ζ is
made from the normal increment √h ξ of the step: ζ is the quantile of its distribution at the
probability Φ(ξ). So the path with a given number uses the same random stream for all schemes, and E
ζξ is as large as possible: 0.80 for two points, 0.87 for three.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate

from sepv._arguments import did_you_mean
from sepv.errors import UsageError

# The largest error allowed in the sum of weights and in a moment: roundings of a few terms.
_ROUNDING = 1e-12
# The order of the highest moment that is compared with that of N(0, 1). A law of a few points
# matches fewer moments.
_COMPARED_MOMENTS = 24


@dataclass(frozen=True)
class PointLaw:
    """A distribution of a few points for increments ΔW = √h ζ,
    where ζ is values[i] with probability weights[i].

    Attributes
    ----------
    name : str
    values : increasing finite numbers, in units of √h
    weights : positive numbers of sum 1, one for each value

    Raises
    ------
    UsageError
        For values and weights that are not a distribution. Moments are not checked here: wrong
        moments make the laws about weak orders fail.
    """

    name: str
    values: Sequence[float]
    weights: Sequence[float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", tuple(float(v) for v in self.values))
        object.__setattr__(self, "weights", tuple(float(w) for w in self.weights))
        rising = all(a < b for a, b in zip(self.values, self.values[1:], strict=False))
        if not (
            self.values
            and len(self.values) == len(self.weights)
            and rising
            and all(map(math.isfinite, self.values))
            and all(w > 0 for w in self.weights)
            and abs(math.fsum(self.weights) - 1) < _ROUNDING
        ):
            raise UsageError(
                expected="increasing values, and as many positive weights of sum 1",
                received=f"values {self.values}, weights {self.weights}",
                remedy="such as PointLaw('two-point', (-1, 1), (0.5, 0.5)), in units of √h",
            )

    @cached_property
    def thresholds(self) -> tuple[float, ...]:
        """The values of the normal ξ at which ζ jumps to its next value:
        Φ⁻¹ of the partial sums of the weights.

        Sums are taken from the nearer end of the distribution, because Φ⁻¹ then loses fewer digits.
        """
        from statistics import NormalDist

        quantile = NormalDist().inv_cdf
        below = list(accumulate(self.weights))[:-1]
        above = list(accumulate(reversed(self.weights)))[-2::-1]
        return tuple(quantile(p) if p <= q else -quantile(q) for p, q in zip(below, above, strict=True))

    @property
    def bound(self) -> float:
        """The largest absolute value that ζ can have."""
        return max(abs(v) for v in self.values)

    @property
    def degree(self) -> int:
        """The largest k such that the moments 1 … k are those of N(0, 1):
        enough for a weak order (k − 1)/2.
        """
        for k in range(1, _COMPARED_MOMENTS):
            # For even k, E ξ^k = (k − 1)!!.
            wanted = 0.0 if k % 2 else float(math.prod(range(k - 1, 0, -2)))
            terms = [w * v**k for v, w in zip(self.values, self.weights, strict=True)]
            if abs(math.fsum(terms) - wanted) > _ROUNDING * max(1.0, math.fsum(map(abs, terms))):
                return k - 1
        return _COMPARED_MOMENTS - 1


TWO_POINT = PointLaw("two-point", (-1.0, 1.0), (0.5, 0.5))
THREE_POINT = PointLaw("three-point", (-math.sqrt(3.0), 0.0, math.sqrt(3.0)), (1 / 6, 2 / 3, 1 / 6))
LAW_OF_NAME = {law.name: law for law in (TWO_POINT, THREE_POINT)}
NORMAL = "normal"
POINT_LAWS = (NORMAL, *LAW_OF_NAME)


def point_law(increments: str | PointLaw | None) -> PointLaw | None:
    """The distribution with the name `increments`, or a given `PointLaw` unchanged;
    None for normal increments.

    Raises UsageError for an unknown name.
    """
    if increments is None or isinstance(increments, PointLaw):
        return increments
    name = str(increments).strip().replace("_", "-")
    if name != NORMAL and name not in LAW_OF_NAME:
        raise UsageError(
            expected=f"increments, one of {', '.join(POINT_LAWS)}, or a sepv.PointLaw",
            received=did_you_mean(name, POINT_LAWS),
            remedy="normal ones where paths matter, two- and three-point ones for weak orders 1 and 2",
        )
    return LAW_OF_NAME.get(name)
