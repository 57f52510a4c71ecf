"""Measurement of groups of laws in worker processes, each of which measures one group at a time.

Each worker is a new interpreter (`sepv.verification._worker`), not a fork, because a scheme's
library may have threads, and a fork of threads can hang. If a worker crashes, or does not keep a
law's time limit and is killed, this law ends in an error; the run goes on.
"""

from __future__ import annotations

import os
import pickle
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from sepv.children import (
    LOOK_MAX_SECONDS,
    Crashed,
    TimeLimit,
    interruption_answered,
    out_of_time,
    packed,
    pump_all,
    take,
    unpacked,
)
from sepv.errors import UsageError

# Seconds between SIGTERM, on which a worker ends its own children, and SIGKILL.
WORKER_GRACE = 1.0
# The seconds for a new interpreter and its imports on a loaded machine, in addition to a law's time
# for the scheme.
START_SECONDS = 60.0


@dataclass(frozen=True)
class LawJob:
    """The first message to each worker: the scheme, by name if it has one, and how to measure
    it.
    """

    scheme: Any
    claims: frozenset[str]
    effort: Any
    timeout: float
    failures: dict[str, Any]
    problems: Any = None
    twin: Any = None


# The module that a worker process runs.
WORKER = "sepv.verification._worker"


class _Worker:
    """A worker process, the laws that it has still to measure,
    and the time limit of the law that it measures.
    """

    def __init__(self, task: bytes, seconds: float) -> None:
        self.child, self.left = take(WORKER), list[str]()
        self.limit: TimeLimit | None = TimeLimit(seconds + START_SECONDS)
        self.child.send(task)

    def give(self, group: Sequence[str]) -> None:
        """Send these laws to the worker, in this order."""
        self.left = list(group)
        self.child.send(packed(self.left))

    def lost(self, seconds: float) -> Crashed | None:
        """Describe how the worker ended; None if it still works.

        It is killed here if its law does not keep the time limit of `seconds`.
        """
        if self.limit is not None and self.limit.passed():
            self.child.end()
            return Crashed(out_of_time(seconds), self.child.notes.get())
        if not self.child.gone:
            return None
        # A fork of the worker may hold its pipes open, or the worker may have closed them: it is no
        # worker any more.
        status = self.child.status(WORKER_GRACE)
        return Crashed(f"ended with {status}" if status else self.child.gone, self.child.notes.get())


def run(
    task: LawJob, groups: Sequence[Sequence[str]], jobs: int, receive: Callable[[str, Any], None]
) -> None:
    """Measure groups of laws on `jobs` workers; `receive` gets each law's name, first with None,
    then with its finding.

    If a worker crashes or hangs, `receive` gets the law with `Crashed`, and another worker measures
    the rest of the group. If a process cannot load the scheme, a UsageError is raised; for a defect
    of the suite, a RuntimeError.
    """
    data, waiting = _packed(task), [list(group) for group in groups]
    with _ended() as workers:
        busy: list[_Worker] = []

        def start() -> None:
            workers.append(_Worker(data, task.timeout))
            busy.append(workers[-1])
            workers[-1].give(waiting.pop(0))

        for _ in range(min(jobs, len(waiting))):
            start()
        while busy:
            pump_all([worker.child for worker in busy], LOOK_MAX_SECONDS)
            for worker in list(busy):
                while (line := worker.child.line()) is not None:
                    if word := unpacked(line):
                        _hear(worker, word, task.timeout, receive)
                if worker.left and (crash := worker.lost(task.timeout)):
                    receive(worker.left.pop(0), crash)
                    waiting[:0] = [worker.left] if worker.left else []
                    busy.remove(worker)
                    if waiting:
                        start()
                elif not worker.left and waiting:
                    worker.give(waiting.pop(0))
                elif not worker.left:
                    busy.remove(worker)


def _hear(
    worker: _Worker, word: tuple[Any, ...], seconds: float, receive: Callable[[str, Any], None]
) -> None:
    """Receive a message of a worker: that a law begins, its finding,
    or why nothing can be measured.
    """
    kind, *said_of = word
    if kind == "usage":
        raise UsageError(**said_of[0])
    if kind == "defect":
        raise RuntimeError(f"in a worker:\n{said_of[0]}")
    name, finding = said_of
    receive(name, finding)
    worker.limit = TimeLimit(seconds) if finding is None else None
    if finding is not None:
        worker.left.remove(name)


def measured(task: LawJob, group: Sequence[str]) -> list[tuple[str, Any]]:
    """Measure a group of laws in a new process on a cluster's worker;
    return pairs (law's name, finding or `Crashed`).

    The new process has a main thread, which a time limit needs, and a crash ends it instead of the
    cluster's worker.
    """
    results: list[tuple[str, Any]] = []
    run(task, [group], 1, lambda name, finding: None if finding is None else results.append((name, finding)))
    return results


@contextmanager
def _ended() -> Iterator[list[_Worker]]:
    workers: list[_Worker] = []
    try:
        yield workers
    except KeyboardInterrupt:
        interruption_answered()
        raise
    finally:
        for worker in workers:
            worker.child.ask_to_end()
        until = time.monotonic() + WORKER_GRACE
        for worker in workers:
            worker.child.status(until - time.monotonic())
            worker.child.end()


def _packed(task: LawJob) -> bytes:
    try:
        # The path on which the user's modules are found is pickled first.
        data = packed((list(sys.path), os.getcwd(), pickle.dumps(task)))
        owner = getattr(getattr(task.scheme, "step", None), "__module__", "")
    except Exception as error:
        received = f"{type(error).__name__}: {error}"
    else:
        if owner != "__main__":
            return data
        received = "a function of the script or session that runs, which another process cannot import"
    raise UsageError(
        expected="a scheme that another process can import, for jobs > 1",
        received=received,
        remedy="name it as module:attribute, or leave jobs out",
    )
