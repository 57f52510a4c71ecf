"""Progress while the laws run: a live line on a terminal, nothing where output is piped."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from sepv.law import Finding, Law
from sepv.report import console
from sepv.suite import LAWS, Progress


@contextmanager
def watching(quiet: bool = False) -> Iterator[Progress]:
    """A progress callback for `sepv.suite.verify`, on stderr."""
    out = console(stderr=True)
    if quiet or not out.is_terminal:
        yield lambda _law, _finding: None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("{task.description:<20}"), BarColumn(30), MofNCompleteColumn(), TimeElapsedColumn())
    with Bar(*columns, console=out, transient=True) as bar:
        task = bar.add_task("", total=len(LAWS))

        def step(law: Law, finding: Finding | None) -> None:
            bar.update(task, description=law.name, advance=0 if finding is None else 1)

        yield step
