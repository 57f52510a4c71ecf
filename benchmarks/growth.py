"""Does cost grow as the work does? ``python -m benchmarks.growth``: fitted powers of cost,
with intervals.

Each row varies one size and fits cost = fixed + a·size^p. The cost is processor time; for cores
also the time on the clock. Sizes are visited in alternation, several times, and the power is fitted
to each round: the interval is Student's over the rounds (95 %), so a machine that is busy for a
while widens the interval and moves no size alone. Paths choose only final states, so 2²⁴ of them
need 1.5 GB. `--quick` takes smaller sizes.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import count as count_from
from time import perf_counter, process_time
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

import sepv
from benchmarks import arguments, over, start
from sepv import problems, schemes
from sepv.console import markdown


@dataclass(frozen=True)
class GrowingSize:
    """One size that grows: `prepare` makes what is not measured, and returns the function that
    is.
    """

    what: str
    sizes: tuple[int, ...]
    prepare: Callable[[int], Callable[[], Any]]
    clock: Callable[[], float] = process_time
    fixed: bool = True  # fit a cost that does not grow; False for cores, whose cost falls


def fitted(sizes: Sequence[int], costs: Sequence[float], fixed: bool) -> tuple[float, float]:
    """The fixed cost and the power p of cost = fixed + a·size^p,
    by least squares of the logarithms; fixed ≥ 0.
    """
    x, y = np.log(np.asarray(sizes, dtype=float)), np.log(costs)
    slope, intercept = np.polyfit(x, y, 1)
    if not fixed or len(sizes) < 4:
        return 0.0, float(slope)

    def residuals(p: np.ndarray) -> np.ndarray:
        return np.asarray(np.logaddexp(p[0], p[1] + p[2] * x) - y)

    found = least_squares(residuals, [y.min() - 3.0, intercept, slope], loss="soft_l1", f_scale=0.05)
    return float(np.exp(found.x[0])), float(found.x[2])


def seconds(run: Callable[[], Any], clock: Callable[[], float]) -> float:
    """The seconds of a run by a clock."""
    begin = clock()
    run()
    return clock() - begin


def interval(values: Sequence[float]) -> tuple[float, float]:
    """Student's interval (95 %) of the mean of the values of several rounds."""
    n, mean = len(values), float(np.mean(values))
    half = float(student.ppf(0.975, n - 1) * np.std(values, ddof=1) / math.sqrt(n))
    return mean - half, mean + half


def ensemble(**more: Any) -> Callable[[], Any]:
    """An ensemble of the rigid body by (2.1), ready to run: its kernel is compiled."""
    options: dict[str, Any] = {"h": 0.01, "steps": 10, "paths": 2**14} | more
    scheme, problem = (
        options.pop(key, value) for key, value in (("scheme", schemes.energy_preserving), ("problem", RIGID))
    )
    sepv.ensemble(scheme, problem, **options | {"paths": 256, "steps": 1})
    return lambda: sepv.ensemble(scheme, problem, **options)


def chain(d: int) -> dict[str, Any]:
    """A chain of d/2 particles with a quartic H, as functions."""
    n = d // 2
    J = np.kron(np.array([[0.0, -1.0], [1.0, 0.0]]), np.eye(n))
    return {
        "dimension": d,
        "structure": lambda y: np.multiply.outer(J, np.ones_like(y[0])),
        "hamiltonian": lambda y: 0.5 * (y[:n] ** 2).sum(axis=0)
        + 0.25 * ((y[n + 1 :] - y[n:-1]) ** 4).sum(axis=0) + 0.5 * y[n] ** 2,
        "initial": np.linspace(0.5, 1.0, d),
    }  # fmt: skip


def made(d: int) -> Callable[[], Any]:
    """`sepv.Problem` from B and H: recorded, derived, checked."""
    return lambda: sepv.Problem(**chain(d))


def stepped(d: int) -> Callable[[], Any]:
    """Steps of (2.1) in NumPy for 64 paths of the chain."""
    problem = sepv.Problem(**chain(d))
    return lambda: sepv.ensemble(
        schemes.energy_preserving, problem, h=0.01, steps=4, paths=64, engine="numpy"
    )


def degree(n: int) -> Callable[[], Any]:
    """An ensemble of a top with H = ½|y|² + y_1^n/(100n), whose averaged gradient takes n/2
    nodes.
    """
    squares = [[[2 * (i == k) for i in range(3)], 0.5] for k in range(3)]
    data = {
        "dimension": 3, "noise": [0.1], "hamiltonian": [*squares, [[n, 0, 0], 0.01 / n]],
        "structure": [[i, j, [[[int(k == m) for m in range(3)], sign]]] for i, j, k, sign in CROSS_PRODUCT],
    }  # fmt: skip
    return ensemble(problem=problems.build(problems.from_json(data)), y0=(0.6, 0.5, 0.4))


# The entries of the matrix of y ×, above the diagonal: row, column, component of y, sign.
CROSS_PRODUCT = ((0, 1, 2, -1.0), (0, 2, 1, 1.0), (1, 2, 0, -1.0))


def terms(count: int) -> Callable[[], Any]:
    """A problem's file with so many terms, read and built."""
    data = {
        "dimension": 3, "structure": [[0, 1, [[[0, 0, 0], 1.0]]]],
        "hamiltonian": [[[k % 40, k // 40 % 40, k // 1600], 1e-9 * (k + 1)] for k in range(count)],
    }  # fmt: skip
    number = count_from(1)  # another c_1 each time, because equal data share one problem
    return lambda: problems.build(problems.from_json(data | {"noise": [float(next(number))]}))


def cases(count: int) -> Callable[[], Any]:
    """A run of one law with so many drawn cases."""
    return lambda: sepv.verify(schemes.energy_preserving, laws=["energy"], effort=sepv.Effort(examples=count))


RIGID = problems.rigid_body()


def rows(quick: bool) -> list[GrowingSize]:
    """The rows of the table."""
    top, cores = (20 if quick else 24), os.cpu_count() or 1
    paths = tuple(2**k for k in range(top - 6, top + 1))
    some = tuple(n for n in (1, 2, 4, 8, 16, 32, 64) if n <= cores)
    return [
        GrowingSize("paths, one thread", paths, lambda n: ensemble(paths=n)),
        GrowingSize("paths, reduced", paths, lambda n: ensemble(paths=n, reduce={"q": lambda ends: ends.y[0]})),
        GrowingSize("steps", (2, 8, 32, 128, 512), lambda n: ensemble(steps=n)),
        GrowingSize("noises m", (1, 4, 16, 64), lambda m: ensemble(problem=problems.rigid_body(noise=(0.1,) * m))),
        GrowingSize("stages (degree 2s)", (1, 2, 4, 6), lambda s: ensemble(scheme=schemes.collocation(s), paths=2**12)),
        GrowingSize("degree of H", (3, 8, 16, 32), degree),
        GrowingSize("d, sepv.Problem of functions", (8, 16, 40, 80) if quick else (8, 16, 40, 100, 200), made),
        GrowingSize("d, steps in NumPy", (4, 8, 12, 16, 24, 32, 40), stepped),
        GrowingSize("terms of a problem file", (1000, 4000, 16_000, 64_000), terms),
        GrowingSize("cases of a law", (25, 100) if quick else (25, 100, 400), cases),
        GrowingSize("cores, processor time", some, lambda n: ensemble(paths=2**20, workers=n), fixed=False),
        GrowingSize("cores (seconds)", some, lambda n: ensemble(paths=2**20, workers=n), perf_counter, False),
    ]  # fmt: skip


def main() -> None:
    """Print the table."""
    options = arguments(
        __doc__, rounds=5, quick=False, only={"default": "", "help": "rows whose name begins so"}
    )
    table = []
    for row in over((r for r in rows(options.quick) if r.what.startswith(options.only)), lambda r: r.what):
        if len(row.sizes) < 2:  # one core
            continue
        ready = [row.prepare(size) for size in row.sizes]
        costs = np.array([[seconds(run, row.clock) for run in ready] for _ in over(range(options.rounds))])
        found = [fitted(row.sizes, taken, row.fixed) for taken in costs]
        low, high = interval([p for _, p in found])
        fixed = np.median([c for c, _ in found])
        median = np.median(costs, axis=0)
        table.append([
            row.what, f"{row.sizes[0]} … {row.sizes[-1]}", f"{np.mean([p for _, p in found]):.2f}",
            f"{low:.2f} … {high:.2f}", f"{fixed * 1e3:.2g}", f"{median[0]:.3g}", f"{median[-1]:.3g}",
        ])  # fmt: skip
    print(markdown(["grows", "sizes", "power p", "95 %", "fixed, ms", "smallest, s", "largest, s"], table))


if __name__ == "__main__":
    start(main)
