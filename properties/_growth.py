"""Classify the growth t^a of errors as bounded, a random walk, linear or faster,
by a confidence interval of a.
"""

from __future__ import annotations

import numpy as np

from sepv.problem import Array, Problem
from sepv.record import EPS
from sepv.statistics import jackknife_half

# GROWTH_LEVEL is the probability that the two-sided confidence interval of an exponent misses the
# exponent.
GROWTH_LEVEL = 1e-3
# GROWTH_KINDS of growth t^a, each with the upper end of its exponents a. The ends are half-way
# between 0, ½, 1 and 1½.
GROWTH_KINDS = (("bounded", 0.25), ("a random walk", 0.75), ("linear", 1.25), ("faster than linear", np.inf))


def exponent(times: Array, errors: Array) -> tuple[float, float]:
    """Return the slope of ln rms against ln t and the half-width of its confidence interval,
    by a jackknife over paths.

    `errors` (L, M) holds the errors of M paths at L times. If a few paths dominate the rms, the
    interval is wide.
    """
    squares = errors**2
    total, paths = squares.sum(axis=1), squares.shape[1]
    x = np.log(times) - np.mean(np.log(times))
    # With one path the jackknife leaves an empty sample, whose logarithm is not finite.
    with np.errstate(divide="ignore", invalid="ignore"):
        value = 0.5 * float(x @ np.log(total / paths)) / float(x @ x)
        half = jackknife_half(
            0.5 * (x @ np.log((total[:, None] - squares) / (paths - 1))) / (x @ x), GROWTH_LEVEL
        )
    return (value, half) if np.isfinite(value + half) else (0.0, np.inf)


def kind_of(value: float, half: float) -> str:
    """Return the kind of growth whose range of exponents contains the interval value ± half,
    or "open" if none does.
    """
    edges = (-np.inf, *(edge for _, edge in GROWTH_KINDS))
    for (kind, high), low in zip(GROWTH_KINDS, edges, strict=False):
        if low < value - half and value + half < high:
            return kind
    return "open"


def grows(value: float, half: float) -> bool:
    """True if the interval value ± half of an exponent excludes bounded errors."""
    return value - half > GROWTH_KINDS[0][1]


def rounding_walk(problem: Problem, y: Array, steps: int) -> float:
    """Bound the change of H that rounding causes over N = `steps` steps of a scheme that keeps H.
    y (d, M) are states.

    A step rounds each component of y by half an ulp, and its residual has the same size. So a step
    changes H by at most 2 eps S with S = Σ|∂_iH y_i| + |H|. If the signs of the changes are
    independent, Azuma's inequality bounds their sum by 8 eps √N S, except with probability below
    1e-3. Measured sums are about 0.3 eps √N S.
    """
    size = np.max(np.sum(np.abs(problem.gradient(y) * y), axis=0)) + np.max(np.abs(problem.hamiltonian(y)))
    return 8 * EPS * float(np.sqrt(steps)) * float(size)
