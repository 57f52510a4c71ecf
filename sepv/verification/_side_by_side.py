"""Measurement of groups of laws in worker processes, each of which measures one group at a time.

Each worker is a new interpreter (`sepv.verification._worker`), not a fork, because a scheme's library may have threads,
and a fork of threads can hang. Messages are pickled. If a worker crashes, one law ends in an error; the run goes on.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

from sepv._journal import Crashed, ended_with, interruption_answered
from sepv._processes import take
from sepv.errors import UsageError

# Seconds between SIGTERM, on which a worker ends its own children, and SIGKILL.
GRACE = 1.0


@dataclass(frozen=True)
class LawJob:
    """The first message to each worker: the scheme, by name if it has one, and how to measure it."""

    scheme: Any
    claims: frozenset[str]
    effort: Any
    timeout: float
    failures: dict[str, Any]
    problems: Any = None
    twin: Any = None


class _Worker:
    """A worker process, and a thread of the parent that puts the worker's messages into the queue of all workers."""

    def __init__(self, task: bytes, answers: queue.Queue[tuple[_Worker, Any]]) -> None:
        self.process, self.notes = take()
        self.left: list[str] = []
        self._write(task)
        self.listener = threading.Thread(target=self._listen, args=(answers,), daemon=True)
        self.listener.start()

    def give(self, group: Sequence[str]) -> None:
        """Send these laws to the worker, in this order."""
        self.left = list(group)
        self._write(pickle.dumps(self.left))

    def _write(self, data: bytes) -> None:
        assert self.process.stdin
        with suppress(BrokenPipeError):  # the reader notices that the process has ended
            self.process.stdin.write(data)
            self.process.stdin.flush()

    def _listen(self, answers: queue.Queue[tuple[_Worker, Any]]) -> None:
        assert self.process.stdout
        with self.process.stdout as pipe:
            try:
                while True:
                    answers.put((self, pickle.load(pipe)))
            except Exception:  # the end of the pipe, or half a message before it
                answers.put((self, Crashed(ended_with(self.process.wait()), self.notes.get())))

    def end(self, number: int) -> None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid, number)


def run(
    task: LawJob, groups: Sequence[Sequence[str]], jobs: int, receive: Callable[[str, Any], None]
) -> None:
    """Measure groups of laws on `jobs` workers; `receive` gets each law's name, first with None, then with its finding.

    If a worker crashes, `receive` gets the law with `Crashed`, and another worker measures the rest of the group. If a
    process cannot load the scheme, a UsageError is raised; for a defect of the suite in a worker, a RuntimeError.
    """
    data, waiting = _pickled(task), [list(group) for group in groups]
    answers: queue.Queue[tuple[_Worker, Any]] = queue.Queue()
    with _ended() as workers:
        busy: set[_Worker] = set()

        def start() -> None:
            workers.append(_Worker(data, answers))
            busy.add(workers[-1])
            workers[-1].give(waiting.pop(0))

        for _ in range(min(jobs, len(waiting))):
            start()
        while busy:
            try:
                worker, word = answers.get(timeout=0.5)
            except queue.Empty:  # a time limit, because some systems notice Ctrl-C only between waits
                continue
            if isinstance(word, Crashed):
                busy.discard(worker)
                if worker.left:
                    receive(worker.left.pop(0), word)
                    waiting[:0] = [worker.left] if worker.left else []
                if waiting:
                    start()
                continue
            kind, *said_of = word
            if kind == "usage":
                raise UsageError(**said_of[0])
            if kind == "defect":
                raise RuntimeError(f"in a worker:\n{said_of[0]}")
            name, finding = said_of
            receive(name, finding)
            if finding is not None:
                worker.left.remove(name)
            if not worker.left and waiting:
                worker.give(waiting.pop(0))
            elif not worker.left:
                busy.discard(worker)


def measured(task: LawJob, group: Sequence[str]) -> list[tuple[str, Any]]:
    """Measure a group of laws in a new process on a cluster's worker; return pairs (law's name, finding or `Crashed`).

    The new process has a main thread, which a time limit needs, and a crash ends it instead of the cluster's worker.
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
            worker.end(signal.SIGTERM)
        for worker in workers:
            try:
                worker.process.wait(GRACE)
            except subprocess.TimeoutExpired:
                worker.end(signal.SIGKILL)
                worker.process.wait()
            worker.listener.join(GRACE)
            assert worker.process.stdin
            with suppress(OSError):
                worker.process.stdin.close()


def _pickled(task: LawJob) -> bytes:
    try:
        # The path on which the user's modules are found is pickled first.
        data = pickle.dumps((list(sys.path), os.getcwd(), pickle.dumps(task)))
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
