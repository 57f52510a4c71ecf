"""What a terminal can show: ASCII that reads the same where it knows no more."""

from __future__ import annotations

import codecs
import unicodedata
from typing import Any

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


def ascii_cell(cell: Any) -> Any:
    """A string or a `rich.text.Text` in ASCII; anything else as it is."""
    if isinstance(cell, str):
        return ascii_text(cell)
    if hasattr(cell, "plain"):
        return type(cell)(ascii_text(cell.plain), style=cell.style, overflow=cell.overflow)
    return cell


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
