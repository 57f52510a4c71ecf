"""Strong error against evaluations, for collocation and other methods:
``python -m benchmarks.precision``.

All schemes have the same paths, and errors are against the exact flow at the random time.
Evaluations of ∇H are counted for one path over [0, T], with those of Newton's iterations and
without Hessians. The squared error is that on unclipped paths plus the part of clipped increments
by `sepv.exact._truncation_error`. The exact flow itself costs one normal number per path and one
dense solve for all paths, and has no step size. Points with an unsolved step are left out.

``--picture FILE.png`` draws a picture, for which matplotlib is needed (the extra ``plots``).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks import arguments, over, start
from benchmarks.orders import build
from sepv import schemes
from sepv.exact import clipping_error, exact_flow
from sepv.pictures import Axis, content, figure, frame, line
from sepv.problem import Array, Problem
from sepv.schemes import TABLEAUX, Look, Scheme
from sepv.simulate import run_chunk, wiener
from sepv.simulate import truncation as bounded

# (end time, numbers of steps): the coarsest first; powers of two, so that all have the same Wiener
# path.
PRECISION_GRIDS = {
    "rigid-body": (1.0, (2, 4, 8, 16, 32, 64, 128, 256)),
    "pendulum": (1.0, (2, 4, 8, 16, 32, 64, 128, 256)),
    "lotka-volterra": (0.5, (16, 32, 64, 128, 256, 512)),
    "quartic": (1.0, (2, 4, 8, 16, 32, 64, 128, 256)),
}
PRECISION_SCHEMES = [f"collocation-{s}" for s in range(1, 7)] + [
    "gauss-1",
    "gauss-2",
    "gauss-4",
    "explicit-4",
    "explicit-8",
]
GOALS = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10)
# An error below this is rounding, and finer steps of the scheme are not taken.
PRECISION_FLOOR = 1e-13


@dataclass(frozen=True)
class PrecisionPoint:
    """A point of the picture: one scheme with one number of steps.

    It has the rms error, the evaluations of ∇H and B for a path, and the largest relative energy
    defect.
    """

    scheme: str
    steps: int
    error: float
    gradients: float
    structures: float
    energy: float
    failed: int


def measure(
    problem: Problem, name: str, fine: Array, exact: Array, T: float, steps: tuple[int, ...]
) -> list[PrecisionPoint]:
    """The points of one scheme, coarsest first, up to the rounding floor."""
    scheme, start, paths = schemes.by_name(name), np.asarray(problem.initial), fine.shape[2]
    H0, found = abs(float(problem.hamiltonian(start))), []
    for count in over(steps, lambda count: f"N = {count}"):
        raw = wiener.coarsen(fine, fine.shape[0] // count)
        ends = run_chunk(scheme, problem, start, T / count, raw, scheme.truncation)
        uncut = np.all(bounded.truncate(raw, T / count, scheme.truncation) == raw, axis=(0, 1))
        squared = np.mean(np.sum((ends.y - exact)[:, uncut] ** 2, axis=0))
        cost = clipping_error(problem, T=T, steps=count, k=scheme.truncation)
        error = float(np.sqrt(squared + cost**2))
        gradients, structures = work(
            scheme, ends.gradient_evaluations, ends.structure_evaluations, count * paths
        )
        failed = int(np.count_nonzero(ends.status))
        energy = float(np.max(ends.energy_defect)) / H0
        found.append(
            PrecisionPoint(name, count, error, gradients / paths, structures / paths, energy, failed)
        )
        if not failed and error < PRECISION_FLOOR:
            break
    return found


def work(scheme: Scheme, gradients: int, structures: int, steps: int) -> tuple[int, int]:
    """The evaluations of ∇H and B in a run; an explicit scheme takes one of each per stage."""
    if scheme.solve is not None:
        return gradients, structures
    stages = len(TABLEAUX[int(scheme.name.rpartition("-")[2])].A)
    return stages * steps, stages * steps


def cheapest(points: list[PrecisionPoint], goal: float) -> tuple[str, float] | None:
    """The scheme that needs the fewest evaluations for the error `goal`, and their number,
    by log-log interpolation.
    """
    best = None
    for name in dict.fromkeys(p.scheme for p in points):
        own = [p for p in points if p.scheme == name and not p.failed]
        cost = evaluations_for(own, goal)
        if cost is not None and (best is None or cost < best[1]):
            best = (name, cost)
    return best


def evaluations_for(own: list[PrecisionPoint], goal: float) -> float | None:
    """The evaluations that one scheme needs for an error;
    None if no two of its points enclose the error.
    """
    for coarse, fine in pairwise(own):
        if fine.error <= goal <= coarse.error:
            share = np.log(coarse.error / goal) / np.log(coarse.error / fine.error)
            return float(np.exp((1 - share) * np.log(coarse.gradients) + share * np.log(fine.gradients)))
    return None


def table_of_points(name: str, points: list[PrecisionPoint], out: Console) -> None:
    """Print the table of errors and costs of a path, by the number of steps."""
    steps = sorted({p.steps for p in points})
    table = Table(title=f"{name}: rms error (evaluations of ∇H a path)", title_justify="left", box=None)
    for heading in ("scheme", *(f"N = {n}" for n in steps), "energy"):
        table.add_column(heading)
    for scheme in dict.fromkeys(p.scheme for p in points):
        own = {p.steps: p for p in points if p.scheme == scheme}
        solved = [p for p in own.values() if not p.failed]
        cells = [
            ""
            if n not in own
            else f"{own[n].failed} failed"
            if own[n].failed
            else f"{own[n].error:.0e} ({own[n].gradients:.0f})"
            for n in steps
        ]
        table.add_row(scheme, *cells, f"{max((p.energy for p in solved), default=float('nan')):.0e}")
    out.print(table)


def table_of_goals(results: dict[str, list[PrecisionPoint]], out: Console) -> None:
    """Print the table of goals: for each error the cheapest scheme,
    and the cheapest one that keeps the energy.
    """
    table = Table(title="fewest evaluations of ∇H a path for an rms error", title_justify="left", box=None)
    for heading in ("problem", "of", *(f"{goal:.0e}" for goal in GOALS)):
        table.add_column(heading)
    for name, points in results.items():
        for of, chosen in (
            ("all", points),
            ("energy-preserving", [p for p in points if p.scheme.startswith("collocation")]),
        ):
            found = [cheapest(chosen, goal) for goal in GOALS]
            table.add_row(name, of, *("–" if f is None else f"{f[0]} {f[1]:.0f}" for f in found))
    out.print(table)


def picture(results: dict[str, list[PrecisionPoint]], path: Path) -> None:
    """Draw one panel for each problem: error against evaluations, with solid lines for
    collocation.
    """
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    shades = [to_hex(shade) for shade in colormaps["viridis"](np.linspace(0.0, 0.9, 6))]
    looks = {f"collocation-{s}": Look(shades[s - 1], shades[s - 1], "o") for s in range(1, 7)}
    rivals = ("gauss-1", "gauss-2", "gauss-4", "explicit-4", "explicit-8")
    colours = ("#BFBFBF", "#999999", "#737373", "#FF7F0E", "#D62728")
    looks |= {n: Look(c, c, m, "4 2") for n, c, m in zip(rivals, colours, "vvv^s", strict=True)}
    with figure(11, 8.5, layout="constrained") as drawn:
        axes = drawn.subplots(2, 2)
        for axis, (name, points) in zip(axes.flat, results.items(), strict=True):
            for scheme in dict.fromkeys(p.scheme for p in points):
                own = [p for p in points if p.scheme == scheme and not p.failed]
                how = line(looks[scheme]) | {"markerfacecolor": looks[scheme].colour}
                axis.plot([p.gradients for p in own], [p.error for p in own], label=scheme, **how)
            axis.set_title(f"{name}, T = {PRECISION_GRIDS[name][0]:g}", fontsize=10)
            frame(axis, Axis("evaluations of ∇H a path", log=True), Axis("rms error at T", log=True))
        handles, labels = axes.flat[0].get_legend_handles_labels()
        drawn.legend(handles, labels, loc="outside lower center", ncols=6)
        path.write_bytes(content(drawn, path.suffix, dpi=130))


def main() -> None:
    """Print the tables, and draw the picture if one is asked for."""
    options = arguments(__doc__, paths=2000, seed=0, picture={"type": Path})
    out, results = Console(width=150), {}
    for name, (T, steps) in over(PRECISION_GRIDS.items(), lambda item: item[0]):
        problem = build(name)
        fine = wiener.increments(
            options.seed, T=T, steps=steps[-1], noises=problem.noises, paths=options.paths
        )
        exact = exact_flow(problem, problem.random_step(T, fine.sum(axis=0)))
        results[name] = [
            p for s in over(PRECISION_SCHEMES) for p in measure(problem, s, fine, exact.y, T, steps)
        ]
        table_of_points(name, results[name], out)
        out.print(f"exact time change: error {exact.error:.0e}, one normal number a path ({exact.method})\n")
    table_of_goals(results, out)
    if options.picture:
        picture(results, options.picture)


if __name__ == "__main__":
    start(main)
