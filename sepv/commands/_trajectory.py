"""``sepv trajectory``: the drift of invariants along a table of states,
and whether its rows are steps of a scheme.
"""

from __future__ import annotations

from pathlib import Path

import click

from sepv.commands import _shared as cli


@click.command(short_help="A table of states: how invariants drift, and whether rows are steps of a scheme.")
@click.argument("file", type=click.Path())
@click.option(
    "--problem", "-p", required=True, metavar="PROBLEM", help="By name, file.json or module:attribute."
)
@click.option("--scheme", metavar="SCHEME", help="Ask whether each row is its step from the row before.")
@click.option("--h", type=cli.POSITIVE, help="The time between rows, if the table has no times.")
@click.option("--no-noise", is_flag=True, help="c = (): the table was made without noise.")
@click.option("-o", "--out", type=cli.OUT, help="Picture: .svg, .png or .pdf.")
@cli.friendly
def trajectory(
    file: str, problem: str, scheme: str | None, h: float | None, no_noise: bool, out: str | None
) -> None:
    """FILE has a row for each time: t, y_1 … y_d, and with noise dW_1 … dW_m of the step that ends
    in this row.

    It may be a .csv, a text of columns, an array of NumPy (.npy) or the JSON of sepv run. A text is
    known to half a unit of its last digit: what these digits explain is not called a drift, nor a
    wrong step.

    \b
    sepv trajectory kepler.csv -p kepler --no-noise
    sepv trajectory run.npy -p mymodule:problem --scheme midpoint

    Exit code 0; 1 if a row is not a step of SCHEME; 2 for wrong usage.
    """
    from dataclasses import replace

    from sepv.console import Table, columns, console, print_table
    from sepv.files import write_atomically
    from sepv.pictures import Axis, Series, looks, panels, require_picture
    from sepv.schemes import load_problem, load_scheme
    from sepv.studies import trajectory as study

    require_picture(out)
    system = load_problem(problem)
    if no_noise:
        system = replace(system, noise=(), data=None, check=False)
    rows = study.read_rows(file, system, h)
    found = study.drifts(rows, system)
    screen = console()
    screen.print(
        f"{Path(file).name}: {rows.steps:,} steps of {system.name} from t = {rows.t[0]:g} to {rows.t[-1]:g}"
    )
    heads = (
        *columns(["invariant"], words=True),
        *columns((), ("largest error",)),
        *columns(["growth"], words=True),
    )
    print_table(Table(heads, [(d.name, f"{d.largest:.3g}", d.sentence()) for d in found], ""), screen)
    if out is not None:
        shown = [Series(d.name, rows.t.tolist(), d.errors.tolist(), d.name, "line") for d in found]
        side = shown, Axis("time t"), Axis("I(y) − I(y0)")
        title = f"{Path(file).name}, {system.name}"
        picture = panels([side], looks([d.name for d in found]), title, Path(out).suffix)
        write_atomically(out, picture)
    if scheme is None:
        return
    chosen = load_scheme(scheme)
    wrong = study.first_mismatch(rows, system, chosen)
    if wrong is None:
        screen.print(f"All {rows.steps:,} rows are steps of {chosen.name}, to the digits of the table.")
        return
    early = rows.dW is not None and wrong.row == 2  # a usual reason: dW one row too early
    screen.print(
        f"Row {wrong.row} is not a step of {chosen.name} from row {wrong.row - 1}: y{wrong.component} is "
        f"{wrong.found!r}, the step gives {wrong.expected!r}, and digits and rounding allow {wrong.bound:.1e}."
        + " Each row has the dW of the step that ends in it."
        * early,
        soft_wrap=True,
    )
    raise SystemExit(1)
