"""Mean-square and weak orders of s-stage collocation, with defects of invariants:
``python -m benchmarks.orders``.

Errors are against the exact flow at the random time. Each step size has its own paths. With two
stages or more they are importance sampled (`sepv.properties._orders.tilting`), because the mean
square of an error of order s is a (4s + 2)th moment, which plain paths do not show. Intervals have
level 99 %. Defects are the largest over 256 plain paths, relative to the invariant's size at the
start, in binary64.

Clipped increments (Remark 2.1) are too rare for sampling. Their part of the mean square is added in
closed form (`sepv.exact._truncation_error`), and sampled paths with a clipped increment are left
out. ``--stall`` shows the error of three stages with the paper's truncation k = 2 and with larger
k, and the part of this error that clipping causes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np
from rich.console import Console
from rich.table import Table
from sepv.properties import StrongErrors, strong_errors, tilted_errors
from sepv.properties import mean_square_slope as slope

import sepv
from benchmarks import arguments, over, start
from sepv import problems, schemes
from sepv.exact import clipping_error
from sepv.problem import Array, PolynomialSystem, Problem
from sepv.record import poly
from sepv.statistics import Estimate, jackknife

ORDERS_ALPHA = 0.01
# A mean error below this many standard errors is not used for a slope.
SIGNAL_ERRORS = 5.0


@dataclass(frozen=True)
class OrderRun:
    """A problem, an end time, and numbers of steps for each number of stages."""

    make: str
    T: float
    steps: dict[int, tuple[int, ...]]


# Steps are so fine that errors are asymptotic for increments of 4.4 standard deviations, but still
# above rounding.
USUAL_STEPS = {1: (16, 32, 64, 128), 2: (32, 64, 128, 256), 3: (32, 64, 128), 4: (32, 64, 128)}
ORDER_RUNS = {
    "rigid body": OrderRun("rigid-body", 1.0, USUAL_STEPS),
    "pendulum": OrderRun("pendulum", 1.0, USUAL_STEPS),
    # With longer steps some steps have no solution.
    "Lotka-Volterra": OrderRun(
        "lotka-volterra",
        0.5,
        {1: (128, 256, 512), 2: (128, 256, 512), 3: (192, 384, 768), 4: (192, 384, 768)},
    ),
    "random quartic": OrderRun("quartic", 1.0, USUAL_STEPS | {1: (64, 128, 256, 512), 4: (48, 96, 192)}),
}


def quartic(seed: int = 3) -> Problem:
    """A random quartic H in four variables with B_ij = Σ_k T_ijk y_k, T totally antisymmetric:
    Casimir |y|².
    """
    rng = np.random.default_rng(seed)
    d = 4
    weights = {indices: float(rng.integers(-2, 3)) / 2 or 1.0 for indices in combinations(range(d), 3)}
    entries: dict[tuple[int, int], list[poly.Polynomial]] = {}
    for indices, weight in weights.items():
        for i, j, k in permutations(indices):
            if i < j:
                sign = (-1) ** sum(a > b for a, b in combinations((i, j, k), 2))
                entries.setdefault((i, j), []).append(poly.scale(sign * weight, poly.variable(d, k)))
    terms = [(tuple(2 * int(i == k) for i in range(d)), 0.5 * (1 + k / 2)) for k in range(d)]
    for _ in range(6):
        exponents = [0] * d
        for index in rng.integers(0, d, 4):
            exponents[index] += 1
        terms.append((tuple(exponents), float(rng.integers(-4, 5)) / 4))
    unit = tuple(tuple(float(i == k) for i in range(d)) for k in range(d))
    B = tuple((i, j, poly.add(*parts)) for (i, j), parts in sorted(entries.items()))
    system = PolynomialSystem(d, poly.polynomial(d, terms), B, (1.0,), (unit,))
    return replace(problems.polynomial_problem(system), initial=(0.6, -0.3, 0.5, 0.4), check=False)


def build(name: str) -> Problem:
    """The problem of this name, with its initial state."""
    return quartic() if name == "quartic" else problems.by_name(name)


def measure(name: str, stages: int, paths: int, seed: int) -> StrongErrors:
    """The errors of collocation with this number of stages on one problem."""
    run, scheme = ORDER_RUNS[name], schemes.collocation(stages)
    problem, steps = build(run.make), run.steps[stages]
    if stages == 1:
        return strong_errors(scheme, problem, T=run.T, steps=steps, paths=range(paths), seed=seed)
    errors = tilted_errors(
        scheme, problem, T=run.T, steps=steps, paths=range(paths), seed=seed, order=float(stages)
    )
    apart = [clipping_error(problem, T=run.T, steps=n, k=scheme.truncation) for n in steps]
    return replace(errors, squared=errors.squared + np.square(apart)[:, None])


def defects(name: str, stages: int) -> tuple[float, float]:
    """Largest relative defects of H and of the quadratic Casimirs (NaN if there is none),
    over solved paths.
    """
    run, scheme = ORDER_RUNS[name], schemes.collocation(stages)
    problem = build(run.make)
    y0 = np.asarray(problem.initial)
    H0 = abs(float(problem.hamiltonian(y0)))
    C0 = min((abs(float(y0 @ A @ y0)) for A in problem.casimirs), default=float("nan"))
    worst = np.zeros(2)
    for steps in (run.steps[stages][0], run.steps[stages][-1]):
        ends = sepv.ensemble(scheme, problem, h=run.T / steps, T=run.T, paths=256, seed=1, engine="numpy")
        fine = ends.status == 0
        worst = np.maximum(worst, [ends.energy_defect[fine].max() / H0, ends.casimir_defect[fine].max() / C0])
    return float(worst[0]), float(worst[1])


def weak_slope(errors: StrongErrors, alpha: float) -> Estimate:
    """The slope of log |E e| over the step sizes whose mean error exceeds SIGNAL_ERRORS standard
    errors.

    With fewer than two such step sizes the slope is NaN and its interval infinite. Laws judge by
    `leading` and `decay` of `sepv.properties._orders.means` instead.
    """
    d, paths = errors.errors.shape[1:]
    size = np.linalg.norm(errors.errors.mean(axis=2), axis=1)
    noise = np.linalg.norm(errors.errors.std(axis=2), axis=1) / np.sqrt(paths)
    kept = np.flatnonzero(size > SIGNAL_ERRORS * noise)
    if kept.size < 2:
        return Estimate(np.nan, np.inf, alpha)
    x = np.log(errors.h[kept])
    x = (x - x.mean()) / np.sum((x - x.mean()) ** 2)
    samples = errors.errors[kept].reshape(-1, paths)

    def order(mean: Array) -> float:
        return float(x @ np.log(np.linalg.norm(mean.reshape(-1, d), axis=1)))

    return jackknife(samples, order, alpha)


def shown(estimate: Estimate) -> str:
    """An estimate as text: the value with its interval."""
    return f"{estimate.value:.3f} [{estimate.low:.2f}, {estimate.high:.2f}]"


def table_of_orders(paths: int, seed: int, names: list[str], stages: list[int]) -> None:
    """Print slopes, errors and defects."""
    table = Table(
        title=f"collocation, {paths} paths a step size, 99 % intervals", title_justify="left", box=None
    )
    for heading in ("problem", "s", "mean-square", "weak", "rms error, coarsest to finest", "H", "C"):
        table.add_column(heading)
    for name in over(names):
        for s in over(stages, lambda s: f"{s} stages"):
            errors = measure(name, s, paths, seed)
            energy, casimir = defects(name, s)
            failed = f" ({sum(errors.failures)} failed)" if any(errors.failures) else ""
            table.add_row(
                name, str(s), shown(slope(errors, ORDERS_ALPHA)), shown(weak_slope(errors, ORDERS_ALPHA)),
                " ".join(f"{e:.1e}" for e in errors.rms()) + failed, f"{energy:.0e}",
                f"{casimir:.0e}" if np.isfinite(casimir) else "–",
            )  # fmt: skip
    Console(width=130).print(table)


def stall(paths: int, seed: int) -> None:
    """Print √(E|e|² + C²) and C for three stages on the rigid body and several k: C by clipping,
    e without clipping.
    """
    steps, problem = (8, 32, 128), problems.rigid_body()
    plain = tilted_errors(
        replace(schemes.collocation(3), truncation=None), problem, T=1.0, steps=steps, paths=range(paths),
        seed=seed, order=3.0,
    ).rms()  # fmt: skip
    table = Table(
        title=f"three stages, rigid body, {paths} paths: rms error (of it clipping)",
        title_justify="left",
        box=None,
    )
    for heading in ("truncation", *(f"N = {n}" for n in steps)):
        table.add_column(heading)
    for k in over((2, 4, 6, 12, None), lambda k: f"k = {k}"):
        cost = np.array([clipping_error(problem, T=1.0, steps=n, k=k) for n in steps])
        cells = (f"{np.hypot(e, c):.1e} ({c:.0e})" for e, c in zip(plain, cost, strict=True))
        table.add_row("none" if k is None else f"k = {k}", *cells)
    Console(width=130).print(table)


def main() -> None:
    """Print the tables."""
    options = arguments(
        __doc__,
        paths=2048,
        seed=0,
        problem={"action": "append", "choices": list(ORDER_RUNS)},
        stages={"type": int, "action": "append", "choices": [1, 2, 3, 4]},
        stall=False,
    )
    if options.stall:
        stall(options.paths, options.seed)
    else:
        table_of_orders(
            options.paths, options.seed, options.problem or list(ORDER_RUNS), options.stages or [1, 2, 3, 4]
        )


if __name__ == "__main__":
    start(main)
