"""Consoles of rich: colour on terminals only, no markup,
and no message if the reader closes the pipe.
"""

from __future__ import annotations

import os
import sys
from typing import Any, TextIO

from rich.console import Console
from rich.text import Text

from sepv.console._text import ascii_cell, cannot_show, printable_cell


def console(file: TextIO | None = None, *, stderr: bool = False) -> Console:
    """A console with colour on terminals only (rich obeys NO_COLOR),
    and wide enough for a table when piped.
    """
    out = file or (sys.stderr if stderr else sys.stdout)
    width = None if out.isatty() or "COLUMNS" in os.environ else 100
    return (_Ascii if cannot_show(out) else _Console)(file=out, highlight=False, markup=False, width=width)


class _Console(Console):
    """A console that exits with 141, as for SIGPIPE, if its reader closes the pipe (``| head``).

    Rich would exit with 1, which is a verdict here. Control characters are escaped and brackets are
    no markup, because names and messages may come from others.
    """

    def print(self, *objects: Any, **options: Any) -> None:
        super().print(*(printable_cell(o) for o in objects), **options)

    def on_broken_pipe(self) -> None:
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(141)


class _Ascii(_Console):
    """A console whose encoding lacks signs such as Δ: texts are converted to ASCII before they are
    laid out.
    """

    def print(self, *objects: Any, **options: Any) -> None:
        super().print(*(ascii_cell(o) for o in objects), **options)


def print_sentence(out: Console, text: Text) -> None:
    """Print a sentence: wrapped on a terminal, on one line if a program reads the output."""
    out.print(text, soft_wrap=not out.is_terminal)


def plain_console(file: TextIO) -> Console:
    """A console of 100 columns without colour, for text that is stored in a file."""
    return _Console(file=file, highlight=False, markup=False, width=100, color_system=None)
