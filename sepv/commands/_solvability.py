"""``sepv solvability``: the steps whose equation has a solution,
and the time up to which numerical paths find one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sepv.commands import _shared as cli
from sepv.console import Table, columns, print_table
from sepv.files import write_atomically

if TYPE_CHECKING:
    from sepv.studies import Exits, Map

SOLVABILITY_STEP_SIZES = tuple(2.0**-n for n in range(1, 11))
# The states are dense enough if the mean over all and the mean over every second one differ by at
# most this share.
MEAN_TOLERANCE = 0.2
# Step sizes with which paths are followed.
FOLLOWED_STEP_SIZES = tuple(2.0**-n for n in range(4, 10))


@click.command(short_help="Which steps have a solution, and how long a step size is safe.")
@click.argument("problem")
@click.option(
    "--scheme", default="energy-preserving", metavar="SCHEME", help="This, midpoint or both-invariants."
)
@click.option("--range", "furthest", type=cli.POSITIVE, default=1.0, help="The largest |Δ|.")
@click.option("--states", type=click.IntRange(min=2), default=96, help="How many, along the orbit.")
@click.option("--time", type=cli.Finite(min=0), default=10.0, help="Length of the orbit.")
@click.option("--grid", type=click.IntRange(min=2), default=80, help="Points of Δ on each side of 0.")
@cli.INITIAL
@click.option(
    "--noise", type=cli.NumberList(float), help="The c_j, such as 1,0.5. [default: the problem's own]"
)
@click.option(
    "--truncation", type=cli.NATURAL, help="k of Remark 2.1; 0 for none. [default: each scheme's own]"
)
@click.option(
    "--follow", multiple=True, metavar="SCHEME",
    help="Whose paths are followed; any scheme, more than once. [default: that of the map]",
)  # fmt: skip
@click.option(
    "--until",
    type=cli.Finite(min=0),
    default=512.0,
    help="Time to which paths are followed; 0 for none.",
)
@click.option("--paths", type=cli.COUNT, default=48, help="For each h.")
@click.option(
    "--seconds", type=cli.Finite(min=0), default=60.0,
    help="For following, in all; paths are followed less far where it is not enough.",
)  # fmt: skip
@click.option("--seed", type=cli.NATURAL, default=0, help="Of the paths.")
@click.option("--json", "json_file", type=cli.OUT, help="Write all numbers to this file.")
@click.option("--picture", type=cli.OUT, help="Draw it: .svg, .png or .pdf (extra plots).")
@cli.friendly
def solvability(
    problem: str, *, scheme: str, furthest: float, initial: tuple[float, ...] | None,
    noise: tuple[float, ...] | None, truncation: int | None, follow: cli.Names, until: float, seconds: float,
    paths: int, seed: int, json_file: str | None, picture: str | None, **orbit: Any,
) -> None:  # fmt: skip
    """Find how far the solutions of a step of PROBLEM reach in Δ = h + Σ c_j ΔW_j,
    and how long a step size is safe.

    States y0 are taken along the exact solution's orbit. From each y0, the solution y1(Δ) with
    y1(0) = y0 is followed until it turns back (a fold) or |Δ| reaches --range; then Newton's method
    is tried at every Δ of a grid. Numerical paths leave this orbit, so they are followed too, until
    the scheme's solver refuses a step. With one scheme, a step size counts as safe until the time
    at which the first of its paths fails.

    \b
    sepv solvability lotka-volterra --follow both-invariants
    sepv solvability rigid-body --range 20 --until 100
    """
    from dataclasses import replace

    import numpy as np

    from sepv.console import console, showing
    from sepv.pictures import require_picture
    from sepv.schemes import load_problem, load_scheme
    from sepv.studies import Exits, follow_paths, solvability_map

    require_picture(picture)
    chosen = load_problem(problem)
    if noise is not None:
        chosen = replace(chosen, noise=noise, check=False)
    y0, mapped = None if initial is None else np.array(initial), load_scheme(scheme)
    k = mapped.truncation if truncation is None else truncation or None
    followed = [load_scheme(name) for name in follow] or [mapped]
    out, exits = console(), list[Exits]()
    with showing() as line:
        regions = solvability_map(
            chosen, scheme=mapped, furthest=furthest, y0=y0, progress=line.update, **orbit
        )
        for method in followed if until else ():
            exits += follow_paths(
                chosen, method, FOLLOWED_STEP_SIZES, until=until, paths=paths,
                k=method.truncation if truncation is None else k,
                y0=y0, seed=seed, seconds=seconds / len(followed), progress=line.update,
            )  # fmt: skip
    data = regions.to_json(SOLVABILITY_STEP_SIZES, k) | {"paths": [e.to_json() for e in exits]}
    cli.save_json(json_file, "solvability", data, indent=None)
    if picture:
        from sepv.studies import draw_solvability as draw

        write_atomically(
            picture, draw(regions, SOLVABILITY_STEP_SIZES, k, Path(picture).suffix.lower(), exits)
        )
    _show(regions, furthest, k, out)
    _show_exits(exits, out)


def _show(regions: Map, furthest: float, k: int | None, out: Any) -> None:
    """Print the range of Δ in which the equation of a step is solvable,
    and the probability of a Δ outside of it.
    """
    from sepv.studies import End

    low, high = regions.safe
    limits = f"|Δ| ≤ {furthest:g}, all that was asked"
    if min(-low, high) < furthest:
        limits = f"{low:.6g} < Δ < {high:.6g}"
    further = regions.refined.theta.size
    out.print(
        f"{regions.problem.name}, {regions.scheme.name}: {regions.theta.size} states of the exact orbit, "
        f"|Δ| ≤ {furthest:g}."
    )
    out.print(
        f"From each of them{f', and of {further} more around the shortest branches,' if further else ''} there is a "
        f"solution connected to y0 for {limits}. States between were not looked at."
    )
    for branch, sign in ((regions.backward, "Δ < 0"), (regions.forward, "Δ > 0")):
        ends = [f"{e.text}: {int((branch.end == e).sum())}" for e in End if (branch.end == e).any()]
        out.print(
            f"  {sign}: branches from {branch.reach.min():.6g} to {branch.reach.max():.6g} long; {', '.join(ends)}"
        )
    kinds = "; ".join(f"{kind.text}: {c}" for kind, c in regions.counts().items() if c)
    out.print(f"The map, {regions.findings.size} points: {kinds}.")
    law = f"truncated with k = {k}" if k else "untruncated"
    out.print(f"\nP(Δ of a step is off the branch), c = {regions.problem.c.tolist()}, {law}:")
    print_table(_table(regions, k), out)
    rough = []  # step sizes whose mean depends on the choice of states
    for h in SOLVABILITY_STEP_SIZES:
        p = regions.chances(h, k)
        mean, half = float(p.mean()), float(p[::2].mean())
        if abs(mean - half) > MEAN_TOLERANCE * mean or (mean == 0 and regions.worst(h, k) > 0):
            rough.append(h)
    if rough:
        out.print(
            f"The means are rough from h = 2^{round(math.log2(rough[0]))} on: every second state alone gives one "
            f"that is off by more than {MEAN_TOLERANCE:.0%}, or all are 0 beside a state that is not. More "
            "--states make them finer."
        )


def _table(regions: Map, k: int | None) -> Table:
    """The table, by step size h, of the probability that a step's Δ has no solution connected to
    y0.
    """
    rows = []
    for h in SOLVABILITY_STEP_SIZES:
        p = float(regions.chances(h, k).mean())
        path = 1 - (1 - p) ** round(1 / h)
        rows.append((f"2^{round(math.log2(h))}", *(f"{v:.2g}" for v in (p, regions.worst(h, k), path))))
    heads = ("h", "mean over the states", "worst state", "some step to T = 1, on the orbit")
    return Table(columns((), heads, goes=["worst state"]), rows)


def _show_exits(exits: Sequence[Exits], out: Any) -> None:
    """Print a table of paths, by scheme and step size: how many failed,
    and when the first step had no solution.
    """
    if not exits:
        return
    rows = [
        (
            e.scheme, f"2^{round(math.log2(e.h))}", f"{e.until:.6g}" + "*" * e.cut_short,
            f"{e.failed} of {e.paths}", *("–" if t is None else f"{t:.4g}" for t in (e.first, e.median)),
            f"≤ {e.share:.2g}",
        )
        for e in exits
    ]  # fmt: skip
    numbers = ("h", "followed to", "failed", "first exit", "half failed", "share, 95 %")
    heads = columns(["scheme"], numbers, goes=("share, 95 %", "followed to", "half failed", "failed"))
    out.print("\nPaths of the schemes themselves, until their solver refuses a step:")
    print_table(Table(heads, rows), out)
    out.print(
        "A step size is safe, with that scheme and from this state, until the first exit; where there is none, "
        "nothing is known beyond the end of the paths. share bounds the probability that a path fails until then."
    )
    if any(e.cut_short for e in exits):
        out.print("* not as far as asked: --seconds were up.")
