"""A chunk is run: in NumPy, or by a kernel that is compiled for it."""

from __future__ import annotations

import numpy as np

from sepv.problem import Problem
from sepv.problems import build
from sepv.simulate._batch import Ensemble
from sepv.simulate._engine.task import NumpyChunk, Task


def run(task: Task) -> Ensemble:
    """The chunk's ends."""
    problem = task.problem if isinstance(task.problem, Problem) else build(task.problem)
    if task.compiled:
        from sepv.simulate._engine.chunk import run_compiled

        return run_compiled(task, problem)
    return _run_numpy(task, problem)


def _run_numpy(task: Task, problem: Problem) -> Ensemble:
    chunk = NumpyChunk(task, problem)
    kept = np.empty((len(task.stops), problem.dimension, task.count))
    for place, stop in enumerate(task.stops):
        chunk.advance(stop - chunk.done)
        kept[place] = chunk.states()
    chunk.advance(task.steps - chunk.done)
    return chunk.result(kept)
