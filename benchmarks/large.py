"""Cost and defects against the dimension d, for chains of up to 10⁴ components: ``python -m benchmarks.large``.

The time is the processor time of one step without tracking of invariants, as a median with quartiles over runs that
alternate between the sizes. The exponent is the slope of log time against log d, over all sizes and over the last
decade of d. A defect is the largest of a whole path.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from time import process_time

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks import over, start
from sepv import large
from sepv.large import LargeProblem
from sepv.large._schemes import LargeStep
from sepv.simulate import truncation as bounded
from sepv.simulate import wiener
from sepv.solve import Status

H, STEPS = 0.01, 20
# Each chain with the number of components of y for one element of the chain; SIZES are values of d.
CHAINS: tuple[tuple[Callable[[int], LargeProblem], int], ...] = (
    (large.volterra_lattice, 1),
    (large.toda_chain, 2),
    (large.nonlinear_schroedinger, 2),
    (large.spin_chain, 3),
)
SIZES = (100, 316, 1000, 3162, 10_000)


def seconds(step: LargeStep, problem: LargeProblem) -> float:
    """The processor time of one step in seconds, as a mean over STEPS steps of a path."""
    dW = bounded.truncate(wiener.increments(0, T=H * STEPS, steps=STEPS, noises=1)[:, :, 0], H)
    y = problem.initial
    begin = process_time()
    for row in dW:
        solution = step(problem, y, problem.random_step(H, row))
        assert solution.status is Status.CONVERGED
        y = solution.value
    return (process_time() - begin) / STEPS


def exponent(sizes: list[int], times: list[float]) -> float:
    """The slope of log time against log d."""
    return float(np.polyfit(np.log(sizes), np.log(times), 1)[0])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--steps", type=int, default=200, help="of the path whose defects are shown")
    options = parser.parse_args()
    for step in over((large.energy_preserving, large.midpoint), lambda f: f.__name__):
        table = Table(
            title=f"{step.__name__}: h = {H:g}, defects over {options.steps} steps, |ΔH| relative to Σ|terms of H|",
            title_justify="left",
        )
        for heading in ("problem", "d", "ms/step", "±%", "Newton", "|ΔH|", "|ΔC|", "|ΔC|, other"):
            table.add_column(heading, justify="left" if heading == "problem" else "right")
        for make, width in over(CHAINS, lambda chain: chain[0].__name__):
            problems = [make(round(d / width) | (width == 1)) for d in SIZES]
            rounds = over(range(options.repeats), lambda n: f"repeat {n + 1} of {options.repeats}")
            times = np.array([[seconds(step, p) for p in problems] for _ in rounds])
            median, low, high = (np.quantile(times, q, axis=0) for q in (0.5, 0.25, 0.75))
            for n, problem in enumerate(problems):
                path = large.integrate(step, problem, h=H, steps=options.steps)
                table.add_row(
                    problem.name if n == 0 else "", str(problem.dimension), f"{1e3 * median[n]:.3g}",
                    f"{50 * (high[n] - low[n]) / median[n]:.0f}", f"{path.iterations / options.steps:.2f}",
                    f"{path.energy_defect / path.energy_scale:.1e}",
                    "–" if problem.casimirs is None else f"{path.casimir_defect:.1e}",
                    "–" if problem.other_casimirs is None else f"{path.other_casimir_defect:.1e}",
                )  # fmt: skip
            d = [p.dimension for p in problems]
            whole, last = exponent(d, list(median)), exponent(d[-3:], list(median[-3:]))
            table.add_row("", "exponent", f"{whole:.2f}", "", "", "", "", f"last decade {last:.2f}")
            table.add_section()
        Console(width=110).print(table)


if __name__ == "__main__":
    start(main)
