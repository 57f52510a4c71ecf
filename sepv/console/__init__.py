"""Output of commands: texts without control characters, tables, consoles and progress.

Read `_tables` first. `_text` escapes control characters and converts signs to ASCII. `_console` is
loaded when a console is used, because it needs rich. `_progress` shows the progress of work that
takes more than two seconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sepv._lazy import lazily
from sepv.console._progress import ShownProgress, showing
from sepv.console._tables import (
    Column,
    Table,
    columns,
    facts,
    fits,
    html,
    kept,
    longest,
    markdown,
    print_table,
)
from sepv.console._text import (
    ascii_cell,
    ascii_text,
    cannot_show,
    counted,
    never_fail,
    printable,
    printable_cell,
    statements_in_words,
)

if TYPE_CHECKING:
    from sepv.console._console import console, plain_console, print_sentence


__getattr__, __dir__ = lazily(__name__, {"_console": "console print_sentence plain_console"})
