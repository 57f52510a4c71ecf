"""A process that says when this one hangs: in a loop of compiled code no thread of Python says
anything.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

from sepv.children._child import Child
from sepv.children._journal import KILL_GRACE, current_journal

# Reads lines "SECONDS TEXT" and prints the last text if no line follows in time, until stdin ends.
_PROGRAM = """
import os, select
wait, text = None, b""
while True:
    if not select.select([0], [], [], wait)[0]:
        os.write(2, text + b"\\n")
        wait = None
    elif data := os.read(0, 4096):
        seconds, _, text = data.splitlines()[-1].partition(b" ")
        wait = float(seconds)
    else:
        break
"""


@contextmanager
def overheard(seconds: float) -> Iterator[Callable[[], None]]:
    """A context whose work should take at most `seconds`;
    the function that it gives begins the next such work.

    KILL_GRACE seconds after the limit another process writes to stderr what ends this one. Where a
    process watches already, or none can be started, nothing is done.
    """
    try:
        # It ends when its stdin does, without a signal. So this process is not copied to start it,
        # which takes tens of milliseconds for hundreds of MB (`subprocess` calls vfork).
        bell = partial(Child, [sys.executable, "-ISc", _PROGRAM], preexec_fn=None)
        child = None if os.name != "posix" or current_journal() else bell()
    except OSError:
        child = None
    if child is None:
        yield lambda: None
        return
    text = (
        f"{seconds + KILL_GRACE} sepv: no end {KILL_GRACE:g} s after the time limit of {seconds:g} s, "
        "which cannot interrupt compiled code, nor code that catches every exception. "
        "`sepv verify`, or jobs=2 of sepv.verify, would have "
        f"ended it; kill -9 {os.getpid()} ends this process\n"
    )

    def begin() -> None:
        child.send(text.encode())

    begin()
    try:
        yield begin
    finally:
        child.end()
