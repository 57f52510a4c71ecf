"""The seam for more cores and machines: chunks go to an int's worth of workers or to a map-like callable.

A chunk is a pure function, so that one whose worker died, or that raised, is simply computed again here;
what the others finished is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from typing import Any, TypeVar

from sepv.errors import UsageError

T = TypeVar("T")
R = TypeVar("R")


class _Guarded:
    """The function of a numbered task, with its number and what it raises returned: a map goes on, in any order."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self.function = function

    def __call__(self, numbered: tuple[int, Any]) -> tuple[int, bool, Any]:
        number, task = numbered
        try:
            return number, True, self.function(task)
        except Exception as error:  # whatever it is, it is tried again where it can be seen
            return number, False, f"{type(error).__name__}: {error}"


def run_all(
    function: Callable[[T], R],
    tasks: Sequence[T],
    workers: Any,
    *,
    threads: bool,
    receive: Callable[[int, R], None],
) -> int:
    """Run function on every task; `receive` gets the number and the result of each, in any order.

    Parameters
    ----------
    workers : int ≥ 1, Executor, or map-like callable
        With an int that many threads (where `threads`: the function releases the GIL) or processes.
        An executor, or its `map`, gets the chunks one by one, so that none that is finished is lost when a
        worker dies; any other map-like callable gets a function and numbered tasks, and may return what came of them
        in any order.

    Returns
    -------
    How many tasks had to be computed again here.

    Raises
    ------
    Exception
        What a task raised when it was tried again here.
    """
    missing = set(range(len(tasks)))

    def take(number: int, result: R) -> None:
        receive(number, result)
        missing.discard(number)

    executor = _executor(workers)
    if isinstance(workers, int) and not isinstance(workers, bool):
        if workers < 1:
            raise _bad(workers)
        if workers > 1 and len(tasks) > 1:
            pool: Executor = (ThreadPoolExecutor if threads else ProcessPoolExecutor)(
                min(workers, len(tasks))
            )
            with pool:
                _submit(pool, function, tasks, take)
        else:
            for number, task in enumerate(tasks):
                take(number, function(task))
    elif executor is not None:
        _submit(executor, function, tasks, take)
    elif callable(workers):
        _map(workers, function, tasks, take)
    else:
        raise _bad(workers)
    again = sorted(missing)
    for number in again:
        take(number, function(tasks[number]))
    return len(again)


def _submit(
    executor: Executor, function: Callable[[T], R], tasks: Sequence[T], take: Callable[[int, R], None]
) -> None:
    futures = {}
    try:
        for number, task in enumerate(tasks):
            futures[executor.submit(function, task)] = number
    except RuntimeError:
        pass  # the pool broke while it was being filled: what it did not take is computed again
    try:
        for future in as_completed(list(futures)):
            number = futures.pop(future)
            if future.cancelled() or future.exception() is not None:
                continue
            take(number, future.result())
    except KeyboardInterrupt:
        for future in futures:
            future.cancel()
        raise


def _map(mapper: Any, function: Callable[[T], R], tasks: Sequence[T], take: Callable[[int, R], None]) -> None:
    try:
        for found in mapper(_Guarded(function), list(enumerate(tasks))):
            # What is not ours, put there by a map of its own mind, is as good as missing.
            if isinstance(found, tuple) and len(found) == 3 and found[1]:
                take(found[0], found[2])
    except Exception:
        pass


def _executor(workers: Any) -> Executor | None:
    """The executor that `workers` is, or whose `map` it is."""
    for candidate in (workers, getattr(workers, "__self__", None)):
        if isinstance(candidate, Executor):
            return candidate
        # A cluster's client submits too, but what it gives are no futures of Python's, which are waited for here.
        if hasattr(candidate, "submit") or hasattr(candidate, "scatter"):
            raise _bad(workers)
    return None


def _bad(workers: Any) -> UsageError:
    return UsageError(
        expected="workers: an integer ≥ 1, an executor, or a callable like map",
        received=f"{type(workers).__name__}: {workers!r:.80}",
        remedy="workers=2 for two cores, or an executor such as ProcessPoolExecutor; a cluster's client gives one, "
        "often as client.get_executor()",
    )
