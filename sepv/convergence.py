"""Strong errors against the exact flow, and slopes with intervals whose false-alarm rate is stated.

For one path all step sizes see the same Wiener process: increments of coarse steps are sums of those of
the finest grid, truncated at each step size as Remark 2.1 says; the exact solution sees W(T) untruncated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sepv import wiener
from sepv.exact_structures import ends as exact_ends
from sepv.exact_structures import finer
from sepv.implicit import Status
from sepv.problem import Array, Problem
from sepv.scheme import Scheme
from sepv.simulation import run_chunk

# Paths are split into this many groups for the jackknife: enough for a t-quantile with 31 degrees of
# freedom, few enough that the mean square over a group is nearly normal.
GROUPS = 32
# Errors below this many eps·scale are rounding, not order: such step sizes are left out.
FLOOR = 1e4
# Wide enough to hide what NumPy takes for a call: 1024 paths at once cost half of four times 256.
_CHUNK = 1024


@dataclass(frozen=True)
class StrongErrors:
    """Errors y_N − y(T) of M paths (L, d, M) for L numbers of steps, their squares |·|² (L, M), and failures.

    `failures` counts paths with a step that was not solved or left the domain, for each number of steps.
    `reference` is the rms error of a reference that is not exact, 0 where it is.
    """

    T: float
    steps: tuple[int, ...]
    squared: Array
    errors: Array
    failures: tuple[int, ...]
    scale: float
    floor: float = FLOOR
    reference: float = 0.0

    def rms(self) -> Array:
        """√E|y_N − y(T)|², (L,)."""
        return np.sqrt(np.mean(self.squared, axis=1))


@dataclass(frozen=True)
class Estimate:
    """value ± half-width: a two-sided interval that misses with probability alpha."""

    value: float
    half: float
    alpha: float

    @property
    def low(self) -> float:
        """Lower end."""
        return self.value - self.half

    @property
    def high(self) -> float:
        """Upper end."""
        return self.value + self.half


def strong_errors(
    scheme: Scheme, problem: Problem, *, T: float, steps: Sequence[int], paths: range, seed: int = 0
) -> StrongErrors:
    """Run the paths numbered `paths` with each number of steps, from the problem's initial state.

    Parameters
    ----------
    steps : increasing numbers of steps, each dividing the last.
    """
    start = np.array(problem.initial, dtype=np.float64)
    finest = steps[-1]
    squared = np.empty((len(steps), len(paths)))
    errors = np.empty((len(steps), problem.dimension, len(paths)))
    failures = np.zeros(len(steps), dtype=np.int64)
    largest, reference = float(np.max(np.abs(start))), 0.0
    for first in range(0, len(paths), _CHUNK):
        here = slice(first, min(first + _CHUNK, len(paths)))
        numbers = paths[here]
        fine = wiener.increments(seed, T=T, steps=finest, noises=problem.noises, paths=numbers)
        known = exact_ends(problem, start, T, fine.sum(axis=0))
        if known is None:
            fine, exact, apart = finer(problem, start, T, finest, numbers, seed)
            reference = max(reference, apart)
        else:
            exact = known
        largest = max(largest, float(np.max(np.abs(exact))))
        for row, count in enumerate(steps):
            raw = wiener.coarsen(fine, finest // count)
            result = run_chunk(scheme, problem, start, T / count, raw, scheme.truncation, track=False)
            failures[row] += np.count_nonzero(result.status != Status.CONVERGED)
            errors[row, :, here] = result.y - exact
            with np.errstate(over="ignore"):  # a path that blows up has an infinite error, and is no accident
                squared[row, here] = np.sum((result.y - exact) ** 2, axis=0)
    return StrongErrors(
        T, tuple(steps), squared, errors, tuple(int(f) for f in failures), largest, FLOOR, reference
    )


def join(parts: Sequence[StrongErrors]) -> StrongErrors:
    """The errors of all the paths of several runs over the same steps."""
    return StrongErrors(
        parts[0].T,
        parts[0].steps,
        np.concatenate([p.squared for p in parts], axis=1),
        np.concatenate([p.errors for p in parts], axis=2),
        tuple(int(n) for n in np.sum([p.failures for p in parts], axis=0)),
        max(p.scale for p in parts),
        parts[0].floor,
        max(p.reference for p in parts),
    )


def above_floor(errors: StrongErrors) -> np.ndarray:
    """Which step sizes have errors that are not rounding."""
    eps = float(np.finfo(np.float64).eps)
    return errors.rms() > errors.floor * eps * errors.scale


def slope(errors: StrongErrors, alpha: float) -> Estimate:
    """The mean-square order: the least-squares slope of log rms error against log h.

    Its interval is a jackknife over groups of paths: the errors of one path at several step sizes
    depend on each other, groups of paths do not.
    """
    kept = above_floor(errors)
    x = np.log(errors.T / np.array(errors.steps, dtype=np.float64))[kept]
    x = x - x.mean()
    weights = x / np.sum(x * x)
    return jackknife(errors.squared[kept], lambda mean: float(0.5 * (weights @ np.log(mean))), alpha)


def log_decay(errors: StrongErrors, alpha: float) -> Estimate:
    """ln(rms at the finest step / rms at the coarsest): 0 where the limit is another than the exact flow's."""
    ends = errors.squared[[0, -1]]
    return jackknife(ends, lambda mean: float(0.5 * np.log(mean[1] / mean[0])), alpha)


def weak_slope(errors: StrongErrors, alpha: float) -> Estimate:
    """The weak order for first moments: the weighted slope of log |E y_N − E y(T)| against log h.

    The squared norm of a sample mean is too large by its own variance, which is subtracted; where nothing is
    left it is taken at the noise. Step sizes count by how far they stand out of the noise (up to 100 times).
    """
    kept = above_floor(errors)
    x = np.log(errors.T / np.array(errors.steps, dtype=np.float64))[kept]
    values = errors.errors[kept]
    d, paths = values.shape[1:]

    def signal(mean: Array) -> tuple[Array, Array]:
        rows = mean.reshape(-1, d + 1)
        size = np.sum(rows[:, :d] ** 2, axis=1)
        noise = (rows[:, d] - size) / paths
        return np.maximum(size - noise, noise), noise

    samples = np.concatenate([values, np.sum(values**2, axis=1)[:, None]], axis=1).reshape(-1, paths)
    squared, noise = signal(samples.mean(axis=1))
    weights = np.minimum(squared / noise, 100.0)
    centred = x - np.sum(weights * x) / np.sum(weights)
    combination = weights * centred / np.sum(weights * centred**2)
    return jackknife(samples, lambda mean: float(0.5 * (combination @ np.log(signal(mean)[0]))), alpha)


def jackknife(samples: Array, statistic: Callable[[Array], float], alpha: float) -> Estimate:
    """statistic(mean over paths) with a delete-one-group interval, Student's t with GROUPS − 1 degrees."""
    from scipy.special import stdtrit

    parts = np.array_split(samples, GROUPS, axis=1)
    groups = np.stack([part.sum(axis=1) for part in parts])
    sizes = np.array([part.shape[1] for part in parts], dtype=np.float64)
    total, count = groups.sum(axis=0), sizes.sum()
    whole = float(statistic(total / count))
    left_out = np.array(
        [float(statistic((total - g) / (count - n))) for g, n in zip(groups, sizes, strict=True)]
    )
    error = float(np.sqrt((GROUPS - 1) / GROUPS * np.sum((left_out - left_out.mean()) ** 2)))
    return Estimate(whole, float(stdtrit(GROUPS - 1, 1 - alpha / 2)) * error, alpha)
