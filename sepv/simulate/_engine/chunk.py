"""A chunk of paths in the compiled engine: the arrays that its kernel works on, and what they mean."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sepv.problem import Array, Problem
from sepv.schemes._point_distributions import point_law
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener
from sepv.simulate._batch import Ensemble
from sepv.simulate._engine import module as layout
from sepv.simulate._engine.compile import FEW, Kernel, kernel
from sepv.simulate._engine.task import Task


def aligned(shape: tuple[int, ...], dtype: Any = np.float64) -> np.ndarray:
    """An empty array that begins with a cache line, as registers of 512 bits are: one that lies across takes two."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    room = np.empty(size + layout.CACHE_LINE, np.uint8)
    first = -room.ctypes.data % layout.CACHE_LINE
    return room[first : first + size].view(dtype).reshape(shape)


class Chunk:
    """The state of a chunk between two calls of its kernel; `advance` goes on where it was left."""

    def __init__(self, task: Task, problem: Problem) -> None:
        from sepv.simulate._engine.store import is_there, ordinary

        lanes = 1 if task.count <= FEW else layout.LANES
        self.task, self.problem, self.driver = task, problem, ordinary("driver")
        self.kernel: Kernel = kernel(task.scheme, problem, lanes=lanes, compensated=task.compensated)
        # A chunk begins anew where a lane needs what is not compiled yet; one path is too long for that.
        ready = lanes == 1 or is_there("careful")
        self.careful = ordinary("careful").CAREFULLY if ready else self.driver.LATER
        module, m, blocks = self.kernel.module, problem.noises, -(-task.count // lanes)
        self.lanes = lanes
        self.start = np.zeros(module.SIZE)
        self.start[: problem.dimension * lanes] = np.repeat(np.asarray(task.y0, dtype=np.float64), lanes)
        module.start(
            self.start,
            np.zeros(4 * lanes + layout.NUMBERS, np.int64),
            np.zeros((1, 1, 1)),
            self.kernel.parameters,
        )
        self.S = aligned((blocks, module.SIZE))
        self.I = aligned((blocks, 4 * lanes + layout.NUMBERS), np.int64)
        self.W = aligned((blocks, m, lanes))
        self.I[:, 4 * lanes :] = 0
        self.grid = wiener.grid(task.steps, task.refine)
        drawn = task.dW is None and m > 0
        self.words = wiener.stream_words(task.seed, self.grid) if drawn else np.empty((0, 3), np.uint64)
        self.spreads = wiener.spreads(task.h * task.steps, self.grid) if drawn else np.empty(0)
        k = task.truncation
        self.bound = math.inf if k is None else bounded.truncation_bound(task.h, k) * math.sqrt(task.h)
        self.thresholds, self.values = bounded.points(task.h, point_law(task.scheme.increments))
        self.given = np.empty((0, m, 0)) if task.dW is None else np.ascontiguousarray(task.dW)

    def advance(self, steps: int) -> None:
        """The next `steps` steps."""
        goal = self.done + steps
        self._run(goal)
        if self.careful == self.driver.LATER and (self._integers(layout.STATUS) == layout.PENDING).any():
            from sepv.simulate._engine.store import ordinary

            ordinary("careful")
            self.__init__(self.task, self.problem)  # type: ignore[misc]  # everything as it was at the start
            self._run(goal)

    def _run(self, goal: int) -> None:
        module = self.kernel.module
        if self.done == 0:
            # Streams, the halves that wait, and the coarse increments. Blocks that are not gone on with take turns:
            # what they draw from stays in the cache.
            blocks = 1 if goal == self.task.steps else len(self.S)
            m, grid, streams = self.problem.noises, self.grid, len(self.words)
            self.rng = aligned((blocks, streams, 4, self.lanes), np.uint64)
            self.stack = aligned((blocks, streams, m, self.lanes))
            coarse = grid.base << grid.top if streams and grid.base <= wiener.TOP else 0
            self.top = aligned((blocks, coarse, m, self.lanes))
        self.driver.run(
            self.driver.BEGINNING, self.driver.FILLING, module.ADVANCING, self.careful, module.ASKED, module.SHAPE,
            module.TABLE, self.S, self.I, self.W, self.start, self.task.count, self.words, self.task.first,
            self.rng, self.stack, self.top, self.spreads, self.grid.base, self.grid.top, self.given, self.task.place,
            self.done, goal, self.task.h, self.bound, self.thresholds, self.values, self.kernel.parameters,
        )  # fmt: skip

    @property
    def done(self) -> int:
        """Steps done."""
        return int(self.I[-1, 4 * self.lanes + layout.DONE])

    def _settle(self) -> None:
        """Sets the blocks up, which the first step does else."""
        if self.done == 0:
            self._run(0)

    def failed(self) -> bool:
        """Whether no path goes on."""
        self._settle()
        return not bool(self._integers(layout.ALIVE).any())

    def _integers(self, row: int) -> np.ndarray:
        return self.I[:, row * self.lanes : (row + 1) * self.lanes]

    def _paths(self, rows: np.ndarray) -> np.ndarray:
        """Rows (blocks, n, L) as (n, M)."""
        blocks, n, lanes = rows.shape
        return rows.transpose(1, 0, 2).reshape(n, blocks * lanes)[:, : self.task.count].copy()

    def _rows(self, of: np.ndarray, first: int, count: int) -> np.ndarray:
        """Rows of S or of I, (blocks, count, L)."""
        L = self.lanes
        return of[:, first * L : (first + count) * L].reshape(-1, count, L)

    def states(self) -> Array:
        """(d, M)."""
        self._settle()
        return self._paths(self._rows(self.S, 0, self.problem.dimension))

    def result(self, kept: Array) -> Ensemble:
        """The ends so far."""
        module, L, y = self.kernel.module, self.lanes, self.states()
        sums = self.I[:, 4 * L :].sum(axis=0).tolist()
        gradients, structures, iterations = (
            sums[layout.EVALUATIONS],
            sums[layout.STRUCTURES],
            sums[layout.WORK],
        )
        ends = self._paths(self._rows(self.I, layout.STATUS, 2))
        energy, casimir = self._rows(self.S, module.ENERGY, 1), self._rows(self.S, module.CASIMIR, 1)
        return Ensemble(
            y=y,
            W=self._paths(self.W),
            status=ends[0],
            failed_step=ends[1],
            energy_defect=self._paths(energy)[0],
            casimir_defect=self._paths(casimir)[0],
            gradient_evaluations=gradients or iterations * self.kernel.gradients,
            structure_evaluations=structures or iterations * self.kernel.structures,
            iterations=iterations if module.IMPLICIT else 0,
            times=np.array(self.task.stops, dtype=np.float64) * self.task.h,
            states=kept if kept.size else np.empty((0, self.problem.dimension, self.task.count)),
            engine="compiled",
        )
