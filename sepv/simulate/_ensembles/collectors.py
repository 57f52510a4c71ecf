"""Collectors of an ensemble's chunks: they keep the ends of paths in memory or on disk,
or only summaries of them.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sepv.errors import UsageError
from sepv.problem import Problem
from sepv.problems import build
from sepv.simulate._batch import AXES, Ensemble
from sepv.simulate._ensembles.task import Task
from sepv.simulate._results.reductions import Functionals, Summary, reached, reduce_chunk
from sepv.simulate._results.sketch import at_home
from sepv.simulate._results.zarr_store import STORED_COUNTS, ZarrStore
from sepv.simulate.targets.registry import TARGETS
from sepv.workers import Halted, halted

PathProgress = Callable[[int, int], None] | None


def run(task: Task) -> Ensemble:
    """Run the chunk of a task: return the ends of its paths, and their states at the task's stops,
    in NumPy arrays.
    """
    return fetched(run_there(task))


def run_there(task: Task) -> Ensemble:
    """Run the chunk of a task, and leave the arrays of its ends where the target has them:
    in a card's memory.
    """
    problem = task.problem if isinstance(task.problem, Problem) else build(task.problem)
    target = TARGETS[task.engine]
    chunk = target.chunk(task, problem)
    shape = problem.dimension, len(task.stops), task.count
    kept: Any = np.empty_like(chunk.states(), shape=shape) if task.stops else np.empty(shape)
    piece = max(1, target.piece // task.count)
    for place, stop in enumerate((*task.stops, task.steps)):
        while chunk.done < stop:
            if halted():
                raise Halted
            chunk.advance(min(piece, stop - chunk.done))
        if place < len(task.stops):
            kept[:, place] = chunk.states()
    return chunk.result(kept)


class Total(ABC):
    """A collector of an ensemble's chunks, which arrive in any order."""

    def __init__(self, task: Task, start: Ensemble, progress: PathProgress) -> None:
        self.ensemble, self.paths = start, task.count
        self.progress = progress or (lambda _done, _all: None)

    def missing(self, numbers: range) -> Sequence[int]:
        """The numbers of the chunks that must be computed."""
        return numbers

    @abstractmethod
    def take(self, number: int, task: Task, result: Any) -> bool | None:
        """Receive the result of a chunk; return True if no further chunks are needed."""

    @abstractmethod
    def finished(self) -> tuple[Any, Ensemble]:
        """The numbers of the finished paths, and their ensemble."""

    def result(self) -> Ensemble:
        """The whole ensemble."""
        return self.ensemble


@dataclass(frozen=True)
class Reducing:
    """Compute a chunk and summaries of its functionals on the worker; without `keep`,
    drop the chunk's paths.
    """

    functionals: Functionals
    keep: bool

    def __call__(self, task: Task) -> tuple[Ensemble, Mapping[str, Summary]]:
        begun = time.perf_counter()
        problem = task.problem if isinstance(task.problem, Problem) else build(task.problem)
        chunk = replace(run_there(task), times=np.array(task.stops, dtype=np.float64) * task.h)
        home, reason = fetched(chunk) if self.keep else None, ""
        summaries: dict[str, Summary] = {}
        for name, functional in self.functionals.items():
            try:
                summaries |= reduce_chunk({name: functional}, replace(chunk, problem=problem))
            except Exception as error:
                if isinstance(chunk.y, np.ndarray):
                    raise
                # The functional does not take the arrays of a card, so that it gets NumPy's.
                there = time.perf_counter()
                home = fetched(chunk) if home is None else home
                summaries |= reduce_chunk({name: functional}, replace(home, problem=problem))
                now = time.perf_counter()
                reason = (
                    f"the functional {name!r} ran on the host ({type(error).__name__}: {error}); "
                    f"that took {now - there:.2g} s of the {now - begun:.2g} s of a chunk"
                )
        whole = home if self.keep and home is not None else without_paths(chunk)
        return replace(whole, reason=reason), summaries


def fetched(ends: Ensemble) -> Ensemble:
    """The ensemble with NumPy's arrays, copied from a card if they are there."""
    return replace(ends, **{key: at_home(getattr(ends, key)) for key in AXES})


def without_paths(chunk: Ensemble) -> Ensemble:
    """The chunk with its counts of work, but without paths."""
    return fetched(replace(chunk, **{key: getattr(chunk, key)[..., :0] for key in AXES}))


def _more(whole: Ensemble, chunk: Ensemble) -> Ensemble:
    """Add a chunk's counts of work to those of the whole ensemble, which keeps the first reason."""
    counts = {key: getattr(whole, key) + getattr(chunk, key) for key in STORED_COUNTS}
    return replace(whole, reason=whole.reason or chunk.reason, **counts)


class InMemory(Total):
    """Collect chunks in memory, into one ensemble that is filled in place."""

    def __init__(self, task: Task, empty: Ensemble, progress: PathProgress) -> None:
        try:
            room: dict[str, Any] = {
                key: np.empty((*array.shape[:-1], task.count), dtype=array.dtype)
                for key in AXES
                for array in [getattr(empty, key)]
            }
        except MemoryError as error:
            raise UsageError(
                expected="paths whose ends fit into memory",
                received=f"{task.count} paths with {len(task.stops)} kept states: {error}",
                remedy="store= keeps them on disk, reduce= their moments and quantiles; or fewer paths at a time",
            ) from error
        super().__init__(task, replace(empty, **room), progress)
        self.there, self.done = np.zeros(task.count, dtype=bool), 0

    def fill(self, task: Task) -> Ensemble:
        """Run a chunk on a thread of this process, copy its ends on this thread,
        and return its counts of work.

        If the one thread that collects copied them, it alone would wait for all pages of the
        ensemble's new arrays.
        """
        chunk = run(task)
        self._copy(task, chunk)
        return without_paths(chunk)

    def _copy(self, task: Task, chunk: Ensemble) -> None:
        for key in AXES:
            getattr(self.ensemble, key)[..., task.first : task.first + task.count] = getattr(chunk, key)

    def take(self, _number: int, task: Task, chunk: Any) -> None:
        """Receive a chunk, with its ends or, after `fill`, without.
        A chunk of all paths is kept without a copy.
        """
        whole = self.ensemble
        if chunk.status.size == self.paths:
            self.ensemble = replace(
                chunk, times=whole.times, reason=whole.reason, about=whole.about, problem=whole.problem
            )
        else:
            if chunk.status.size:
                self._copy(task, chunk)
            self.ensemble = _more(whole, chunk)
        self.there[task.first : task.first + task.count] = True
        self.done += task.count  # a sum of `there` at each chunk would cost O(paths²) in all
        self.progress(self.done, self.paths)

    def finished(self) -> tuple[np.ndarray, Ensemble]:
        """The numbers of the finished paths, and an ensemble of these paths alone."""
        kept: dict[str, Any] = {key: getattr(self.ensemble, key)[..., self.there] for key in AXES}
        return np.flatnonzero(self.there), replace(self.ensemble, **kept)


class Reduced(Total):
    """Merge the summaries of chunks in the order of chunks;
    a summary that comes early waits for the earlier chunks.
    """

    def __init__(
        self, task: Task, empty: Ensemble, progress: PathProgress, functionals: Functionals,
        until: Mapping[str, float] | None,
    ) -> None:  # fmt: skip
        super().__init__(task, replace(empty, reduced={name: Summary() for name in functionals}), progress)
        self.done = self.next = 0
        self.until = until
        self.early: dict[int, tuple[int, Ensemble, Mapping[str, Summary]]] = {}

    def take(self, number: int, task: Task, result: Any) -> bool:
        """Receive a chunk's counts and summaries; return True once the target standard errors are
        reached.
        """
        return self.add(number, task.count, *result)

    def add(self, number: int, paths: int, counts: Ensemble, summaries: Mapping[str, Summary]) -> bool:
        """Add counts and summaries of chunk `number`; return True once the target standard errors
        are reached.
        """
        self.early[number] = (paths, counts, summaries)
        while self.next in self.early:
            paths, counts, summaries = self.early.pop(self.next)
            self.next += 1
            self.done += paths
            reduced = {name: self.ensemble.reduced[name].merge(new) for name, new in summaries.items()}
            self.ensemble = replace(_more(self.ensemble, counts), reduced=reduced)
            self.progress(self.done, self.paths)
            if self.until and reached(reduced, self.until):
                return True
        return False

    def finished(self) -> tuple[range, Ensemble]:
        """The numbers 0, 1, … of the paths merged so far, and their ensemble."""
        return range(self.done), self.ensemble


class OnDisk(Total):
    """Collect the ends of paths in a store on disk, and summaries of functionals if there are
    any.
    """

    def __init__(
        self, task: Task, empty: Ensemble, progress: PathProgress, where: Any, size: int,
        functionals: Functionals | None, until: Mapping[str, float] | None,
    ) -> None:  # fmt: skip
        shapes = {
            key: (axes, getattr(empty, key).shape[:-1], getattr(empty, key).dtype)
            for key, axes in AXES.items()
        }
        self.store = ZarrStore(where, empty.about, shapes, task.count, size)
        arrays: dict[str, Any] = {
            key: self.store.arrays[key]
            if key in self.store.arrays
            else np.empty((*lengths, task.count), dtype=dtype)
            for key, (_, lengths, dtype) in shapes.items()
        }
        super().__init__(task, replace(empty, **arrays), progress)
        self.empty, self.size, self.functionals = empty, size, functionals
        self.reduced = Reduced(task, empty, None, functionals, until) if functionals is not None else None
        self.there, self.done = np.zeros(self.store.chunks, dtype=bool), 0

    def missing(self, numbers: range) -> Sequence[int]:
        """The numbers of chunks not complete in the store;
        none if stored chunks reach the target standard errors.
        """
        for number in numbers:
            found = self.store.load(number)
            if found is not None and self._take(number, self._chunk(found)):
                return []
        return [int(n) for n in np.flatnonzero(~self.there)]

    def _chunk(self, found: dict[str, Any]) -> Ensemble:
        """Convert stored arrays to an ensemble; arrays without entries are not stored and are made
        anew.
        """
        M = found["status"].size
        absent: dict[str, Any] = {
            key: np.empty((*array.shape[:-1], M))
            for key in AXES
            if 0 in (array := getattr(self.empty, key)).shape[:-1]
        }
        return replace(self.empty, **absent, **found)

    def take(self, number: int, _task: Task, result: Any) -> bool:
        """Write a chunk to the store, and merge the summaries of its functionals if `reduce` names
        any.
        """
        chunk, summaries = result if self.reduced is not None else (result, None)
        self.store.save(number, chunk)
        return self._take(number, chunk, summaries)

    def _take(self, number: int, chunk: Ensemble, summaries: Mapping[str, Summary] | None = None) -> bool:
        self.there[number] = True
        self.done += chunk.status.size
        self.ensemble = _more(self.ensemble, chunk)
        self.progress(self.done, self.paths)
        if self.reduced is None or self.functionals is None:
            return False
        if summaries is None:
            summaries = reduce_chunk(self.functionals, chunk)
        return self.reduced.add(number, chunk.status.size, without_paths(chunk), summaries)

    def finished(self) -> tuple[np.ndarray, Ensemble]:
        """The numbers of the finished paths, and the ensemble,
        whose arrays have places for all paths.
        """
        first = [int(n) * self.size for n in np.flatnonzero(self.there)]
        parts = [np.arange(p, min(p + self.size, self.paths)) for p in first]
        return np.concatenate(parts) if parts else np.empty(0, dtype=np.int64), self.result()

    def result(self) -> Ensemble:
        """The arrays of the store as an ensemble."""
        if self.reduced is None:
            return self.ensemble
        return replace(self.ensemble, reduced=self.reduced.ensemble.reduced)
