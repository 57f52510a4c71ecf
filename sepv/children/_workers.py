"""The processes that measure laws (`sepv.verification._side_by_side`).

They may start early, to import in parallel.
"""

from __future__ import annotations

import os

from sepv.children._child import Child

# The largest number of processes that is chosen here. With more, the longest group of laws determines the
# time.
WORKERS_MAX = 4
_WAITING: list[Child] = []


def cores() -> int:
    """The number of processors to use here, at most WORKERS_MAX; 1 where processes cannot inherit a file."""
    if os.name != "posix":
        return 1
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(usable, WORKERS_MAX)


def start_ahead(count: int) -> None:
    """Start interpreters that `take` will return. Without a task they end with this process."""
    _WAITING.extend(_started() for _ in range(count))


def take() -> Child:
    """Return a worker process that waits for its task."""
    return _WAITING.pop() if _WAITING else _started()


def _started() -> Child:
    return Child.of_module("sepv.verification._worker", noted=True)
