"""Mean-square slopes against the exact flow, schemes × problems: ``python -m benchmarks.slopes``.

Each slope has a 99 % interval (jackknife over groups of paths); all step sizes have the same Wiener
paths.
"""

from __future__ import annotations

import argparse

from rich.console import Console
from rich.table import Table
from sepv.properties import mean_square_slope as slope
from sepv.properties._orders.convergence import strong_errors

from benchmarks import over, start
from sepv import problems, schemes

# (T, numbers of steps). Lotka-Volterra needs h ≤ 2⁻⁷, because some larger steps have no solution,
# and explicit schemes leave the octant.
GRIDS = {
    "harmonic-oscillator": (1.0, (8, 16, 32, 64, 128)),
    "rigid-body": (1.0, (8, 16, 32, 64, 128)),
    "pendulum": (1.0, (8, 16, 32, 64, 128)),
    "lotka-volterra": (1.0, (256, 512, 1024, 2048)),
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--paths", type=int, default=1024)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("schemes", nargs="*", default=list(schemes.PAPER), metavar="scheme")
    options = parser.parse_args()
    table = Table(title=f"mean-square slopes, {options.paths} paths, 99 % intervals", title_justify="left")
    for heading in ("scheme", "problem", "slope", "interval", "rms error, coarsest to finest"):
        table.add_column(heading)
    for name in over(options.schemes):
        for problem, (T, steps) in over(GRIDS.items(), lambda item: item[0]):
            errors = strong_errors(
                schemes.PAPER[name], problems.by_name(problem), T=T, steps=steps, paths=range(options.paths),
                seed=options.seed,
            )  # fmt: skip
            found = slope(errors, 0.01)
            row = " ".join(f"{e:.2g}" for e in errors.rms())
            failed = f"  ({sum(errors.failures)} failed)" if any(errors.failures) else ""
            table.add_row(
                name, problem, f"{found.value:.3f}", f"[{found.low:.3f}, {found.high:.3f}]", row + failed
            )
    Console(width=120).print(table)


if __name__ == "__main__":
    start(main)
