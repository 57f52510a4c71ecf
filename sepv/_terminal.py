"""What a terminal can show: ASCII that reads the same where it knows no more, and tables that fit its width.

Of a table that is too wide columns go, the least important first, and digits never.
"""

from __future__ import annotations

import codecs
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table

# What the pages and messages use; everything else goes by its decomposition, or as an escape.
_ASCII = {
    "≤": "<=", "≥": ">=", "≠": "!=", "−": "-", "–": "-", "—": "-", "‑": "-", "·": "*", "×": "x",
    "∘": "o", "±": "+-", "…": "...", "√": "sqrt ", "Σ": "sum", "∑": "sum", "∇": "grad ",
    "∫": "int ", "Δ": "Delta", "Φ": "Phi", "θ": "theta", "ζ": "zeta", "ξ": "xi", "τ": "tau",
    "φ": "phi", "ϱ": "rho", "ν": "nu", "µ": "u", "μ": "mu", "§": "section ", "ᵀ": "^T", "⁻": "^-",
    "¹": "^1", "²": "^2", "³": "^3", "′": "'", "∈": "in", "→": "->", "←": "<-", "∞": "inf",
    "∂": "d", "ℝ": "R", "⌈": "ceil(", "⌉": ")", "“": '"', "”": '"', "‘": "'", "’": "'", "≈": "~",
    "²⁻": "^-", "✓": "ok", "✗": "x", "━": "-", "─": "-", "│": "|", "╸": "-", "╺": "-", "•": "*",
    "½": "1/2", "¼": "1/4", "ö": "oe", "ü": "ue", "ä": "ae", "ß": "ss",
}  # fmt: skip
_NAME = "sepv-ascii"


def ascii_text(text: str) -> str:
    """The text in ASCII."""
    return "".join(c if c.isascii() else _character(c) for c in text)


def _character(c: str) -> str:
    if c in _ASCII:
        return _ASCII[c]
    plain = unicodedata.normalize("NFKD", c).encode("ascii", "ignore").decode()
    return plain or c.encode("ascii", "backslashreplace").decode()


def _replace(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return ascii_text(error.object[error.start : error.end]), error.end


def cannot_show(stream: Any) -> bool:
    """Whether the stream's encoding lacks what our tables are made of."""
    return not (getattr(stream, "encoding", None) or "utf-8").lower().replace("_", "-").startswith("utf")


def never_fail(stream: Any) -> None:
    """From now on the stream writes what its encoding lacks in ASCII; a lone surrogate goes as an escape."""
    codecs.register_error(_NAME, _replace)
    if hasattr(stream, "reconfigure"):
        stream.reconfigure(errors=_NAME)


def kept(needed: Mapping[str, int], width: int, dropped: Sequence[str], between: int = 1) -> list[str]:
    """The columns that fit into the width: those of `dropped` go in their order, as far as they must.

    Parameters
    ----------
    needed : mapping of heading to width
    between : int
        Blanks between two columns.
    """
    left = dict(needed)
    for heading in dropped:
        if sum(left.values()) + between * (len(left) - 1) <= width:
            break
        left.pop(heading, None)
    return list(left)


def fitted(table: Table, width: int, dropped: Sequence[str], wrapped: Sequence[str] = ()) -> Table:
    """The same table without the columns that must go, the others wide enough for whole numbers.

    Parameters
    ----------
    dropped : headings
        What may go, the least important first.
    wrapped : headings
        Columns of words, which may be broken between words, and within one where nothing else is left to go.
    """
    heads = [str(c.header) for c in table.columns]
    cells = [list(map(str, c.cells)) for c in table.columns]
    # Columns of one heading go together, and are as wide as the widest of them.
    least: dict[str, int] = {}
    for head, column in zip(heads, cells, strict=True):
        own = longest(w for cell in column for w in _pieces(cell, head in wrapped))
        least[head] = max(least.get(head, 0), longest(head.split()), own)
    _, right, _, left = table.padding
    between = left + right + (table.box is not None)
    needed = {head: least[head] * heads.count(head) + between * (heads.count(head) - 1) for head in least}
    # rich counts the blank after the last column, and does not print it.
    left_over = kept(needed, width - left - right, dropped, between)
    table.columns = [c for c in table.columns if str(c.header) in left_over]
    for number, shown in enumerate(table.columns):
        head = str(shown.header)
        shown._index = number  # where rich looks for the column's cells in a row that it styles
        shown.no_wrap = False
        shown.overflow = "fold"
        if head not in wrapped:
            shown.width = least[head]
    return table


def _pieces(cell: str, by_word: bool) -> list[str]:
    return cell.split() if by_word else cell.splitlines()


def longest(texts: Iterable[str]) -> int:
    """The width of the widest of them in cells of a terminal, 0 for none."""
    from rich.cells import cell_len

    return max(map(cell_len, texts), default=0)
