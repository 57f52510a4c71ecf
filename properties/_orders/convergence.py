"""Strong errors against the exact flow, and slopes with intervals whose false-alarm rate is stated.

For one path all step sizes see the same Wiener process: increments of coarse steps are sums of those of
the finest grid, truncated at each step size as Remark 2.1 says. Where the exact solution is a function of W(T) it is
taken at the sum Ŵ(T) of the increments that the scheme saw:

    y_N − φ_θ(y0) = (y_N − φ_θ̂(y0)) + (φ_θ̂(y0) − φ_θ(y0)),    θ̂ = T + Σ_j c_j Ŵ_j(T).

The first bracket is the scheme's error and is sampled. The second is the clip's, the same for every scheme: its rms is
known (`sepv.exact.clipping_error`), of order k/2, and the law "truncation" says that k ≥ 2p. Together they have order p
where both have. A reference with finer steps sees the increments untruncated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from sepv.properties._failed_step import failed_step
from sepv.properties._orders.several_fields import ends as exact_ends
from sepv.properties._orders.several_fields import finer, refined

from sepv.problem import Array, HamiltoniansProblem, Problem
from sepv.record import EPS
from sepv.schemes import Scheme
from sepv.simulate import Ensemble, areas, run_chunk, seen, wiener
from sepv.solve import Status
from sepv.statistics import Estimate, binomial, jackknife

# Errors below this many eps·scale are rounding: such step sizes are left out.
FLOOR = 1e4
# The quantile of errors that is judged: high enough to see the bulk of the errors of few steps, whose median is small
# beside their mean square, low enough for an interval of it from some hundred paths.
QUANTILE = 0.8
# Wide enough to hide NumPy's cost of a call: 1024 paths at once cost half of four times 256.
_CHUNK = 1024


@dataclass(frozen=True)
class StrongErrors:
    """Errors y_N − y(T) of M paths (L, d, M) for L numbers of steps, their squares |·|² (L, M), and failures.

    `failures` counts paths with a step that was not solved or left the domain, for the smallest number of steps where
    there are any. Then paths with more steps need not have been run, and have no errors (NaN). `reference` is the rms
    error of a reference that is not exact, else 0. `ends` (L, d, M) and `W` (L, m, M) are y(T) and W(T), `weights`
    (L, M) the likelihood ratios that `squared` and `errors` already carry: `sepv.properties._orders.means` needs
    them, and they are empty if it is not used. `tolerance` is that of the scheme's own solver, `failed` the first
    step of a path that failed, in words.
    """

    T: float
    steps: tuple[int, ...]
    squared: Array
    errors: Array
    failures: tuple[int, ...]
    scale: float
    floor: float = FLOOR
    reference: float = 0.0
    ends: Array = field(default_factory=lambda: np.empty(0))
    W: Array = field(default_factory=lambda: np.empty(0))
    weights: Array = field(default_factory=lambda: np.empty(0))
    tolerance: float = 0.0
    failed: str = ""

    @property
    def h(self) -> Array:
        """The step sizes (L,)."""
        return self.T / np.array(self.steps, dtype=np.float64)

    def rms(self) -> Array:
        """The rms errors √E|y_N − y(T)|², (L,)."""
        return np.sqrt(np.mean(self.squared, axis=1))


# A draw of given paths yields for each number of steps: increments (N, m + k, M) as the scheme gets them, y(T), W(T)
# and weights.
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
) -> StrongErrors:
    """Run the paths numbered `paths` from the problem's initial state, with increasing `steps` that divide the last.

    `unit` is the time in which A_h of Remark 2.1 measures h.
    """
    start, finest, noises = np.array(problem.initial, dtype=np.float64), steps[-1], problem.noises
    reference = 0.0

    def draw(numbers: range) -> Iterator[tuple[Array, Array, Array, Array]]:
        nonlocal reference
        fine = wiener.increments(seed, T=T, steps=finest, noises=noises, paths=numbers)
        exact, rough = exact_ends(problem, start, T, fine.sum(axis=0)), None
        known = exact is not None
        if not known and isinstance(problem, HamiltoniansProblem):
            rough, exact, apart = refined(problem, start, T, finest, numbers, seed)
            fine, reference = rough.coarse(finest).dW, max(reference, apart)
        elif not known:
            fine, exact, apart = finer(problem, start, T, finest, numbers, seed)
            reference = max(reference, apart)
        if scheme.asks and rough is None:
            rough = areas.drawn(seed, T=T, steps=areas.MORE * finest, noises=noises, paths=numbers)
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

    found = errors_of(scheme, problem, T, steps, paths, _CHUNK, draw)
    return replace(found, reference=reference)


def errors_of(
    scheme: Scheme, problem: Problem, T: float, steps: Sequence[int], paths: range, chunk: int, draw: Draw
) -> StrongErrors:
    """The errors of the paths numbered `paths`, run in chunks, with the weights that are drawn with them."""
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
            result = run_chunk(scheme, problem, start, h, used, None, track=False)
            failures[row] += np.count_nonzero(result.status != Status.CONVERGED)
            failed = failed or failed_path(scheme, problem, result, h, used, paths[here])
            with np.errstate(over="ignore"):  # a path that blows up has an infinite error
                errors[row, :, here] = ratio * (result.y - exact)
                squared[row, here] = ratio * np.sum((result.y - exact) ** 2, axis=0)
            if failures[row]:
                break
    # The first number of steps with failures; with more steps not all paths were run.
    where = np.flatnonzero(failures)[:1]
    counted = tuple(int(n) if row in where else 0 for row, n in enumerate(failures))
    return StrongErrors(
        T, tuple(steps), squared, errors, counted, largest, ends=ends, W=W, weights=weights,
        tolerance=scheme.precision, failed=failed,
    )  # fmt: skip


def clipped(scheme: Scheme, raw: Array, h: float, noises: int, unit: float) -> Array:
    """Increments (N, m + k, M) as the scheme gets them: the first m truncated with its k, in units of time."""
    used = seen(raw[:, :noises], h, scheme.truncation, scheme.increments, unit)
    return np.concatenate([used, raw[:, noises:]], axis=1)


def failed_path(
    scheme: Scheme, problem: Problem, result: Ensemble, h: float, used: Array, paths: range
) -> str:
    """Describe the failed step of the first failed path; empty if none failed. `used` is (N, m + k, M)."""
    k = int(np.argmax(result.status != Status.CONVERGED))
    if result.status[k] == Status.CONVERGED:
        return ""
    n = int(result.failed_step[k])
    where = failed_step(scheme, problem, result.y[:, k], h, used[n, :, k])
    return f"path {paths[k]} in step {n + 1} of {len(used)}, {where}"


# Fields with an entry for each path.
PER_PATH = ("squared", "errors", "ends", "W", "weights")


def join(parts: Sequence[StrongErrors]) -> StrongErrors:
    """The errors of all the paths of several runs over the same steps."""
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(p, name) for p in parts], axis=-1) for name in PER_PATH
    }
    joined["failures"] = tuple(int(n) for n in np.sum([p.failures for p in parts], axis=0))
    joined |= {name: max(getattr(p, name) for p in parts) for name in ("scale", "reference")}
    return replace(parts[0], **joined, failed=next((p.failed for p in parts if p.failed), ""))


def first(errors: StrongErrors, paths: int) -> StrongErrors:
    """The errors of the first paths; `failures` and `scale` stay those of all."""
    return replace(errors, **{name: getattr(errors, name)[..., :paths] for name in PER_PATH})


def floors(errors: StrongErrors) -> Array:
    """Errors below these, (L,), are rounding, or the scheme's stated solver error after N steps."""
    return errors.scale * (errors.floor * EPS + np.array(errors.steps) * errors.tolerance)


def above_floor(errors: StrongErrors) -> np.ndarray:
    """True for step sizes with errors that are not rounding."""
    return errors.rms() > floors(errors)


def slope(errors: StrongErrors, alpha: float) -> Estimate:
    """The mean-square order: the least-squares slope of log rms error against log h.

    The interval is a jackknife over groups of paths: the errors of one path at several step sizes depend on each other,
    groups of paths do not.
    """
    kept = above_floor(errors)
    x = np.log(errors.h)[kept]
    x = x - x.mean()
    weights = x / np.sum(x * x)
    # If one group has all of an error, the others have only rounding.
    least = floors(errors)[kept] ** 2
    return jackknife(
        errors.squared[kept], lambda mean: float(0.5 * (weights @ np.log(np.maximum(mean, least)))), alpha
    )


def log_decay(errors: StrongErrors, alpha: float) -> Estimate:
    """ln(rms at the finest step / rms at the coarsest): 0 if the limit is not the exact flow."""
    ends = errors.squared[[0, -1]]
    return jackknife(ends, lambda mean: float(0.5 * np.log(mean[1] / mean[0])), alpha)


def quantile_slope(errors: StrongErrors, alpha: float) -> Estimate:
    """The order at which the QUANTILE of |e| falls from the coarsest kept step size to the finest one.

    Where E|e_h|² ≤ (C h^p)², Chebyshev's inequality bounds every quantile of |e_h| by C' h^p: a quantile that falls
    more slowly refutes the order. The interval does not depend on the tails: the number of paths with |e| below the
    quantile is binomial, so order statistics enclose it with a known probability for every distribution (Clopper and
    Pearson 1934). Each of the four ends gets alpha/4.
    """
    kept = np.flatnonzero(above_floor(errors))
    ordered = np.sort(errors.squared[[kept[0], kept[-1]]], axis=1)
    paths = ordered.shape[1]
    low = binomial(alpha / 4, paths, QUANTILE) - 1
    high = binomial(1 - alpha / 4, paths, QUANTILE)
    span = 2 * np.log(errors.steps[kept[-1]] / errors.steps[kept[0]])
    if low < 0 or high >= paths or np.any(ordered[:, low] <= floors(errors)[kept[[0, -1]]] ** 2):
        return Estimate(
            0.0, np.inf, alpha
        )  # too few paths, or a bulk at the rounding floor: the fall is not visible
    (c_low, c_high), (f_low, f_high) = np.log(ordered[:, [low, high]])
    ends = np.array([c_low - f_high, c_high - f_low]) / span
    return Estimate(float(ends.mean()), float(np.ptp(ends)) / 2, alpha)


def mean_square_order(
    errors: StrongErrors, alpha: float, *, more: float = 1.0, weighted: bool = False
) -> tuple[float, float, float]:
    """The mean-square order (value, low, high): the slope of the rms error, checked by that of its bulk.

    The rms error of heavy tails is underestimated in most samples, and its interval too. So the order is below `high`
    only if the intervals of both slopes show it: that of the quantile does so by chance with a probability of at most
    alpha/2, whatever the tails. It is above `low` if one interval shows it and the other does not contradict, or if
    the bulk shows it and the sampled rms error falls as fast.

    The intervals are those of `more` times the paths. `weighted` samples, of `sepv.properties._orders.tilting`, have
    light tails and no quantile.
    """
    rms = slope(errors, alpha if weighted else alpha / 2)
    half = rms.half / np.sqrt(more)
    if weighted:
        return rms.value, rms.value - half, rms.value + half
    bulk = quantile_slope(errors, alpha / 2)
    reach = bulk.half / np.sqrt(more)
    low = max(min(rms.value - half, bulk.value + reach), min(bulk.value - reach, rms.value))
    return rms.value, low, max(rms.value + half, bulk.value + reach)
