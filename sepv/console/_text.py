"""Texts without characters that affect a terminal, in ASCII if an encoding has only that."""

from __future__ import annotations

import codecs
import unicodedata
from collections.abc import Mapping
from typing import Any

# The ASCII text for each sign of pages and messages; any other sign is decomposed or escaped.
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


def printable(text: str, allowed: str = "\n\t") -> str:
    """Escape every character that affects a terminal, or is invisible on it,
    except the `allowed` ones.

    Names and messages may come from files and programs of others. Escape sequences, bells, marks
    that change the direction of writing and lone surrogates are escaped.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in allowed else repr(c)[1:-1] for c in text)


def printable_cell(cell: Any) -> Any:
    """Apply `printable` to a string or a `rich.text.Text`; anything else is returned unchanged."""
    if isinstance(cell, str):
        return printable(cell)
    if hasattr(cell, "plain") and cell.plain != (safe := printable(cell.plain)):
        return type(cell)(safe, style=cell.style, overflow=cell.overflow)
    return cell


def ascii_text(text: str) -> str:
    """Convert a text to ASCII, with signs such as ≤ and Σ written out."""
    return "".join(c if c.isascii() else _character(c) for c in text)


def ascii_cell(cell: Any) -> Any:
    """Convert a string or a `rich.text.Text` to ASCII; anything else is returned unchanged."""
    if isinstance(cell, str):
        return ascii_text(cell)
    if hasattr(cell, "plain"):
        return type(cell)(ascii_text(cell.plain), style=cell.style, overflow=cell.overflow)
    return cell


def counted(number: int, what: str) -> str:
    """A number with its noun in the singular or plural: 1 law, 27 laws."""
    return f"{number} {what}" + ("" if number == 1 else "s")


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
    """True if the stream's encoding is not Unicode, so that it may lack signs of sepv's tables such
    as Δ.
    """
    return not (getattr(stream, "encoding", None) or "utf-8").lower().replace("_", "-").startswith("utf")


def never_fail(stream: Any) -> None:
    """Make a stream write in ASCII each sign that its encoding lacks,
    and a lone surrogate as an escape.
    """
    codecs.register_error(_NAME, _replace)
    if hasattr(stream, "reconfigure"):
        stream.reconfigure(errors=_NAME)


def statements_in_words(counts: Mapping[str, int]) -> str:
    """The numbers of verdicts in words, such as "12 statements: 10 hold, 1 does not, 1 open"."""
    holds, fails = counts["holds"], counts["fails"]
    return (
        f"{counted(sum(counts.values()), 'statement')}: {holds} hold{'s' * (holds == 1)}, "
        f"{fails} {'does' if fails == 1 else 'do'} not, {counts['open']} open"
    )
