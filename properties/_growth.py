"""The growth of errors with time, by an interval: bounded, as a random walk, linear or faster."""

from __future__ import annotations

import numpy as np

from sepv.problem import Array, Problem
from sepv.record import EPS
from sepv.statistics import jackknife_half

# The two-sided level of each interval.
LEVEL = 1e-3
# Exponents between 0, ½ and 1 are told apart half-way.
KINDS = (("bounded", 0.25), ("a random walk", 0.75), ("linear", 1.25), ("faster than linear", np.inf))


def exponent(times: Array, errors: Array) -> tuple[float, float]:
    """The slope of ln rms against ln t, errors (L, M) of M paths, and half its interval by a jackknife over paths.

    Where a few paths make the rms the interval is wide, and decides nothing.
    """
    squares = errors**2
    total, paths = squares.sum(axis=1), squares.shape[1]
    x = np.log(times) - np.mean(np.log(times))
    # A single path leaves an empty rest, without logarithm.
    with np.errstate(divide="ignore", invalid="ignore"):
        value = 0.5 * float(x @ np.log(total / paths)) / float(x @ x)
        half = jackknife_half(0.5 * (x @ np.log((total[:, None] - squares) / (paths - 1))) / (x @ x), LEVEL)
    return (value, half) if np.isfinite(value + half) else (0.0, np.inf)


def kind_of(value: float, half: float) -> str:
    """The one of KINDS in which the whole interval lies, or open."""
    edges = (-np.inf, *(edge for _, edge in KINDS))
    for (kind, high), low in zip(KINDS, edges, strict=False):
        if low < value - half and value + half < high:
            return kind
    return "open"


def grows(value: float, half: float) -> bool:
    """True if the interval of an exponent excludes a bounded error."""
    return value - half > KINDS[0][1]


def rounding_walk(problem: Problem, y: Array, steps: int) -> float:
    """The walk of H by rounding in `steps` steps of a scheme that keeps it, among states y (d, M).

    A step rounds the update of y, by half an ulp of each component, and leaves a residual of the same size: H moves by
    at most 2 eps (Σ|∂_iH y_i| + |H|). Signs are as good as random, so that by Azuma's inequality the walk exceeds
    8 eps √N of that with probability below 1e-3. Measured: 0.3 eps √N.
    """
    size = np.max(np.sum(np.abs(problem.gradient(y) * y), axis=0)) + np.max(np.abs(problem.hamiltonian(y)))
    return 8 * EPS * float(np.sqrt(steps)) * float(size)
