"""``sepv report``: one HTML page from JSON files."""

from __future__ import annotations

import click

from sepv.commands._shared import FOLDER, OUT, Names, friendly
from sepv.console import Table, columns, console, counted, print_table
from sepv.files import write_atomically


@click.command(short_help="One HTML page from the JSON files of the others.")
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=click.Path())
@click.option("-o", "--out", type=OUT, default="report.html", help="The page.")
@click.option("--title", help="Its heading. [default: a question, after the name of a single scheme]")
@click.option(
    "--asv", type=FOLDER, help="Also write defects, errors and times as results of asv for this commit."
)
@click.option("-q", "--quiet", is_flag=True, help="Print nothing.")
@friendly
def report(files: Names, out: str, title: str | None, asv: str | None, quiet: bool) -> None:
    """One self-contained HTML page from the JSON FILEs of verify, compare, bench and reproduce.

    `sepv verify --html` makes the page of one scheme directly.

    Of two reports about one scheme, before and after a change, the page and the terminal show what
    changed.

    The page needs no network and no JavaScript. It can be printed, and it follows the reader's
    light or dark theme. matplotlib (extra plots) draws the pictures of compare and reproduce.

    \b
    sepv verify energy-preserving --json ep.json
    sepv verify midpoint --json mid.json
    sepv report ep.json mid.json --out report.html
    sepv report before.json after.json

    Exit code 0, or 2 for wrong usage.
    """
    from sepv.page import changes, load, render, write_asv

    sources = load(files)
    count = write_asv(sources, asv) if asv else 0
    page = render(sources, title=title)
    write_atomically(out, page)
    if not quiet:
        for scheme, rows in changes(sources.verify):
            heads = columns(["law"]) + columns(["before", "after"], words=True)
            if rows:
                print_table(Table(heads, rows, f"{scheme}: what changed"), console())
            else:
                click.echo(f"{scheme}: nothing changed")
        if asv:
            click.echo(f"{asv}: {counted(count, 'number')} for asv")
        click.echo(f"{out}: {len(page.encode()) / 1000:.0f} kB")
