"""What chunks of an ensemble become: ends in memory, ends on disk, or summaries of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from sepv.simulate._batch import Ensemble
from sepv.simulate._engine.run import run
from sepv.simulate._engine.task import Task
from sepv.simulate._results.labelled import AXES
from sepv.simulate._results.reductions import Functionals, Summary, reached, reduce_chunk
from sepv.simulate._results.zarr_store import COUNTED, ZarrStore

PathProgress = Callable[[int, int], None] | None
Counts = dict[str, int]


class Total(Protocol):
    """Takes chunks as they come, in any order."""

    def missing(self, numbers: range) -> Sequence[int]:
        """Which of the chunks have to be computed."""

    def take(self, number: int, task: Task, result: Any) -> bool | None:
        """A chunk; True where no more are wanted."""

    def finished(self) -> tuple[Any, Ensemble]:
        """The numbers of the finished paths, and their ensemble."""

    def result(self) -> Ensemble:
        """The whole."""


@dataclass(frozen=True)
class Reducing:
    """Computes a chunk and its summaries, where the worker is; with `keep` the chunk as well."""

    functionals: Functionals
    keep: bool

    def __call__(self, task: Task) -> tuple[Ensemble, Mapping[str, Summary]]:
        chunk = replace(run(task), times=np.array(task.stops, dtype=np.float64) * task.h)
        summaries = reduce_chunk(self.functionals, chunk)
        return (chunk if self.keep else without_paths(chunk)), summaries


def without_paths(chunk: Ensemble) -> Ensemble:
    """Its counts alone."""
    return replace(chunk, **{key: getattr(chunk, key)[..., :0] for key in AXES})


def _more(whole: Ensemble, counts: Counts) -> Ensemble:
    return replace(whole, **{key: getattr(whole, key) + counts[key] for key in COUNTED})


def _counts(chunk: Ensemble) -> Counts:
    return {key: getattr(chunk, key) for key in COUNTED}


class InMemory:
    """The ensemble being filled, chunk by chunk, in place."""

    def __init__(self, task: Task, empty: Ensemble, progress: PathProgress) -> None:
        M = task.count
        room: dict[str, Any] = {
            key: np.empty((*getattr(empty, key).shape[:-1], M), dtype=getattr(empty, key).dtype)
            for key in AXES
        }
        self.ensemble = replace(empty, **room)
        self.done = np.zeros(M, dtype=bool)
        self.progress = progress

    def missing(self, numbers: range) -> Sequence[int]:
        """All."""
        return numbers

    def take(self, _number: int, task: Task, chunk: Any) -> None:
        """A chunk's ends go to their places; where it is the whole, they are the ends."""
        whole, here = self.ensemble, slice(task.first, task.first + task.count)
        if task.count == self.done.size:
            whole = replace(whole, **{key: getattr(chunk, key) for key in AXES})
        else:
            for key in AXES:
                getattr(whole, key)[..., here] = getattr(chunk, key)
        self.ensemble = _more(whole, _counts(chunk))
        self.done[here] = True
        if self.progress is not None:
            self.progress(int(self.done.sum()), self.done.size)

    def finished(self) -> tuple[np.ndarray, Ensemble]:
        """The numbers of the finished paths and their ends."""
        kept: dict[str, Any] = {key: getattr(self.ensemble, key)[..., self.done] for key in AXES}
        return np.flatnonzero(self.done), replace(self.ensemble, **kept)

    def result(self) -> Ensemble:
        """The ends."""
        return self.ensemble


class Reduced:
    """Summaries, merged in the order of chunks; what comes early waits for its turn."""

    def __init__(
        self,
        task: Task,
        empty: Ensemble,
        progress: PathProgress,
        functionals: Functionals,
        until: Mapping[str, float] | None,
    ) -> None:
        self.ensemble = replace(empty, reduced={name: Summary() for name in functionals})
        self.paths, self.done, self.progress, self.until = task.count, 0, progress, until
        self.next = 0
        self.early: dict[int, tuple[int, Counts, Mapping[str, Summary]]] = {}

    def missing(self, numbers: range) -> Sequence[int]:
        """All."""
        return numbers

    def take(self, number: int, task: Task, result: Any) -> bool:
        """A chunk's counts and summaries."""
        chunk, summaries = result
        return self.add(number, task.count, _counts(chunk), summaries)

    def add(self, number: int, paths: int, counts: Counts, summaries: Mapping[str, Summary]) -> bool:
        """Those of chunk `number`; True once every target error is reached."""
        self.early[number] = (paths, counts, summaries)
        while self.next in self.early:
            paths, counts, summaries = self.early.pop(self.next)
            self.next += 1
            self.done += paths
            reduced = {name: self.ensemble.reduced[name].merge(new) for name, new in summaries.items()}
            self.ensemble = replace(_more(self.ensemble, counts), reduced=reduced)
            if self.progress is not None:
                self.progress(self.done, self.paths)
            if self.until and reached(reduced, self.until):
                return True
        return False

    def finished(self) -> tuple[range, Ensemble]:
        """The paths that are merged: the first ones."""
        return range(self.done), self.ensemble

    def result(self) -> Ensemble:
        """The summaries."""
        return self.ensemble


class OnDisk:
    """Ends in a store, and their summaries where those are asked for."""

    def __init__(
        self,
        task: Task,
        empty: Ensemble,
        progress: PathProgress,
        where: Any,
        size: int,
        functionals: Functionals | None,
        until: Mapping[str, float] | None,
    ) -> None:
        shapes = {
            key: (axes, getattr(empty, key).shape[:-1], getattr(empty, key).dtype)
            for key, axes in AXES.items()
        }
        self.store = ZarrStore(where, empty.about, shapes, task.count, size)
        arrays: dict[str, Any] = {
            key: self.store.arrays.get(key, np.empty((*shapes[key][1], task.count), dtype=shapes[key][2]))
            for key in AXES
        }
        self.empty, self.ensemble = empty, replace(empty, **arrays)
        self.paths, self.size, self.functionals, self.progress = task.count, size, functionals, progress
        self.reduced = Reduced(task, empty, None, functionals, until) if functionals is not None else None
        self.there = np.zeros(self.store.chunks, dtype=bool)

    def missing(self, numbers: range) -> Sequence[int]:
        """Those that are not in the store, or torn."""
        for number in numbers:
            found = self.store.load(number)
            if found is not None and self._take(number, self._chunk(found)):
                return []
        return [int(n) for n in np.flatnonzero(~self.there)]

    def _chunk(self, found: dict[str, Any]) -> Ensemble:
        """What was read as an ensemble; arrays without entries are not in the store."""
        M = found["status"].size
        absent: dict[str, Any] = {
            key: np.empty((*array.shape[:-1], M))
            for key in AXES
            if 0 in (array := getattr(self.empty, key)).shape[:-1]
        }
        return replace(self.empty, **absent, **found)

    def take(self, number: int, _task: Task, result: Any) -> bool:
        """A chunk, and its summaries where they were made on its worker."""
        chunk, summaries = result if self.reduced is not None else (result, None)
        self.store.save(number, chunk)
        return self._take(number, chunk, summaries)

    def _take(self, number: int, chunk: Ensemble, summaries: Mapping[str, Summary] | None = None) -> bool:
        self.there[number] = True
        self.ensemble = _more(self.ensemble, _counts(chunk))
        if self.progress is not None:
            self.progress(min(int(self.there.sum()) * self.size, self.paths), self.paths)
        if self.reduced is None or self.functionals is None:
            return False
        if summaries is None:
            summaries = reduce_chunk(self.functionals, chunk)
        return self.reduced.add(number, chunk.status.size, _counts(chunk), summaries)

    def finished(self) -> tuple[np.ndarray, Ensemble]:
        """The numbers of the paths in the store; the arrays have places for all."""
        first = [int(n) * self.size for n in np.flatnonzero(self.there)]
        parts = [np.arange(p, min(p + self.size, self.paths)) for p in first]
        return np.concatenate(parts) if parts else np.empty(0, dtype=np.int64), self.result()

    def result(self) -> Ensemble:
        """The arrays of the store."""
        if self.reduced is None:
            return self.ensemble
        return replace(self.ensemble, reduced=self.reduced.ensemble.reduced)
