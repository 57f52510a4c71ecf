"""Computation of tasks, such as chunks of paths, on threads, processes, an executor, a map,
or Dask.

If a worker dies or a task raises, the task is computed again in this process. So the result of a
task must depend on its arguments alone. The number of submitted tasks is limited, so that results
do not pile up behind a slow task.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from functools import partial
from typing import Any, TypeVar

from sepv.errors import UsageError
from sepv.workers._pool import Futures, cannot_travel, crew_of_processes, crew_of_threads

T = TypeVar("T")
R = TypeVar("R")

# The number of tasks in one call of a map if results must not pile up.
TASKS_PER_MAP = 64


def check(workers: Any) -> None:
    """Raise a UsageError if an object cannot be used as workers;
    the message lists the kinds of workers.
    """
    fits = (
        (isinstance(workers, int) and not isinstance(workers, bool) and workers >= 1)
        or callable(workers)
        or _executor(workers) is not None
        or _dask(workers) is not None
    )
    if not fits:
        raise UsageError(
            expected="workers: an integer ≥ 1, an executor, a callable like map, or a Dask client or its address",
            received=f"{type(workers).__name__}: {workers!r:.80}",
            remedy="workers=2 for two cores, pool.map, Client(…) or 'tcp://host:8786' (docs/clusters.md)",
        )


def count(workers: Any) -> int:
    """The number of tasks that workers compute at a time; 0 if the number is unknown."""
    if isinstance(workers, int):
        return workers
    if hasattr(_dask(workers), "nthreads"):
        from sepv.workers._on_dask import threads

        return threads(_dask(workers))
    return int(getattr(_executor(workers), "_max_workers", 0))


def run_all(
    function: Callable[[T], R],
    tasks: Sequence[T],
    workers: Any,
    *,
    threads: bool,
    receive: Callable[[int, R], bool | None],
    bounded: bool = True,
    alike: tuple[str, ...] = ("numpy", "numba"),
) -> int:
    """Compute function(task) for every task on workers;
    `receive` gets each task's number and result, in any order.

    Returns the number of tasks that failed on a worker and were computed again in this process. If
    a task raises here too, so does this function. If a cluster is lost or unfit, ClusterFailure is
    raised and nothing is computed again.

    Parameters
    ----------
    workers : int, executor, map-like callable, Dask client or its address
        The number of processes, or of threads if `threads` (the function must then release the
        GIL). For an executor or its `map`, tasks are submitted one by one, so that no finished task
        is lost when a worker dies. Any other map-like callable gets a function and numbered tasks,
        and may return their outcomes in any order.
    receive : callable (number, result)
        Returns True if no more results are wanted.
    bounded : bool
        True if results must not pile up: a map is then called with TASKS_PER_MAP tasks at a time.
        Other workers always get a few tasks at a time.
    alike : tuple of str
        Packages that, like sepv, must have the same version on a worker of a cluster as in this
        process.
    """
    check(workers)
    if isinstance(workers, int) and (workers == 1 or len(tasks) < 2):
        for number, task in enumerate(tasks):
            if receive(number, function(task)):
                break
        return 0
    if isinstance(workers, int):
        if not threads:
            try:
                pickle.dumps((function, tasks[0]))
            except (TypeError, AttributeError, pickle.PickleError) as error:
                raise cannot_travel(error) from error
        with (crew_of_threads if threads else crew_of_processes)(min(workers, len(tasks)), function) as crew:
            return _flow(crew, function, tasks, receive)
    cluster, executor = _dask(workers), _executor(workers)
    if cluster is not None:
        from sepv.workers._on_dask import dask_crew

        with dask_crew(cluster, function, alike) as crew:
            return _flow(crew, function, tasks, receive)
    if executor is not None:
        return _flow(Futures(executor, function), function, tasks, receive)
    return _map(workers, function, tasks, receive, TASKS_PER_MAP if bounded else len(tasks))


def _flow(
    crew: Futures, function: Callable[[T], R], tasks: Sequence[T], receive: Callable[[int, R], bool | None]
) -> int:
    """Compute all tasks on a crew, a few at a time; return how many failed and were computed again
    in this process.
    """
    first = sent = again = 0
    done: set[int] = set()
    try:
        while first < len(tasks):
            # The limit is counted from the first unfinished task, so that no results pile up behind
            # a slow task.
            beyond = min(len(tasks), first + crew.room())
            if sent < beyond:
                crew.submit([(number, tasks[number]) for number in range(sent, beyond)])
                sent = beyond
            # Deliver finished results first: recomputing may raise.
            for number, ok, result in sorted(crew.finished(), key=lambda outcome: not outcome.ok):
                again += not ok
                if receive(number, result if ok else function(tasks[number])):
                    return again
                done.add(number)
            while first in done:
                done.discard(first)
                first += 1
    finally:
        crew.cancel()
    return again


def _guarded(function: Callable[[Any], Any], numbered: tuple[int, Any]) -> tuple[int, bool, Any]:
    """Run a numbered task and return (number, True, result) or (number, False, error),
    so that no error ends a map.
    """
    number, task = numbered
    try:
        return number, True, function(task)
    except Exception as error:  # any exception: the task runs again in this process, which shows the error
        return number, False, f"{type(error).__name__}: {error}"


def _map(
    mapper: Any, function: Callable[[T], R], tasks: Sequence[T], receive: Callable[[int, R], bool | None], lot: int
) -> int:  # fmt: skip
    """Compute all tasks by a map-like callable, `lot` tasks a call;
    return how many this process computed again.
    """
    again = 0
    for first in range(0, len(tasks), lot):
        numbered = [(n, tasks[n]) for n in range(first, min(first + lot, len(tasks)))]
        missing = {n for n, _ in numbered}
        for number, result in _mapped(mapper, function, numbered):
            missing.discard(number)
            if receive(number, result):
                return again
        for number in sorted(missing):
            again += 1
            if receive(number, function(tasks[number])):
                return again
    return again


def _mapped(
    mapper: Any, function: Callable[[T], R], numbered: list[tuple[int, T]]
) -> Iterator[tuple[int, R]]:
    """Yield (number, result) of each task that a map-like callable computes with success,
    until it ends or raises.
    """
    try:
        results = iter(mapper(partial(_guarded, function), numbered))
    except Exception:
        return
    while True:
        try:
            outcome = next(results)
        except Exception:  # the map has ended, regularly or by an error
            return
        # If a map returns anything else for a task, the task counts as missing and is computed in
        # this process.
        if isinstance(outcome, tuple) and len(outcome) == 3 and outcome[1]:
            yield outcome[0], outcome[2]


def _dask(workers: Any) -> Any:
    """The Dask client, cluster or address that `workers` is, or the client whose `map` it is;
    else None.
    """
    for candidate in (workers, getattr(workers, "__self__", None)):
        ours = type(candidate).__module__.startswith(("distributed.", "dask"))
        if ours and hasattr(candidate, "scheduler_info"):
            return candidate
    return workers if isinstance(workers, str) and "://" in workers else None


def _executor(workers: Any) -> Any:
    """The executor that `workers` is, or whose `map` it is; else None."""
    for candidate in (workers, getattr(workers, "__self__", None)):
        if isinstance(candidate, Executor) or all(
            hasattr(candidate, name) for name in ("submit", "shutdown")
        ):
            return candidate
    return None
