"""Changes of verdicts between versions of a library: ``python -m benchmarks.peers.trend``."""

from __future__ import annotations

from pathlib import Path

import click

from benchmarks.peers import changes as compared
from benchmarks.peers.records import load
from benchmarks.peers.trend_page import page
from sepv.commands import shared as cli
from sepv.console import Table, columns, console, print_table
from sepv.errors import require_one_of
from sepv.files import json_text, write_atomically


@click.command(short_help="Which verdict changed, in which version of a library.")
@click.argument("folder", default="results", type=cli.FOLDER)
@click.option("--library", metavar="NAME", help="Only this one.")
@click.option("--json", "json_file", type=cli.OUT, help="Write cells, changes and deviations to this file.")
@click.option("--out", type=cli.OUT, help="Write the page of the site, Markdown, to this file.")
@click.option("-q", "--quiet", is_flag=True, help="Only the changes, a line each.")
@cli.friendly
def main(folder: str, library: str | None, json_file: str | None, out: str | None, quiet: bool) -> None:
    """Compare the records of FOLDER (default: results), version by version.

    \b
    python -m benchmarks.peers.trend
    python -m benchmarks.peers.trend results --library diffrax --json trend.json
    python -m benchmarks.peers.trend results --out docs/trend.md
    """
    found = load(Path(folder))
    if library is not None:
        remedy = "measure it first: python -m benchmarks.peers.releases LIBRARY VERSION"
        require_one_of(f"a library of {folder}", library, found, remedy)
        found = {library: found[library]}
    if json_file:
        write_atomically(json_file, json_text(compared.to_json(found)))
    if out:
        write_atomically(out, page(found))
    screen = console()
    for name, records in found.items():
        last = compared.latest(records)
        if not quiet:
            heads = columns(["solver"]) + columns([r.version for r in last], words=True)
            rows = [(s, *(compared.cell(r, s) for r in last)) for s in compared.solvers(records)]
            print_table(Table(heads, rows, name), screen)
        for c in compared.changes(records):
            what = f"{c.solver}, {c.law}" if c.law else c.solver
            screen.print(f"{name} {c.since} → {c.version}: {what}: {c.before} → {c.after}", soft_wrap=True)
        for d in compared.deviations(records):
            seen = f"seen in {', '.join(d.seen)}" if d.seen else "not seen"
            mended = f"; mended in {d.mended}" if d.mended else ""
            screen.print(f"{d.title} {seen}{mended}", soft_wrap=True)
        if not quiet:
            screen.print()


if __name__ == "__main__":
    main()
