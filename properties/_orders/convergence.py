"""Strong errors of paths against the exact solution, and their slopes with confidence intervals of
a given level.

On one path all step sizes use the same Wiener process: increments of coarse steps are sums of
increments of the finest grid, truncated at each step size as in Remark 2.1. If the exact solution
is a function of W(T), such as the flow φ at the time θ = T + Σ_j c_j W_j(T), it is evaluated at the
sum Ŵ(T) of the truncated increments that the scheme gets:

    y_N − φ_θ(y0) = (y_N − φ_θ̂(y0)) + (φ_θ̂(y0) − φ_θ(y0)),    θ̂ = T + Σ_j c_j Ŵ_j(T).

The first bracket is the scheme's error and is sampled. The second is the error of truncation, equal
for all schemes. Its rms is known (`sepv.exact.clipping_error`) and of order k/2, and the law
"truncation" demands k ≥ 2p. If both brackets have order p, so has their sum. A reference with finer
steps gets the increments untruncated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from sepv.properties._failed_step import failed_step
from sepv.properties._orders.several_fields import ends as exact_ends
from sepv.properties._orders.several_fields import refined

from sepv.core.newton import Status
from sepv.problem import Array, Problem, column
from sepv.record import EPS
from sepv.schemes import Scheme, order_of
from sepv.simulate import Ensemble, Watch, areas, run_chunk, seen, wiener
from sepv.statistics import Estimate, binomial, jackknife

# Errors below SAMPLED_FLOOR·eps·scale count as rounding, and their step sizes are left out.
SAMPLED_FLOOR = 1e4
# The quantile of errors that is judged. It is above the median, because with few steps the median
# is small beside the root mean square, and low enough for a confidence interval from some hundred
# paths.
JUDGED_QUANTILE = 0.8
# The number of paths computed together. It hides NumPy's cost of a call: 1024 paths cost half of
# four times 256 paths.
_SAMPLED_CHUNK = 1024


@dataclass(frozen=True)
class StrongErrors:
    """Errors y_N − y(T) (L, d, M) of M paths for L numbers of steps, their squares |·|² (L, M),
    and failures.

    `failures` counts paths with a step that was not solved or left the domain, for the smallest
    number of steps with such paths. Paths with more steps may then be missing (errors NaN).
    `reference` is the rms error of a reference that is not exact, else 0.
    `sepv.properties._orders.means` needs y(T) as `ends` (L, d, M), W(T) as `W` (L, m, M), and the
    likelihood ratios `weights` (L, M), by which `squared` and `errors` are already multiplied. If
    means are not used, these arrays are empty. `tolerance` is that of the scheme's solver, and
    `failed` describes the first step that failed.
    """

    T: float
    steps: tuple[int, ...]
    squared: Array
    errors: Array
    failures: tuple[int, ...]
    scale: float
    floor: float = SAMPLED_FLOOR
    reference: float = 0.0
    ends: Array = field(default_factory=lambda: np.empty(0))
    W: Array = field(default_factory=lambda: np.empty(0))
    weights: Array = field(default_factory=lambda: np.empty(0))
    tolerance: float = 0.0
    failed: str = ""

    @property
    def h(self) -> Array:
        """The step sizes T/N, (L,)."""
        return self.T / np.array(self.steps, dtype=np.float64)

    def rms(self) -> Array:
        """The rms errors √E|y_N − y(T)|², (L,)."""
        return np.sqrt(np.mean(self.squared, axis=1))


# A function of a range of path numbers. For each number of steps it yields increments (N, m + k, M)
# as the scheme gets them, y(T), W(T) and weights.
Draw = Callable[[range], Iterable[tuple[Array, Array, Array, Array]]]


def strong_errors(
    scheme: Scheme,
    problem: Problem,
    *,
    T: float,
    steps: Sequence[int],
    paths: range,
    seed: int = 0,
    unit: float = 1.0,
    watch: Watch | None = None,
) -> StrongErrors:
    """Return errors of the paths numbered `paths`, from the initial state,
    for increasing `steps` that divide the last.

    `unit` is the unit of time of h in the truncation bound A_h of Remark 2.1. `watch` sees each
    step.
    """
    start, finest, noises = np.array(problem.initial, dtype=np.float64), steps[-1], problem.noises
    reference = 0.0

    def draw(numbers: range) -> Iterator[tuple[Array, Array, Array, Array]]:
        nonlocal reference
        fine = wiener.increments(seed, T=T, steps=finest, noises=noises, paths=numbers)
        exact, rough = exact_ends(problem, start, T, fine.sum(axis=0)), None
        known = exact is not None
        if not known:
            order = order_of(scheme.mean_square_order, column(problem))
            rough, exact, apart = refined(problem, start, T, finest, numbers, seed, order, scheme.asks)
            fine, reference = rough.coarse(finest).dW, max(reference, apart)
        if scheme.asks and rough is None:
            rough = areas.drawn(seed, T=T, steps=areas.FINE_STEPS * finest, noises=noises, paths=numbers)
            fine = rough.coarse(finest).dW
        W, ones = fine.sum(axis=0), np.ones(len(numbers))
        for count in steps:
            raw = rough.rows(count, scheme.asks) if rough else wiener.coarsen(fine, finest // count)
            used = clipped(scheme, raw, T / count, noises, unit)
            if known and scheme.truncation is not None:
                W = used[:, :noises].sum(axis=0)
                exact = exact_ends(problem, start, T, W)
            assert exact is not None
            yield used, exact, W, ones

    found = errors_of(scheme, problem, T, steps, paths, _SAMPLED_CHUNK, draw, watch)
    return replace(found, reference=reference)


def errors_of(
    scheme: Scheme, problem: Problem, T: float, steps: Sequence[int], paths: range, chunk: int, draw: Draw,
    watch: Watch | None = None,
) -> StrongErrors:  # fmt: skip
    """Return the errors of the paths numbered `paths`, run in chunks,
    with the increments and weights of `draw`.
    """
    start, shape = np.array(problem.initial, dtype=np.float64), (len(steps), len(paths))
    squared, weights = np.full(shape, np.nan), np.full(shape, np.nan)
    errors, ends, W = (
        np.full((shape[0], n, shape[1]), np.nan) for n in (start.size, start.size, problem.noises)
    )
    failures = np.zeros(len(steps), dtype=np.int64)
    largest, failed = float(np.max(np.abs(start))), ""
    for first in range(0, len(paths), chunk):
        here = slice(first, min(first + chunk, len(paths)))
        for row, (used, exact, end, ratio) in enumerate(draw(paths[here])):
            h = T / steps[row]
            largest = max(largest, float(np.max(np.abs(exact))))
            ends[row, :, here], W[row, :, here], weights[row, here] = exact, end, ratio
            result = run_chunk(scheme, problem, start, h, used, None, track=False, watch=watch)
            failures[row] += np.count_nonzero(result.status != Status.CONVERGED)
            failed = failed or failed_path(scheme, problem, result, h, used, paths[here])
            with np.errstate(over="ignore"):  # a path that blows up has an infinite error
                errors[row, :, here] = ratio * (result.y - exact)
                squared[row, here] = ratio * np.sum((result.y - exact) ** 2, axis=0)
            if failures[row]:
                break
    # Only failures at the first number of steps with failures count, because with more steps not
    # all paths were run.
    where = np.flatnonzero(failures)[:1]
    counted = tuple(int(n) if row in where else 0 for row, n in enumerate(failures))
    return StrongErrors(
        T, tuple(steps), squared, errors, counted, largest, ends=ends, W=W, weights=weights,
        tolerance=scheme.precision, failed=failed,
    )  # fmt: skip


def clipped(scheme: Scheme, raw: Array, h: float, noises: int, unit: float) -> Array:
    """Return the rows (N, m + k, M) that the scheme gets: m = `noises` truncated increments,
    and k unchanged rows.
    """
    used = seen(raw[:, :noises], h, scheme.truncation, scheme.increments, unit)
    return np.concatenate([used, raw[:, noises:]], axis=1)


def failed_path(
    scheme: Scheme, problem: Problem, result: Ensemble, h: float, used: Array, paths: range
) -> str:
    """Describe the failed step of the first failed path, or return "". `used` (N, m + k, M)
    is what the scheme got.
    """
    k = int(np.argmax(result.status != Status.CONVERGED))
    if result.status[k] == Status.CONVERGED:
        return ""
    n = int(result.failed_step[k])
    where = failed_step(scheme, problem, result.y[:, k], h, used[n, :, k])
    return f"path {paths[k]} in step {n + 1} of {len(used)}, {where}"


# Fields of StrongErrors with an entry for each path.
PER_PATH = ("squared", "errors", "ends", "W", "weights")


def join(parts: Sequence[StrongErrors]) -> StrongErrors:
    """Join the errors of several runs with the same numbers of steps and different paths."""
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(p, name) for p in parts], axis=-1) for name in PER_PATH
    }
    joined["failures"] = tuple(int(n) for n in np.sum([p.failures for p in parts], axis=0))
    joined |= {name: max(getattr(p, name) for p in parts) for name in ("scale", "reference")}
    return replace(parts[0], **joined, failed=next((p.failed for p in parts if p.failed), ""))


def first(errors: StrongErrors, paths: int) -> StrongErrors:
    """Return the errors of the first `paths` paths; `failures` and `scale` remain those of all
    paths.
    """
    return replace(errors, **{name: getattr(errors, name)[..., :paths] for name in PER_PATH})


def floors(errors: StrongErrors) -> Array:
    """Return the size (L,) of errors by rounding and by the stated tolerance of the scheme's solver
    after N steps.
    """
    return errors.scale * (errors.floor * EPS + np.array(errors.steps) * errors.tolerance)


def above_floor(errors: StrongErrors) -> np.ndarray:
    """Return an array (L,) that is True for the step sizes at which the rms error is above
    rounding.
    """
    return errors.rms() > floors(errors)


def slope(errors: StrongErrors, alpha: float) -> Estimate:
    """Estimate the mean-square order as the least-squares slope of log rms error against log h.

    The interval is from a jackknife over groups of paths, because errors of one path at several
    step sizes depend on each other, but errors of different paths do not.
    """
    kept = above_floor(errors)
    x = np.log(errors.h)[kept]
    x = x - x.mean()
    weights = x / np.sum(x * x)
    # If one group of paths causes the whole error, the other groups have only rounding, which is
    # replaced by `least`.
    least = floors(errors)[kept] ** 2
    return jackknife(
        errors.squared[kept], lambda mean: float(0.5 * (weights @ np.log(np.maximum(mean, least)))), alpha
    )


def quantile_slope(errors: StrongErrors, alpha: float) -> Estimate:
    """Estimate the order at which the JUDGED_QUANTILE of |e| falls,
    over the step sizes with errors above rounding.

    If E|e_h|² ≤ (C h^p)², Chebyshev's inequality bounds every quantile of |e_h| by C' h^p. So a
    quantile that falls more slowly refutes the order p. The interval does not depend on the tails:
    the number of paths with |e| below the quantile is binomial, so order statistics enclose the
    quantile with a known probability for every distribution (Clopper and Pearson 1934). Each of the
    four ends (two at the coarsest step, two at the finest) gets alpha/4.
    """
    kept = np.flatnonzero(above_floor(errors))
    ordered = np.sort(errors.squared[[kept[0], kept[-1]]], axis=1)
    paths = ordered.shape[1]
    low = binomial(alpha / 4, paths, JUDGED_QUANTILE) - 1
    high = binomial(1 - alpha / 4, paths, JUDGED_QUANTILE)
    span = 2 * np.log(errors.steps[kept[-1]] / errors.steps[kept[0]])
    if low < 0 or high >= paths or np.any(ordered[:, low] <= floors(errors)[kept[[0, -1]]] ** 2):
        return Estimate(
            0.0, np.inf, alpha
        )  # with too few paths, or a quantile at the rounding floor, the fall is not visible
    (c_low, c_high), (f_low, f_high) = np.log(ordered[:, [low, high]])
    ends = np.array([c_low - f_high, c_high - f_low]) / span
    return Estimate(float(ends.mean()), float(np.ptp(ends)) / 2, alpha)


def mean_square_order(
    errors: StrongErrors, alpha: float, *, more: float = 1.0, weighted: bool = False
) -> tuple[float, float, float]:
    """Estimate the mean-square order (value, low, high) by the slope of the rms error,
    checked by that of a quantile.

    If errors have heavy tails, most samples underestimate the rms error and its interval. So `high`
    is the larger upper end of both slopes' intervals. If an order holds, the quantile's interval
    lies below it by chance with a probability of at most alpha/2, whatever the tails. `low` is the
    larger of two minima: min(rms interval's lower end, quantile interval's upper end) and
    min(quantile interval's lower end, slope of the rms error).

    Intervals are as if there were `more` times the paths. Errors that are `weighted` come from
    `sepv.properties._orders.tilting` and have light tails. For these no quantile is used.
    """
    rms = slope(errors, alpha if weighted else alpha / 2)
    half = rms.half / np.sqrt(more)
    if weighted:
        return rms.value, rms.value - half, rms.value + half
    bulk = quantile_slope(errors, alpha / 2)
    reach = bulk.half / np.sqrt(more)
    low = max(min(rms.value - half, bulk.value + reach), min(bulk.value - reach, rms.value))
    return rms.value, low, max(rms.value + half, bulk.value + reach)
