"""Tables on a terminal, in Markdown and in HTML.

If a table is too wide for its terminal, columns are left out, the least important first. Digits are
never cut.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import TYPE_CHECKING, Any

from sepv.console._text import ascii_cell, cannot_show, printable_cell

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    Cell = str | Text

# The least width at which a column of words reads well.
WORDS_MIN_WIDTH = 24


@dataclass(frozen=True)
class Column:
    """A column of a table. Columns with the same heading have one width, and are left out
    together.
    """

    heading: str
    right: bool = False  # numbers are aligned at the right
    words: bool = False  # texts may be broken between words, and within a word if no column can be dropped
    # The order in which columns are dropped on a narrow terminal, 1 first; 0 for a column that
    # stays.
    goes: int = 0
    least: int = 0  # the least width, in cells of a terminal


@dataclass(frozen=True)
class Table:
    """A table: columns, and rows with a cell for each column, a string or a `rich.text.Text`."""

    columns: tuple[Column, ...]
    rows: Sequence[Sequence[Cell]]
    title: Cell = ""
    caption: Cell = ""
    ruled: bool = False  # True for a line under the headings, on a terminal that is wide enough
    edged: bool = True  # True for blanks around a ruled table
    headed: bool = True  # True if the headings are shown


def columns(
    left: Iterable[str], right: Iterable[str] = (), *, goes: Sequence[str] = (), **more: Any
) -> tuple[Column, ...]:
    """Make columns of words, then of numbers, from headings;
    those in `goes` are left out in turn if space is short.
    """
    order = {heading: place for place, heading in enumerate(goes, 1)}
    listed = [*(Column(h, **more) for h in left), *(Column(h, right=True) for h in right)]
    return tuple(replace(c, goes=order.get(c.heading, 0)) for c in listed)


def print_table(table: Table, out: Console) -> None:
    """Print a table. On a narrow console whole columns are left out, and a line below names
    them.
    """
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    table = _with_cells(table, printable_cell)
    if cannot_show(out.file):
        table = _with_cells(table, ascii_cell)
    width, ruled = out.width, _ruled(table, out.width)
    needed, between = _laid(table, width)
    # Columns with the same heading are shown or dropped together.
    times = [c.heading for c in table.columns]
    total = {h: n * times.count(h) + between * (times.count(h) - 1) for h, n in needed.items()}
    order = {c.heading: c.goes for c in table.columns if c.goes}
    # rich counts the blanks after the last column, and does not print them.
    room = width - _edges(table, width) - (between - ruled)
    left = kept(total, room, sorted(order, key=order.__getitem__), between)
    title = Text(table.title, style="bold") if isinstance(table.title, str) and table.title else table.title
    shown = RichTable(
        box=box.SIMPLE_HEAD if ruled else None,
        title=title or None,
        caption=table.caption or None,
        title_justify="left",
        caption_justify="left",
        show_header=table.headed,
        show_edge=table.edged,
        pad_edge=False,
        padding=(0, between - ruled, 0, 0),
        # The table is at least as wide as its title if the terminal allows it; else a narrow table
        # breaks the title.
        min_width=min(longest([_plain(table.title)]), 80, width) if table.title else None,
    )
    chosen = [n for n, c in enumerate(table.columns) if c.heading in left]
    for n in chosen:
        c = table.columns[n]
        shown.add_column(
            c.heading,
            justify="right" if c.right else "left",
            overflow="fold",
            width=None if c.words else needed[c.heading],
        )
    for row in table.rows:
        shown.add_row(*(row[n] for n in chosen))
    out.print(shown)
    gone = dict.fromkeys(c.heading for c in table.columns if c.heading not in left)
    if gone:
        out.print(f"Left out, for width: {', '.join(' '.join(h.split()) for h in gone)}.", style="dim")


def fits(table: Table, out: Console) -> bool:
    """True if the console is wide enough for all columns of the table, so that none is left out."""
    needed, between = _laid(table, out.width)
    return sum(needed[c.heading] + between for c in table.columns) <= out.width - _edges(table, out.width)


def _ruled(table: Table, width: int) -> bool:
    return table.ruled and width >= 60


def _edges(table: Table, width: int) -> int:
    return 2 if table.edged and _ruled(table, width) else 0


def _laid(table: Table, width: int) -> tuple[dict[str, int], int]:
    """The widths of columns by heading, and the number of blanks between columns,
    for a console of this width.

    Each heading is on one line, with two blanks between columns, if all columns fit in this way.
    """
    room = width - _edges(table, width)
    least = 2 if _ruled(table, width) else 1
    for whole, words, between in ((True, WORDS_MIN_WIDTH, 2), (False, WORDS_MIN_WIDTH, 2), (False, 0, least)):
        needed = _needed(table, whole=whole, words=words)
        if sum(needed[c.heading] + between for c in table.columns) <= room:
            break
    return _needed(table, whole=whole), between


def _with_cells(table: Table, change: Callable[[Any], Any]) -> Table:
    """Apply a function to each text of a table, before the layout,
    because in ASCII a text may have more characters.
    """
    return replace(
        table,
        columns=tuple(replace(c, heading=change(c.heading)) for c in table.columns),
        rows=[[change(cell) for cell in row] for row in table.rows],
        title=change(table.title),
        caption=change(table.caption),
    )


def _needed(table: Table, *, whole: bool = False, words: int = 0) -> dict[str, int]:
    """The least widths of columns by heading.

    A column is at least as wide as the longest line of its cells, and as the longest word of its
    heading (the longest line if `whole`). A column of words is at least as wide as its longest
    word, and as its longest cell up to `words`.
    """
    widths: dict[str, int] = {}
    for n, c in enumerate(table.columns):
        texts = [_plain(row[n]) for row in table.rows]
        pieces = [p for text in texts for p in (text.split() if c.words else text.splitlines())]
        heading = (c.heading.splitlines() if whole else c.heading.split()) if table.headed else ()
        longest_piece = longest([*pieces, *heading])
        comfortable = min(longest(texts), words) if c.words else 0
        widths[c.heading] = max(widths.get(c.heading, 0), longest_piece, c.least, comfortable)
    return widths


def kept(needed: Mapping[str, int], width: int, dropped: Sequence[str], between: int = 1) -> list[str]:
    """The headings of the columns that fit into a width, with `between` blanks between them.

    `needed` has the widths by heading. Columns are dropped in the order of `dropped` until the
    remaining ones fit.
    """
    left = dict(needed)
    for heading in dropped:
        if sum(left.values()) + between * (len(left) - 1) <= width:
            break
        left.pop(heading, None)
    return list(left)


def markdown(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """The lines of a table of Markdown."""
    head, *body = ("| " + " | ".join(line) + " |" for line in (headings, *rows))
    return "\n".join([head, "|" + "---|" * len(headings), *body])


def html(*tables: Table) -> str:
    """Tables with equal headings as one table of HTML for a notebook,
    with a line for the title of each.

    All texts are escaped, and so are characters that are invisible or change the direction of
    writing.
    """

    def cells(tag: str, row: Sequence[Cell]) -> str:
        sides = ("right" if c.right else "left" for c in tables[0].columns)
        return "".join(
            f'<{tag} style="text-align:{side}">{_inert(cell)}</{tag}>'
            for side, cell in zip(sides, row, strict=True)
        )

    lines = [f"<tr>{cells('th', [c.heading for c in tables[0].columns])}</tr>"] if tables[0].headed else []
    for table in tables:
        if table.title:
            span = f'colspan="{len(table.columns)}" style="text-align:left"'
            lines.append(f"<tr><th {span}>{_inert(table.title)}</th></tr>")
        lines += [f"<tr>{cells('td', row)}</tr>" for row in table.rows]
    return f'<div style="overflow-x:auto"><table>{"".join(lines)}</table></div>'


def facts(title: str, rows: Iterable[tuple[str, str]]) -> Table:
    """A table of names and values, without headings."""
    return Table((Column("name"), Column("value", words=True)), list(rows), title, headed=False)


def _inert(cell: Cell) -> str:
    return escape(_plain(printable_cell(cell)))


def longest(texts: Iterable[str]) -> int:
    """The width of the widest text in cells of a terminal, 0 for none."""
    from rich.cells import cell_len

    return max(map(cell_len, texts), default=0)


def _plain(cell: Cell) -> str:
    return cell if isinstance(cell, str) else cell.plain
