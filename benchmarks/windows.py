"""How surely does a law find a fault in only one decade of h?
``python -m benchmarks.windows [--seeds N]``.

The schemes are (2.1) with a fault for 10ⁿ < h < 10ⁿ⁺¹: *truncation* must find increments clipped
with k = 1, of every noise or of the second one; *local-mean-square* must find Euler's step. A cell
is the fraction of seeds with success.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace

import numpy as np

from benchmarks import over, start
from sepv.law import Effort, Verdict
from sepv.problem import Array, Problem, vector_field
from sepv.schemes import Scheme, energy_preserving
from sepv.schemes._scheme import Step
from sepv.verification import verify

DECADES = range(-10, -1)


def _clipped(problem: Problem, y: Array, h: float, dW: Array, noises: slice = slice(None)) -> Array:
    bound, seen = math.sqrt(2 * h * abs(math.log(h))), dW.copy()
    seen[noises] = np.clip(dW[noises], -bound, bound)
    return energy_preserving.step(problem, y, h, seen)


FAULTS: dict[str, tuple[str, Step]] = {
    "clipped with k = 1": ("truncation", _clipped),
    "the second noise clipped": ("truncation", lambda p, y, h, dW: _clipped(p, y, h, dW, slice(1, 2))),
    "Euler's step": (
        "local-mean-square", lambda p, y, h, dW: np.asarray(y + p.random_step(h, dW) * vector_field(p, y))
    ),
}  # fmt: skip


def broken(wrong: Step, low: float, high: float) -> Scheme:
    """Scheme (2.1) with the step `wrong` for low < h < high."""

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        return (wrong if low < h < high else energy_preserving.step)(problem, y, h, dW)

    return replace(energy_preserving, name="wrong in a window", step=step, solve=None)


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--start", type=int, default=0)
    options = parser.parse_args()
    print(f"| law | wrong | {' | '.join(f'1e{n}' for n in DECADES)} |\n|---|---|{'--:|' * len(DECADES)}")
    for name, (law, wrong) in over(FAULTS.items(), lambda entry: entry[0]):
        cells = []
        for n in over(DECADES, lambda n: f"1e{n}"):
            scheme = broken(wrong, 10.0**n, 10.0 ** (n + 1))
            seeds = range(options.start, options.start + options.seeds)
            reports = [verify(scheme, laws=[law], effort=Effort(seed=seed)) for seed in seeds]
            found = sum(report.findings[0].verdict is Verdict.VIOLATED for report in reports)
            cells.append(f"{found / len(reports):.2g}")
        print(f"| {law} | {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    start(main)
