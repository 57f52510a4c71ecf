"""Text of users and programs, cleaned for the page; the template engine escapes it."""

from __future__ import annotations

import math
import unicodedata

# The largest numbers of characters of names and messages on the page. The JSON file has the full
# texts.
NAME, MESSAGE = 60, 1500
_WHITE = "\n\t"


def plain(text: object, limit: int = MESSAGE) -> str:
    """Return text without control and formatting characters (such as right-to-left overrides),
    cut to `limit`.
    """
    shown = "".join(
        c if c in _WHITE or unicodedata.category(c) not in ("Cc", "Cf", "Cs", "Co", "Cn") else "�"
        for c in str(text)[: limit + 1]
    )
    return shown if len(shown) <= limit else f"{shown[:limit]}… ({len(str(text))} characters)"


def name(text: object) -> str:
    """Return a name for headings and tables, as one short line."""
    return " ".join(plain(text, NAME).split()) or "(no name)"


def number(value: float | None) -> str:
    """Format a number with two or three digits and a minus sign (−); the text is empty for None."""
    if value is None:
        return ""
    if not math.isfinite(value):
        return "not finite"
    text = f"{value:.3g}" if value == 0 or 1e-3 <= abs(value) < 1e5 else f"{value:.1e}"
    return text.replace("-", "−")
