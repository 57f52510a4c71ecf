"""Child processes and what watches them: every child has a limit, a last note and an end.

`Watched` is what all of them have: lines, a status and an end. `Child` starts a program that
answers lines, of this package or another; the watcher of a command makes a fork instead.
`Journal` and `attempted` are a child's side of the watch: results that survive a crash, and notes
on what it does. `deadline` interrupts Python code within a process.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sepv._lazy import lazily
from sepv.children._deadline import TimedOut, deadline, one_process, returned_twice
from sepv.children._journal import (
    LOOK_MAX_SECONDS,
    Crashed,
    Journal,
    Message,
    Notes,
    TimeLimit,
    attempted,
    collect_seldom,
    command_started,
    current_journal,
    ended_with,
    interruption_answered,
    note_case,
    note_step,
    note_violation,
    open_journal,
    out_of_time,
    packed,
    unpacked,
)
from sepv.children._watched import NoLine, Watched, kill_tree

if TYPE_CHECKING:
    from sepv.children._bell import overheard
    from sepv.children._child import Child, pump_all
    from sepv.children._parent import end_with_parent
    from sepv.children._workers import cores, start_ahead, take

# A command's watcher starts no child in this way, and does not load what it takes.
__getattr__, __dir__ = lazily(
    __name__,
    {
        "_bell": "overheard",
        "_child": "Child pump_all",
        "_parent": "end_with_parent",
        "_workers": "cores start_ahead take",
    },
)
