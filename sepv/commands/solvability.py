"""``sepv solvability``: which steps have a solution."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sepv.commands.compare import Numbers
from sepv.commands.shared import FILE, friendly

if TYPE_CHECKING:
    from rich.table import Table

    from sepv.solvability import Map

STEPS = tuple(2.0**-n for n in range(1, 11))


@click.command(short_help="Which steps have a solution, and which h are safe.")
@click.argument("problem")
@click.option("--scheme", default="energy-preserving", show_default=True, help="This or midpoint.")
@click.option(
    "--range", "furthest", type=click.FloatRange(min=0, min_open=True), default=1.0, show_default=True,
    help="The largest |Δ|.",
)  # fmt: skip
@click.option(
    "--states", type=click.IntRange(min=2), default=96, show_default=True, help="How many, along the orbit."
)
@click.option(
    "--time", type=click.FloatRange(min=0), default=10.0, show_default=True, help="Length of the orbit."
)
@click.option(
    "--grid", type=click.IntRange(min=2), default=80, show_default=True, help="Points of Δ on each side of 0."
)
@click.option("--initial", type=Numbers(float), help="Initial state. [default: the problem's own]")
@click.option("--noise", type=Numbers(float), help="The c_j, such as 1,0.5. [default: the problem's own]")
@click.option(
    "--truncation",
    type=click.IntRange(min=0),
    default=2,
    show_default=True,
    help="k of Remark 2.1; 0 for none.",
)
@click.option("--json", "json_file", type=FILE, help="Write all numbers to this file.")
@click.option("--picture", type=FILE, help="Draw it: .svg, .png or .pdf (extra plots).")
@friendly
def solvability(
    problem: str,
    *,
    scheme: str,
    furthest: float,
    states: int,
    time: float,
    grid: int,
    initial: tuple[float, ...] | None,
    noise: tuple[float, ...] | None,
    truncation: int,
    json_file: str | None,
    picture: str | None,
    debug: bool,  # noqa: ARG001  (every command takes it)
) -> None:
    """How far the solutions of a step of PROBLEM reach in Δ = h + Σ c_j ΔW_j, and which h are safe.

    States are taken along the exact orbit: with the noise of (1.1) no others are ever passed. From each, the
    branch of solutions that starts in y0 at Δ = 0 is followed to its fold or to the end of the range; then
    Newton is asked at every Δ of a grid.

    \b
    sepv solvability lotka-volterra --picture lv.png
    sepv solvability rigid-body --range 20
    """
    from dataclasses import replace

    import numpy as np

    from sepv.compare.picture import require_picture
    from sepv.files import require_folder, write_atomically
    from sepv.report import console
    from sepv.solvability import solvability_map
    from sepv.target import load_problem, load_scheme

    require_picture(picture)
    for path in (json_file, picture):
        require_folder(path)
    chosen, k = load_problem(problem), truncation or None
    if noise is not None:
        chosen = replace(chosen, noise=noise, check=False)
    out = console()
    with console(stderr=True).status("") as line:
        found = solvability_map(
            chosen, scheme=load_scheme(scheme), furthest=furthest, states=states, time=time, grid=grid,
            y0=None if initial is None else np.array(initial), progress=line.update,
        )  # fmt: skip
    if json_file:
        write_atomically(json_file, json.dumps(found.to_json(STEPS, k), allow_nan=False) + "\n")
    if picture:
        from sepv.solvability.picture import draw

        write_atomically(picture, draw(found, STEPS, k, Path(picture).suffix.lower()))
    _show(found, furthest, k, out)


def _show(found: Map, furthest: float, k: int | None, out: Any) -> None:
    from sepv.solvability import End

    low, high = found.safe
    limits = (
        f"{low:.6g} < Δ < {high:.6g}"
        if min(-low, high) < furthest
        else f"|Δ| ≤ {furthest:g}, all that was asked"
    )
    out.print(
        f"{found.problem.name}, {found.scheme.name}: {found.theta.size} states of the orbit, |Δ| ≤ {furthest:g}."
    )
    out.print(f"From every state there is a solution connected to y0 for {limits}.")
    for branch, sign in ((found.backward, "Δ < 0"), (found.forward, "Δ > 0")):
        ends = [f"{e.text}: {int((branch.end == e).sum())}" for e in End if (branch.end == e).any()]
        out.print(
            f"  {sign}: branches from {branch.reach.min():.6g} to {branch.reach.max():.6g} long; {', '.join(ends)}"
        )
    total = found.findings.size
    out.print(
        f"The map, {total} points: "
        + "; ".join(f"{kind.text}: {c}" for kind, c in found.counts().items() if c)
        + "."
    )
    law = f"truncated with k = {k}" if k else "untruncated"
    out.print(f"\nP(Δ of a step is off the branch), c = {found.problem.c.tolist()}, {law}:")
    out.print(_table(found, k))


def _table(found: Map, k: int | None) -> Table:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for heading in ("h", "mean over the orbit", "worst state", "some step to T = 1"):
        table.add_column(heading, justify="right")
    for h in STEPS:
        p = found.chances(h, k)
        path = 1 - (1 - float(p.mean())) ** round(1 / h)
        table.add_row(f"2^{round(_log2(h))}", *(f"{v:.2g}" for v in (p.mean(), p.max(), path)))
    return table


def _log2(h: float) -> float:
    import math

    return math.log2(h)
