"""Invariant defects over the paper's runs, in eps·√N: ``python -m benchmarks.paper_runs``.

H and the Casimirs C are evaluated in extended precision at the binary64 state after every step.
Their defects are relative to the value at the start (for an energy near zero, to Σ|∂_iH y_i|).
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from rich.console import Console
from rich.table import Table
from sepv.reference.problem import exact_problem

import sepv
from benchmarks import over, start
from sepv import problems, schemes

# §4.1: 10⁵ steps of 10⁻²; §4.2: 300 steps of 10⁻²; §4.3: [0, 500], h = 2⁻⁶; §4.4: [0, 5], h = 2⁻⁸.
RUNS = (
    ("harmonic-oscillator", 0.01, 100_000),
    ("rigid-body", 0.01, 300),
    ("pendulum", 2.0**-6, 32_000),
    ("lotka-volterra", 2.0**-8, 1280),
)
EPS = float(np.finfo(np.float64).eps)


def defects(scheme: sepv.Scheme, name: str, h: float, steps: int, seed: int = 0) -> tuple[float, float]:
    """Largest relative defect of H and of the quadratic Casimirs (NaN if there is none), in
    eps·√N.
    """
    problem = problems.by_name(name)
    assert problem.data is not None
    exact = exact_problem(problem.data, 30)
    path = sepv.integrate(scheme, problem, h=h, steps=steps, seed=seed).y
    y0 = exact.state(path[:, 0])
    H0, C0 = exact.hamiltonian(y0), exact.casimir_values(y0)
    scale = max(abs(H0), exact.ctx.fsum(abs(g * v) for g, v in zip(exact.gradient(y0), y0, strict=True)))
    worst_H, worst_C = 0.0, 0.0 if C0 else float("nan")
    for state in path.T[1:]:
        y = exact.state(state)
        worst_H = max(worst_H, float(abs(exact.hamiltonian(y) - H0) / scale))
        for before, after in zip(C0, exact.casimir_values(y), strict=True):
            worst_C = max(worst_C, float(abs(after - before) / abs(before)))
    unit = EPS * float(np.sqrt(steps))
    return worst_H / unit, worst_C / unit


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("schemes", nargs="*", default=["energy-preserving", "midpoint", "discrete-gradient"])
    table = Table(title="largest relative defect at any step, in eps·√N", title_justify="left")
    for heading in ("scheme", "problem", "h", "N", "energy", "Casimir"):
        table.add_column(heading)
    for name in over(parser.parse_args().schemes):
        for problem, h, steps in over(RUNS, lambda run: f"{run[0]}, h = {run[1]:g}"):
            energy, casimir = defects(schemes.by_name(name), problem, h, steps)
            shown = f"{casimir:.3g}" if math.isfinite(casimir) else "–"
            table.add_row(name, problem, f"{h:g}", str(steps), f"{energy:.3g}", shown)
    Console(width=100).print(table)


if __name__ == "__main__":
    start(main)
