"""A chunk of paths as a task: the data of the task determine its result,
so any worker on any machine can run it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from sepv.problem import Array, NamedProblem, PolynomialSystem, Problem
from sepv.problems import build
from sepv.schemes import Scheme
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener
from sepv.simulate._batch import Batch, Ensemble
from sepv.workers import Halted, halted

# The number of steps whose increments the NumPy engine holds in memory at once.
PIECE = 256


@dataclass(frozen=True)
class Task:
    """The data of a chunk: the paths with the numbers first … first + count − 1 of an ensemble,
    over `steps` steps.

    problem : Problem, or the data from which a worker can build the problem again.
    dW : (N, m, M), untruncated increments, or None to draw them; the chunk uses the columns place …
        place + count − 1.
    stops : increasing numbers of steps after which states are kept.
    engine : the name of the target that runs the chunk (`sepv.simulate.targets`).
    track : if False, the NumPy engine does not compute the invariants, and reports their defects as
        0.
    """

    scheme: Scheme
    problem: Problem | PolynomialSystem | NamedProblem
    y0: Array
    h: float
    steps: int
    first: int
    count: int
    seed: int
    refine: int | None
    truncation: int | None
    stops: tuple[int, ...]
    compensated: bool
    engine: str
    dW: Array | None = None
    place: int = 0
    track: bool = True


def portable(problem: Problem) -> Problem | PolynomialSystem | NamedProblem:
    """The problem's data if the problem can be built again from them, else the problem."""
    if problem.data is not None and np.array_equal(build(problem.data).c, problem.c):
        return problem.data
    return problem


class NumpyChunk:
    """A chunk of paths computed in NumPy, a `sepv.simulate.targets._target.Chunk`."""

    def __init__(self, task: Task, problem: Problem) -> None:
        self.task = task
        self.batch = Batch(
            task.scheme, problem, task.y0, task.count, track=task.track, compensated=task.compensated
        )
        self.W = np.zeros((problem.noises, task.count))
        self.increments = self._walk(problem)

    @property
    def done(self) -> int:
        """The number of steps done."""
        return self.batch.done

    def advance(self, steps: int) -> None:
        """Take the next `steps` steps."""
        for raw in islice(self.increments, steps):
            if halted():
                raise Halted
            self.batch.step(
                self.task.h, bounded.seen(raw, self.task.h, self.task.truncation, self.task.scheme.increments)
            )
            self.W += raw

    def states(self) -> Array:
        """The present states (d, M)."""
        return self.batch.y.copy()

    def failed(self) -> bool:
        """True if every path of the chunk has failed."""
        return not self.batch.alive.size

    def result(self, kept: Array) -> Ensemble:
        """The present states of the paths as an `Ensemble`;
        `kept` are their states at the steps `Task.stops`.
        """
        return self.batch.result(self.W, kept)

    def _walk(self, problem: Problem) -> Iterator[Array]:
        task = self.task
        if task.dW is not None:
            yield from task.dW[:, :, task.place : task.place + task.count]
            return
        for piece in wiener.walk(
            task.seed, T=task.h * task.steps, steps=task.steps, noises=problem.noises,
            paths=range(task.first, task.first + task.count), refine=task.refine, size=PIECE,
        ):  # fmt: skip
            yield from piece
