"""Brouwer's law over many steps: ``python -m benchmarks.rounding [--steps 1e8]``.

The energy-preserving scheme (2.1) runs on the paper's four problems with the compiled engine. The
table has the random walk of H and the Casimirs by rounding, with plain and with compensated
summation, beside the prediction of `sepv.law.tolerance.rounding_walk`. Invariants are evaluated in
extended precision. Bias is the mean defect over paths at the end, per step and in standard errors.
Growth is the exponent of the rms defect over the last ten doublings of the time, with a 99 %
bootstrap interval over paths. Lotka-Volterra has h = 2⁻²⁰, because (2.1) does not keep its Casimir,
which is not quadratic: over 10⁸ steps of 2⁻¹⁰ every path drifts to a step without a solution.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from sepv.reference.problem import exact_problem

import sepv
from benchmarks import arguments, over, start
from sepv import problems, schemes
from sepv.law import casimir_ulp, energy_ulp
from sepv.law.tolerance import rounding_walk
from sepv.problem import Array
from sepv.record import EPS

ROUNDING_RUNS = (
    ("harmonic-oscillator", 0.01),
    ("rigid-body", 0.01),
    ("pendulum", 0.01),
    ("lotka-volterra", 2.0**-20),
)
ROUNDING_HEADINGS = (
    "problem", "", "summation", "ulp", "predicted", "eps·√N", "largest", "growth, 99 %", "bias",
    "bias/s.e.", "99 % <", "",
)  # fmt: skip
ROUNDING_DOUBLINGS = 10
ROUNDING_RESAMPLES = 2000


def walk(states: Array, invariant: Callable[[Any], Any], exact: Any, y0: Array) -> Array:
    """Signed defects (times, paths) of an invariant, in extended precision."""
    before = invariant(exact.state(y0))
    moments = states.swapaxes(0, 1)
    return np.array([[float(invariant(exact.state(y)) - before) for y in moment.T] for moment in moments])


def growth(defects: Array, n: Array, seed: int = 0) -> tuple[float, float, float]:
    """Exponent of the root mean square against n, and its 99 % bootstrap interval over paths."""
    rng, logs = np.random.default_rng(seed), np.log(n) - np.log(n).mean()

    def slope(sample: Array) -> float:
        rms = np.sqrt(np.mean(sample * sample, axis=1))
        return float(logs @ np.log(rms) / (logs @ logs))

    paths = defects.shape[1]
    drawn = [slope(defects[:, rng.integers(0, paths, paths)]) for _ in range(ROUNDING_RESAMPLES)]
    low, high = np.quantile(drawn, (0.005, 0.995))
    return slope(defects), float(low), float(high)


def row(defects: Array, predicted: float, unit: float, size: float, n: Array) -> list[str]:
    """The cells of the table for one invariant of one run."""
    exponent, low, high = growth(defects, n)
    rms = np.sqrt(np.mean(defects * defects, axis=1)) / np.sqrt(n)
    last = defects[-1]
    error = float(np.std(last, ddof=1) / np.sqrt(last.size))
    return [
        f"{rms[-1] / unit:.4f}",
        f"{predicted / unit:.4f}" if predicted else "–",
        f"{rms[-1] / (EPS * size):.4f}",
        f"{np.abs(last).max() / (EPS * size * np.sqrt(n[-1])):.3f}",
        f"{exponent:.3f} [{low:.2f}, {high:.2f}]",
        f"{last.mean() / unit / n[-1]:+.1e}",
        f"{last.mean() / error:+.1f}",
        f"{2.58 * error / unit / n[-1]:.0e}",
    ]


def measure(name: str, h: float, steps: int, paths: int, seed: int, table: Table) -> None:
    """Run one problem with plain and with compensated summation, and add the rows to the table."""
    problem = problems.by_name(name)
    assert problem.data is not None
    exact, y0 = exact_problem(problem.data, 40), np.asarray(problem.initial, dtype=np.float64)
    n = np.unique(np.rint(steps * 2.0 ** -np.arange(ROUNDING_DOUBLINGS + 1.0)))
    for compensated in over((False, True), lambda c: "compensated" if c else "plain"):
        start = time.perf_counter()
        ends = sepv.ensemble(
            schemes.energy_preserving, problem, h=h, steps=steps, paths=paths, seed=seed, times=n * h,
            compensated=compensated, engine="compiled",
        )  # fmt: skip
        seconds = time.perf_counter() - start
        alive = ends.status == 0
        if not alive.any():
            table.add_row(name, "", f"all {paths} paths failed, the last at step {ends.failed_step.max()}")
            continue
        states = ends.states[:, :, alive]
        visited = states.reshape(problem.dimension, -1)
        H0 = abs(float(problem.hamiltonian(y0)))
        invariants = [
            ("H", exact.hamiltonian, problem.gradient(visited), float(energy_ulp(problem, y0, y0)), H0)
        ]
        if problem.casimirs:
            A = problem.casimirs[0]
            C = lambda y: sum(v * v for v in y)  # noqa: E731 - the rigid body's, the only quadratic one here
            assert np.array_equal(A, np.eye(3))
            invariants.append(("C", C, 2 * visited, casimir_ulp(A, y0, y0), float(y0 @ y0)))
        for label, invariant, gradient, unit, size in invariants:
            defects = walk(states, invariant, exact, y0)
            predicted = 0.0 if compensated else rounding_walk(gradient, visited)
            table.add_row(
                name if label == "H" else "",
                label,
                "compensated" if compensated else "plain",
                *row(defects, predicted, unit, size, n),
                f"{seconds:.0f} s, {np.count_nonzero(~alive)} failed" if label == "H" else "",
            )


def main() -> None:
    """Print the table."""
    options = arguments(
        __doc__,
        steps=1e6,
        paths=32,
        seed=0,
        problem={
            "action": "append",
            "choices": [name for name, _ in ROUNDING_RUNS],
            "help": "all without it",
        },
    )
    steps = int(options.steps)
    out = Console(width=150)
    out.print(f"(2.1), {options.paths} paths of {steps} steps: root mean square over √n")
    chosen = [(name, h) for name, h in ROUNDING_RUNS if name in (options.problem or [name])]
    for name, h in over(chosen, lambda run: run[0]):
        table = Table(box=None)
        for heading in ROUNDING_HEADINGS:
            table.add_column(heading, min_width=19 if heading == "problem" else None)
        measure(name, h, steps, options.paths, options.seed, table)
        out.print(table)


if __name__ == "__main__":
    start(main)
