"""Output of commands: texts that do nothing to a terminal, tables, consoles and progress.

Read `_tables` first; `_text` has the ASCII of our signs. `_console` is loaded when a console is asked for, because it
needs rich, and `_progress` shows work that takes more than two seconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sepv.console._progress import Shown as Shown
from sepv.console._progress import showing as showing
from sepv.console._tables import Column as Column
from sepv.console._tables import Table as Table
from sepv.console._tables import columns as columns
from sepv.console._tables import fits as fits
from sepv.console._tables import kept as kept
from sepv.console._tables import longest as longest
from sepv.console._tables import markdown as markdown
from sepv.console._tables import print_table as print_table
from sepv.console._text import ascii_cell as ascii_cell
from sepv.console._text import ascii_text as ascii_text
from sepv.console._text import cannot_show as cannot_show
from sepv.console._text import counted as counted
from sepv.console._text import never_fail as never_fail
from sepv.console._text import printable as printable
from sepv.console._text import printable_cell as printable_cell

if TYPE_CHECKING:
    from sepv.console._console import console as console
    from sepv.console._console import plain_console as plain_console
    from sepv.console._console import print_sentence as print_sentence


def __getattr__(name: str) -> Any:
    if name not in ("console", "print_sentence", "plain_console"):
        raise AttributeError(f"module 'sepv.console' has no attribute {name!r}")
    from sepv.console import _console

    return getattr(_console, name)
