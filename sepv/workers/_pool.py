"""Crews of workers that compute numbered tasks and report each result: threads, processes,
or an executor.

The processes are those of a pool and no `sepv.children.Child`: `multiprocessing` gives them a
scheme that the user's script or notebook defines, which an interpreter of our own cannot import.
Results are arrays of megabytes, which lines of text would copy three times.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any, NamedTuple

from sepv.children import end_with_parent
from sepv.errors import UsageError

# The number of tasks submitted at a time for each worker: one that it computes, and three more so
# that it never waits.
TASKS_PER_WORKER = 4
# The number of workers assumed for an executor that does not state its number.
ASSUMED_WORKERS = 16


class TaskOutcome(NamedTuple):
    """The outcome of a numbered task: its result if it is `ok`, else the reason for its failure."""

    number: int
    ok: bool
    result: Any


class Halted(Exception):
    """Raised when a chunk of paths is stopped because nobody wants its result any more."""


# The event of a thread, set when the thread's chunk is no longer wanted. It is checked between
# pieces of the chunk.
_halt = threading.local()


def halted() -> bool:
    """True if the chunk that this thread computes is no longer wanted."""
    event = getattr(_halt, "event", None)
    return event is not None and event.is_set()


class Futures:
    """A crew that computes numbered tasks on an executor whose futures have `add_done_callback`."""

    def __init__(self, executor: Any, function: Callable[[Any], Any]) -> None:
        self.executor, self.function = executor, function
        self.running: dict[int, Any] = {}
        self.done: SimpleQueue[tuple[int, Any]] = SimpleQueue()

    def room(self) -> int:
        """The number of tasks that may be submitted, counted from the first unfinished one:
        four for each worker.
        """
        return TASKS_PER_WORKER * int(getattr(self.executor, "_max_workers", ASSUMED_WORKERS))

    def submit(self, numbered: Sequence[tuple[int, Any]]) -> None:
        """Submit tasks one by one. If the executor is broken or shut down,
        its error is the outcome of each task.
        """
        for number, task in numbered:
            try:
                future = self.executor.submit(self.function, task)
            except RuntimeError as error:
                future = Future()
                future.set_exception(error)
            if not hasattr(future, "add_done_callback"):
                raise UsageError(
                    expected="an executor whose futures have add_done_callback, as those of concurrent.futures have",
                    received=f"{type(self.executor).__name__}, which gives a {type(future).__name__}",
                    remedy="its map, or an executor that it gives, such as get_executor()",
                )
            self.watch(number, future)

    def watch(self, number: int, future: Any) -> None:
        """Remember a running task, and note its number when it is done."""
        self.running[number] = future
        future.add_done_callback(lambda done: self.done.put((number, done)))

    def finished(self) -> list[TaskOutcome]:
        """Wait for at least one outcome, and return all outcomes that have arrived."""
        numbers = [self.done.get()[0]]
        while not self.done.empty():
            numbers.append(self.done.get()[0])
        outcomes = []
        for number in numbers:
            future = self.running.pop(number)
            error = "cancelled" if future.cancelled() else future.exception()
            outcomes.append(TaskOutcome(number, error is None, future.result() if error is None else error))
        return outcomes

    def cancel(self) -> None:
        """Cancel tasks that have not begun."""
        for future in self.running.values():
            future.cancel()


@contextmanager
def crew_of_threads(count: int, function: Callable[[Any], Any]) -> Iterator[Futures]:
    """A context with a crew of threads. If an exception ends the context,
    running chunks stop soon (`halted`).
    """
    event = threading.Event()

    def begin() -> None:
        _halt.event = event

    with ThreadPoolExecutor(count, initializer=begin) as pool:
        try:
            yield Futures(pool, function)
        except BaseException:
            event.set()
            raise


def _serve_quietly() -> None:
    """Prepare a process of a pool: it ends without a traceback after Ctrl-C,
    and when its parent process ends.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    end_with_parent(os.getppid())
    parent = multiprocessing.parent_process()
    if parent is not None and not parent.is_alive():  # it ended before
        os._exit(1)


@contextmanager
def crew_of_processes(count: int, function: Callable[[Any], Any]) -> Iterator[Futures]:
    """A context with a crew of processes; at its end, processes that still compute are killed."""
    with ended_at_once(ProcessPoolExecutor(count, initializer=_serve_quietly)) as pool:
        crew = _Processes(pool, function)
        yield crew
        if crew.running:
            raise _Enough


class _Enough(Exception):
    """Raised in `ended_at_once` where nobody waits for the tasks that still run."""


@contextmanager
def ended_at_once(pool: ProcessPoolExecutor) -> Iterator[ProcessPoolExecutor]:
    """A context with a pool of processes, which are killed if an exception such as Ctrl-C leaves
    the context.
    """
    before = set(multiprocessing.active_children())
    try:
        with pool:
            try:
                yield pool
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                for child in set(multiprocessing.active_children()) - before:
                    child.kill()
                raise
    except _Enough:
        pass


class _Processes(Futures):
    def cancel(self) -> None:
        """Do nothing, because `crew_of_processes` ends the processes of tasks that still run.

        If the futures were cancelled too, the pool's own thread would fail when it finds its
        processes gone.
        """


def cannot_travel(error: Exception) -> UsageError:
    """Make the UsageError for a scheme, problem or function that cannot be pickled for another
    process.
    """
    return UsageError(
        expected="a scheme, a problem and functionals that can go to another process",
        received=f"{type(error).__name__}: {error}",
        remedy="functions of a module, problems that are data; or workers=1",
    )
