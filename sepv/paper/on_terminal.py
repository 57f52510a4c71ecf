"""A reproduction on the terminal: the statements panel by panel, and progress with the time
left.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

from rich.console import Console
from rich.text import Text

from sepv.console import Column, Table, counted, print_table, showing, statements_in_words

from .record import Statement, counts
from .suite import Reproduction, ShareProgress

_STATEMENT_STYLES = {"holds": "green", "fails": "bold red", "open": "yellow"}


def show(reproduction: Reproduction, out: Console) -> None:
    """Print the statements of each panel with their verdicts and measurements."""
    for panel in reproduction.panels:
        out.print(Text.assemble((panel.title, "bold"), f"  {panel.source}"))
        rows = [Paragraph("", f"chosen: {choice}", "dim") for choice in panel.chosen]
        _print([*rows, *(row for s in panel.statements for row in _rows(s))], out)
    if reproduction.text:
        out.print(Text("As printed", style="bold"))
        _print([row for s in reproduction.text for row in _rows(s)], out)


class Paragraph(NamedTuple):
    """A paragraph of the report and the verdict on its statement;
    the verdict is empty if it makes no statement.
    """

    verdict: str
    text: str
    style: str = ""


def _rows(s: Statement) -> list[Paragraph]:
    rows = [Paragraph(s.verdict, f"{s.text} ({s.source})"), Paragraph("", s.measured, "dim")]
    if s.verdict != "holds":
        rows.append(Paragraph("", f"criterion: {s.criterion}", "dim"))
        rows += [Paragraph("", f"instead: {s.correction}", "dim")] if s.correction else []
    return rows


def _print(rows: Sequence[Paragraph], out: Console) -> None:
    """Print paragraphs wrapped beside their verdicts; if the output is no terminal, one line
    each.
    """
    if not out.is_terminal:
        for row in rows:
            out.print(Text(f"  {row.verdict:<6}{row.text}"), soft_wrap=True)
    else:
        cells = [
            (
                "",
                Text(row.verdict, style=_STATEMENT_STYLES.get(row.verdict, "")),
                Text(row.text, style=row.style),
            )
            for row in rows
        ]
        columns = (Column("indent"), Column("verdict", least=6), Column("text", words=True))
        print_table(Table(columns, cells, headed=False), out)
    out.print()


def summary(reproduction: Reproduction) -> Text:
    """The last line of the report: the numbers of verdicts, and the time taken."""
    n = counts(reproduction.statements)
    text = Text(f"{statements_in_words(n)}; ")
    text.append(
        f"{counted(len(reproduction.panels), 'panel')} in {reproduction.seconds:.0f} s, "
        f"{reproduction.processor_seconds:.0f} s of processor time"
    )
    if reproduction.size.share != 1:
        text.append(f", with a share of {reproduction.size.share:g} of the samples and steps", style="yellow")
    return text.append(".")


@contextmanager
def watching(quiet: bool = False) -> Iterator[ShareProgress]:
    """Show progress on stderr: how many of the estimated seconds of work are done."""
    with showing(quiet) as shown:
        yield lambda done, total: shown.update(
            f"{done:.0f} of {total:.0f} s of work", done / total if total else 1.0
        )
