"""A program's text for a terminal or a page."""

from __future__ import annotations


def shown(line: bytes, most: int = 200) -> str:
    return clean(line.decode(errors="backslashreplace"), most)


def clean(text: str, most: int = 200) -> str:
    """A program's text for a terminal or a page: no control characters, not endless."""
    safe = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text[:most])
    return safe + ("…" if len(text) > most else "")
