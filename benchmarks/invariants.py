"""Defects of both invariants of Lotka-Volterra over [0, 100], for four schemes:
``python -m benchmarks.invariants``.

Parameters and initial state are the paper's, and h = 2⁻⁸. H and C are evaluated in extended
precision at every 16th state. Steps that have no solution are divided, and counted.
"""

from __future__ import annotations

import numpy as np
from rich.console import Console
from rich.table import Table
from sepv.reference.problem import exact_problem

import sepv
from benchmarks import arguments, over, start
from sepv import problems, schemes
from sepv.schemes import divided

NAMES = ("both-invariants", "energy-preserving", "collocation-2", "collocation-3")
SAMPLE_EVERY = 16


def main() -> None:
    """Print the largest defects up to several times."""
    options = arguments(__doc__, end=100.0, seed=0)
    problem, h = problems.lotka_volterra(), 2.0**-8
    assert problem.data is not None
    exact = exact_problem(problem.data, 30)
    assert exact.casimir is not None
    marks = [options.end * share for share in (0.01, 0.1, 1.0)]
    table = Table(
        title="Lotka-Volterra, h = 2⁻⁸, one path: largest |H − H0| and |C − C0| on [0, t]",
        title_justify="left",
    )
    for heading in (
        "scheme",
        *(f"H, t = {m:g}" for m in marks),
        *(f"C, t = {m:g}" for m in marks),
        "divided",
    ):
        table.add_column(heading)
    for name in over(NAMES):
        path = sepv.integrate(divided(schemes.by_name(name)), problem, h=h, T=options.end, seed=options.seed)
        states = [exact.state(y) for y in path.y[:, ::SAMPLE_EVERY].T]
        times = path.t[::SAMPLE_EVERY]
        cells = []
        for invariant in (exact.hamiltonian, exact.casimir):
            values = [invariant(y) for y in states]
            defects = np.array([abs(float(v - values[0])) for v in values])
            cells += [f"{defects[times <= mark].max():.1e}" for mark in marks]
        table.add_row(name, *cells, str(path.divisions))
    Console(width=130).print(table)


if __name__ == "__main__":
    start(main)
