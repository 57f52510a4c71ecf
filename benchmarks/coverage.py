"""How often do the intervals of the statistical laws miss the true value?
``python -m benchmarks.coverage``.

An interval has a nominal error probability alpha. A batch has 512 paths, as many as a law draws
first. 1000 batches of a scheme together give the true value, with an error √1000 times smaller than
that of a batch. Misses are counted on both sides: an interval wholly `below` the value can accuse a
right scheme; one wholly `above` it can let a fault pass. Misses of several means count as one. The
last rows are verdicts: how often a law, run with this alpha on one problem, calls the scheme
violated. Schemes of order 2 and more are measured as in their laws, on the weighted samples of
`sepv.properties._orders.tilting`, for which no quantile is used.

The laws use an alpha near 3e-6, at which misses are too rare to count. So misses are counted at
larger alpha, and their rates compared with alpha as it falls. If a law accuses by two intervals
together, verdicts show how many misses accuse. ``--deep`` counts only the misses of *right-limit*,
because one of its intervals is enough to accuse. Then alpha falls to 1e-5.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from sepv.properties import (
    FIRST_LOOK,
    Assess,
    Setup,
    StrongErrors,
    decay,
    first_paths,
    is_tilted,
    joined_errors,
    leading,
    limit_errors,
    moment_errors,
    quantile_slope,
    setups_for,
    strong_errors,
    test_mean_square_order,
    test_right_limit,
    test_weak_order,
    tilted_errors,
)
from sepv.properties import mean_square_slope as slope

from benchmarks import arguments, over, start
from sepv import problems, schemes
from sepv.law import Verdict
from sepv.problem import Array, Problem
from sepv.schemes import Scheme

ALPHAS = (0.05, 0.01, 0.001)
# The alphas of --deep, and the number of batches that it draws at once.
DEEP_ALPHAS, DEEP_BATCHES = (1e-2, 1e-3, 1e-4, 1e-5), 40
# Heavy tails first: explicit schemes, with and without truncation.
COVERED_SCHEMES = {
    "milstein": schemes.milstein,
    "milstein, untruncated": replace(schemes.milstein, truncation=None),
    "euler-maruyama": schemes.euler_maruyama,
    "euler-maruyama, untruncated": replace(schemes.euler_maruyama, truncation=None),
    "euler-heun": schemes.euler_heun,
    "energy-preserving": schemes.energy_preserving,
    "explicit-4, tilted": schemes.explicit(4),
    "collocation-2, tilted": schemes.collocation(2),
}


@dataclass(frozen=True)
class CoverageRow:
    """The coverage of one interval: the fractions of batches in which it misses the value,
    for each alpha of ALPHAS.

    `below` and `above` are the fractions in which the interval lies below and above the value.
    """

    statistic: str
    below: tuple[float, ...]
    above: tuple[float, ...]


def drawn(scheme: Scheme, problem: Problem, batches: int, seed: int) -> StrongErrors:
    """The errors of all batches of one scheme on one problem, drawn once."""
    setup = next(s for s in setups_for(scheme) if s.problem == problem.name)
    parts = []
    for n in over(range(batches), lambda n: f"batch {n + 1} of {batches}"):
        paths = range(n * FIRST_LOOK, (n + 1) * FIRST_LOOK)
        parts.append(_errors(scheme, problem, setup, paths, seed))
    return joined_errors(parts)


def _errors(scheme: Scheme, problem: Problem, setup: Setup, paths: range, seed: int) -> StrongErrors:
    """The errors of the given paths, drawn as the laws draw them."""
    if is_tilted(scheme):
        assert scheme.mean_square_order is not None
        return tilted_errors(
            scheme,
            problem,
            T=setup.T,
            steps=setup.steps,
            paths=paths,
            seed=seed,
            order=scheme.mean_square_order,
        )
    return strong_errors(scheme, problem, T=setup.T, steps=setup.steps, paths=paths, seed=seed)


def split(errors: StrongErrors) -> list[StrongErrors]:
    """The errors of all batches, split into one `StrongErrors` for each batch."""
    arrays = ("squared", "errors", "ends", "W", "weights")
    return [
        replace(errors, **{name: getattr(errors, name)[..., k : k + FIRST_LOOK] for name in arrays})
        for k in range(0, errors.squared.shape[1], FIRST_LOOK)
    ]


def rows(scheme: Scheme, problem: Problem, errors: StrongErrors) -> Iterator[CoverageRow]:
    """The rows of the table: one for every interval of every law."""
    batches, tilted = split(errors), is_tilted(scheme)
    moments, limits = moment_errors(errors), limit_errors(errors, problem)[1]
    yield _misses("slope of the rms error", batches, slope, slope(errors, 0.5).value)
    if not tilted:
        yield _misses("slope of the quantile", batches, quantile_slope, quantile_slope(errors, 0.5).value)
    power = math.ceil(scheme.weak_order or 1.0) - 1
    yield _coefficients(f"coefficient of h^{power} of the means", moments, errors.h, power)
    orders = test_right_limit.mean_orders(scheme)
    yield _coefficients("shares of the limit", limits, errors.h if orders[0] >= 1 else np.sqrt(errors.h), 0)
    truth = decay(moments, errors.h, 0.5)[0]
    below, above = [], []
    for alpha in ALPHAS:
        found = [decay(part, errors.h, alpha) for part in _pieces(moments)]
        below.append(float(np.mean([high < truth for _, _, high in found])))
        above.append(float(np.mean([low > truth for _, low, _ in found])))
    yield CoverageRow("fall of the means", tuple(below), tuple(above))
    laws: tuple[tuple[str, Assess], ...] = (
        (
            "verdict of mean-square-order",
            test_mean_square_order.assessing(scheme.mean_square_order or 1.0, tilted),
        ),
        ("verdict of weak-order", test_weak_order.assessing(scheme.weak_order or 1.0, tilted)),
        ("verdict of right-limit", test_right_limit.assessing(tilted, orders)),
    )
    for name, assess in laws:
        shares = [
            float(np.mean([assess(problem, e, alpha, 1.0).verdict is Verdict.VIOLATED for e in batches]))
            for alpha in ALPHAS
        ]
        yield CoverageRow(name, tuple(shares), ())


def _misses(
    name: str, batches: list[StrongErrors], estimate: Callable[[StrongErrors, float], object], truth: float
) -> CoverageRow:
    below, above = [], []
    for alpha in ALPHAS:
        found = [estimate(e, alpha) for e in batches]
        below.append(float(np.mean([f.high < truth for f in found])))  # type: ignore[attr-defined]
        above.append(float(np.mean([f.low > truth for f in found])))  # type: ignore[attr-defined]
    return CoverageRow(name, tuple(below), tuple(above))


def _coefficients(name: str, samples: Array, h: Array, power: int) -> CoverageRow:
    truth = leading(samples, h, power).value
    found = [leading(part, h, power) for part in _pieces(samples)]
    below, above = [], []
    for alpha in ALPHAS:
        below.append(float(np.mean([np.any(c.value + c.half(alpha) < truth) for c in found])))
        above.append(float(np.mean([np.any(c.value - c.half(alpha) > truth) for c in found])))
    return CoverageRow(name, tuple(below), tuple(above))


def _pieces(samples: Array) -> list[Array]:
    return [samples[..., k : k + FIRST_LOOK] for k in range(0, samples.shape[-1], FIRST_LOOK)]


def deep(scheme: Scheme, problem: Problem, batches: int, seed: int) -> tuple[int, ...]:
    """Count the batches in which an interval of *right-limit* misses on either side,
    for each alpha of DEEP_ALPHAS.

    Each estimate is linear in the samples, so the mean of the batches' estimates is the estimate
    from all samples.
    """
    setup = next(s for s in setups_for(scheme) if s.problem == problem.name)
    values, halves = [], []
    for n in over(range(0, batches, DEEP_BATCHES), lambda n: f"batch {n} of {batches}"):
        paths = range(n * FIRST_LOOK, min(n + DEEP_BATCHES, batches) * FIRST_LOOK)
        errors = _errors(scheme, problem, setup, paths, seed)
        for samples in _pieces(limit_errors(errors, problem)[1]):
            found = leading(samples, errors.h, 0)
            values.append(found.value)
            halves.append([found.half(alpha) for alpha in DEEP_ALPHAS])
    off = np.abs(np.array(values) - np.mean(values, axis=0))[:, None]
    return tuple(int(count) for count in np.any(off > np.array(halves), axis=2).sum(axis=0))


def main() -> None:
    """Print the table as Markdown."""
    options = arguments(
        __doc__,
        batches=1000,
        seed=0,
        scheme={"action": "append", "choices": list(COVERED_SCHEMES)},
        problem={"action": "append", "choices": ["rigid-body", "pendulum"]},
        deep={"action": "store_true", "help": "the shares of right-limit at 1e-2 to 1e-5"},
    )
    if options.deep:
        for name in options.scheme or COVERED_SCHEMES:
            for known in options.problem or ("rigid-body", "pendulum"):
                counts = deep(COVERED_SCHEMES[name], problems.by_name(known), options.batches, options.seed)
                said = ", ".join(f"{n} at {a:g}" for n, a in zip(counts, DEEP_ALPHAS, strict=True))
                print(f"{name}, {known}: of {options.batches} batches miss {said}", flush=True)
        return
    heads = " | ".join(f"{side} at {100 * a:g} %" for a in ALPHAS for side in ("below", "above"))
    print(f"| scheme | problem | interval | {heads} |\n|---|---|---|{'--:|' * 2 * len(ALPHAS)}")
    for name in over(options.scheme or COVERED_SCHEMES):
        for problem in over(
            map(problems.by_name, options.problem or ("rigid-body", "pendulum")), lambda p: p.name
        ):
            errors = drawn(COVERED_SCHEMES[name], problem, options.batches, options.seed)
            if any(errors.failures):
                raise SystemExit(f"{name}, {problem.name}: {errors.failures} paths failed")
            for row in rows(
                COVERED_SCHEMES[name], problem, first_paths(errors, options.batches * FIRST_LOOK)
            ):
                cells = [
                    f"{100 * side[n]:.1f} %" if side else ""
                    for n in range(len(ALPHAS))
                    for side in (row.below, row.above)
                ]
                print(f"| {name} | {problem.name} | {row.statistic} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    start(main)
