"""The processes that measure laws (`sepv.verification._side_by_side`). They may start early, to import in parallel."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from tempfile import TemporaryFile

from sepv._journal import BYTES, Notes

# The largest number of processes that is chosen here. With more, the longest group of laws determines the time.
MOST = 4
# The number of new objects after which Python searches for cycles of objects, chosen for the speed of `sepv verify`.
OBJECTS = 5000
_WAITING: list[tuple[subprocess.Popen[bytes], Notes]] = []


def collect_seldom() -> None:
    """Let the garbage collector run seldom: cases are many small objects without cycles."""
    gc.set_threshold(max(OBJECTS, gc.get_threshold()[0]))


def cores() -> int:
    """The number of processors that this process may use, at most MOST; 1 where processes cannot inherit a file."""
    if os.name != "posix":
        return 1
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(usable, MOST)


def start_ahead(count: int) -> None:
    """Start interpreters that `take` will return. Without a task they end with this process."""
    _WAITING.extend(_started() for _ in range(count))


def take() -> tuple[subprocess.Popen[bytes], Notes]:
    """Return a worker process that waits for its task, and its notes."""
    return _WAITING.pop() if _WAITING else _started()


def _started() -> tuple[subprocess.Popen[bytes], Notes]:
    with TemporaryFile() as file:
        file.truncate(BYTES)
        notes = Notes(file.fileno())
        process = subprocess.Popen(
            [sys.executable, "-m", "sepv.verification._worker", str(file.fileno())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=(file.fileno(),),
            # A session of its own keeps Ctrl-C from the worker. The parent gets Ctrl-C and ends the workers.
            start_new_session=True,
            # The worker must import sepv before it can read the task, which contains sys.path.
            env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
        )
    return process, notes
