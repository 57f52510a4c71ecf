"""A chunk of paths in the compiled engine: the arrays that its kernel works on, and what they mean."""

from __future__ import annotations

import math

import numpy as np

from sepv.problem import Array, Problem
from sepv.schemes._point_laws import point_law
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener
from sepv.simulate._engine.compile import FEW, Kernel, kernel
from sepv.simulate._engine.crew import Halted, halted
from sepv.simulate._engine.module import (
    ALIVE,
    EVALUATIONS,
    FAILED,
    LANES,
    LIVING,
    PENDING,
    STATUS,
    STRUCTURES,
    WORK,
)
from sepv.simulate._engine.task import Task
from sepv.simulate._paths import Ensemble

# Path-steps between two looks at whether the chunk is still wanted, and at Ctrl-C: some hundredths of a second.
PIECE = 2**21
# Of paths whose increments are given, or that have none.
_NO_STREAMS = np.empty((0, 3), dtype=np.uint64)


class Chunk:
    """The state of a chunk between two calls of its kernel; `advance` goes on where it was left."""

    def __init__(self, task: Task, problem: Problem) -> None:
        from sepv.simulate._engine.lanes import start_streams
        from sepv.simulate._engine.store import is_there, ordinary

        lanes = 1 if task.count <= FEW else LANES
        self.task, self.problem, self.driver = task, problem, ordinary("driver")
        self.kernel: Kernel = kernel(task.scheme, problem, lanes=lanes, compensated=task.compensated)
        # A chunk begins anew where a lane needs what is not compiled yet; one path is too long for that.
        ready = lanes == 1 or is_there("careful")
        self.careful = ordinary("careful").CAREFULLY if ready else self.driver.LATER
        module, m, blocks = self.kernel.module, problem.noises, -(-task.count // lanes)
        self.lanes = lanes
        start = np.zeros(module.SIZE)
        start[: problem.dimension * lanes] = np.repeat(np.asarray(task.y0, dtype=np.float64), lanes)
        module.start(start, np.zeros(4 * lanes + 5, np.int64), np.zeros((1, 1, 1)), self.kernel.parameters)
        self.S = np.empty((blocks, module.SIZE))
        self.S[:] = start
        self.I = np.zeros((blocks, 4 * lanes + 5), dtype=np.int64)
        living = (np.arange(blocks * lanes) < task.count).reshape(blocks, lanes)
        for row, value in ((ALIVE, living), (STATUS, 0), (FAILED, -1)):
            self._integers(row)[:] = value
        self.I[:, 4 * lanes + LIVING] = living.sum(axis=1)
        self.W = np.zeros((blocks, m, lanes))
        self.grid = wiener.grid(task.steps, task.refine)
        words = wiener.stream_words(task.seed, self.grid) if task.dW is None and m else _NO_STREAMS
        streams = len(words)
        self.rng = np.empty((blocks, streams, 4, lanes), dtype=np.uint64)
        paths = np.arange(task.first, task.first + blocks * lanes, dtype=np.uint64).reshape(blocks, 1, lanes)
        for place in range(3):
            self.rng[:, :, place] = words[:, place, None]
        self.rng[:, :, 2] += paths * np.uint64(wiener.STREAMS)
        self.rng[:, :, 3] = 1
        self.stack = np.empty((blocks, streams, m, lanes))
        coarse = self.grid.base << self.grid.top if streams and self.grid.base <= wiener.TOP else 0
        self.top = np.empty((blocks, coarse, m, lanes))
        self.spreads = wiener.spreads(task.h * task.steps, self.grid)
        k = task.truncation
        self.bound = math.inf if k is None else bounded.truncation_bound(task.h, k) * math.sqrt(task.h)
        self.thresholds, self.values = bounded.points(task.h, point_law(task.scheme.increments))
        self.given = np.empty((0, m, 0)) if task.dW is None else np.ascontiguousarray(task.dW)
        start_streams(self.rng, self.top, self.spreads, self.grid.base, self.grid.top)

    def advance(self, steps: int) -> None:
        """The next `steps` steps."""
        goal = self.done + steps
        self._run(goal)
        if self.careful == self.driver.LATER and (self._integers(STATUS) == PENDING).any():
            from sepv.simulate._engine.store import ordinary

            ordinary("careful")
            self.__init__(self.task, self.problem)  # type: ignore[misc]  # everything as it was at the start
            self._run(goal)

    def _run(self, goal: int) -> None:
        module = self.kernel.module
        self.driver.run(
            self.driver.FILLING, module.ADVANCING, self.careful, module.ASKED, module.SHAPE, module.TABLE,
            self.S, self.I, self.W,
            self.rng, self.stack, self.top, self.spreads, self.grid.top, self.given, self.task.place, self.done,
            goal, self.task.h, self.bound, self.thresholds, self.values, self.kernel.parameters,
        )  # fmt: skip

    @property
    def done(self) -> int:
        """Steps done."""
        return int(self.I[-1, -1])

    def failed(self) -> bool:
        """Whether no path goes on."""
        return not bool(self._integers(ALIVE).any())

    def _integers(self, row: int) -> np.ndarray:
        return self.I[:, row * self.lanes : (row + 1) * self.lanes]

    def _paths(self, rows: np.ndarray) -> np.ndarray:
        """Rows (blocks, ..., L) as (..., M)."""
        moved = np.moveaxis(rows, 0, -2)
        lanes = moved.shape[-2] * moved.shape[-1]
        return moved.reshape(*moved.shape[:-2], lanes)[..., : self.task.count].copy()

    def _numbers(self, first: int, count: int) -> Array:
        """Rows of the scratch buffer, (count, M)."""
        L = self.lanes
        return self._paths(self.S[:, first * L : (first + count) * L].reshape(-1, count, L))

    def states(self) -> Array:
        """(d, M)."""
        return self._numbers(0, self.problem.dimension)

    def result(self, kept: Array) -> Ensemble:
        """The ends so far."""
        module, L = self.kernel.module, self.lanes
        counts = [int(self.I[:, 4 * L + place].sum()) for place in (EVALUATIONS, STRUCTURES, WORK)]
        gradients, structures, iterations = counts
        return Ensemble(
            y=self.states(),
            W=self._paths(self.W),
            status=self._paths(self._integers(STATUS)),
            failed_step=self._paths(self._integers(FAILED)),
            energy_defect=self._numbers(module.ENERGY, 1)[0],
            casimir_defect=self._numbers(module.CASIMIR, 1)[0],
            gradient_evaluations=gradients or iterations * self.kernel.gradients,
            structure_evaluations=structures or iterations * self.kernel.structures,
            iterations=iterations if module.IMPLICIT else 0,
            times=np.array(self.task.stops, dtype=np.float64) * self.task.h,
            states=kept if kept.size else np.empty((0, self.problem.dimension, self.task.count)),
            engine="compiled",
        )


def run_compiled(task: Task, problem: Problem) -> Ensemble:
    """The chunk's ends, and its states at the stops."""
    chunk = Chunk(task, problem)
    kept = np.empty((len(task.stops), problem.dimension, task.count))
    piece = max(1, PIECE // task.count)
    for place, stop in enumerate((*task.stops, task.steps)):
        while chunk.done < stop:
            if halted():
                raise Halted
            chunk.advance(min(piece, stop - chunk.done))
        if place < len(kept):
            kept[place] = chunk.states()
    return chunk.result(kept)
