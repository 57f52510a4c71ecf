"""Processes that wait for a task. They may start early, to import in parallel."""

from __future__ import annotations

import os

from sepv.children._child import Child

# The largest number of processes that is chosen here. With more, the longest group of laws
# determines the time.
WORKERS_MAX = 4
_WAITING_WORKERS: dict[str, list[Child]] = {}


def cores() -> int:
    """The number of processors to use here, at most WORKERS_MAX;
    1 where processes cannot inherit a file.
    """
    if os.name != "posix":
        return 1
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(usable, WORKERS_MAX)


def start_ahead(module: str, count: int) -> None:
    """Start interpreters that run a module and that `take` will return.
    Without a task they end with this process.
    """
    _WAITING_WORKERS.setdefault(module, []).extend(Child.of_module(module, noted=True) for _ in range(count))


def take(module: str) -> Child:
    """Return a process that runs `module` and waits for its task."""
    waiting = _WAITING_WORKERS.get(module)
    return waiting.pop() if waiting else Child.of_module(module, noted=True)
