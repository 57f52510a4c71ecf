"""A chunk of paths in the compiled engine: the arrays that its kernel works on, and what they mean."""

from __future__ import annotations

import math

import numpy as np

from sepv import wiener
from sepv.engine.compile import FEW, LANES, Kernel, kernel
from sepv.engine.task import Task
from sepv.problem import Array, Problem
from sepv.simulation import Ensemble


class Chunk:
    """The state of a chunk between two calls of its kernel; `advance` goes on where it was left."""

    def __init__(self, task: Task, problem: Problem) -> None:
        lanes = 1 if task.count <= FEW else LANES
        self.task, self.problem = task, problem
        self.kernel: Kernel = kernel(task.scheme, problem, lanes=lanes, compensated=task.compensated)
        module, m = self.kernel.module, problem.noises
        blocks = -(-task.count // lanes)
        self.lanes = lanes
        self.S = np.zeros((blocks, module.SIZE))
        self.I = np.zeros((blocks, 4 * lanes + 5), dtype=np.int64)
        for i, value in enumerate(task.y0):
            self._floats(i)[:] = value
        self._integers(1)[:] = (np.arange(blocks * lanes) < task.count).reshape(blocks, lanes)
        self._integers(3)[:] = -1
        self.I[:, -3] = self._integers(1).sum(axis=1)
        self.W = np.zeros((blocks, m, lanes))
        self.grid = wiener.grid(task.steps, task.refine)
        streams = self.grid.streams if task.dW is None and m else 0
        numbers = task.first + np.arange(blocks * lanes)
        self.rng = np.zeros((blocks, streams, 4, lanes), dtype=np.uint64)
        if streams:
            # Mixed by the kernel, which holds no lock meanwhile.
            for i, word in enumerate(wiener.stream_seeds(task.seed, numbers, self.grid)):
                self.rng[:, :, i] = word.reshape(streams, blocks, lanes).swapaxes(0, 1)
        self.stack = np.zeros((blocks, streams, m, lanes))
        coarse = self.grid.base << self.grid.top if streams and self.grid.base <= wiener.TOP else 0
        self.top = np.zeros((blocks, coarse, m, lanes))
        self.spreads = wiener.spreads(task.h * task.steps, self.grid)
        k = task.truncation
        self.bound = math.inf if k is None else wiener.truncation_bound(task.h, k) * math.sqrt(task.h)
        self.given = np.zeros((0, m, 0)) if task.dW is None else np.ascontiguousarray(task.dW)

    def advance(self, steps: int) -> None:
        """The next `steps` steps."""
        self.kernel.module.run(
            self.S, self.I, self.W, self.rng, self.stack, self.top, self.spreads, self.grid.base, self.grid.top,
            self.given, self.task.place, self.done, self.done + steps, self.task.h, self.bound,
            self.kernel.parameters,
        )  # fmt: skip

    @property
    def done(self) -> int:
        """Steps done."""
        return int(self.I[-1, -1])

    def failed(self) -> bool:
        """Whether no path goes on."""
        return not bool(self._integers(1).any())

    def _floats(self, row: int) -> Array:
        return self.S[:, row * self.lanes : (row + 1) * self.lanes]

    def _integers(self, row: int) -> np.ndarray:
        return self.I[:, row * self.lanes : (row + 1) * self.lanes]

    def _flat(self, rows: np.ndarray) -> np.ndarray:
        return rows.reshape(-1)[: self.task.count].copy()

    def states(self) -> Array:
        """(d, M)."""
        return np.stack([self._flat(self._floats(i)) for i in range(self.problem.dimension)])

    def result(self, kept: Array) -> Ensemble:
        """The ends so far."""
        d, m, M = self.problem.dimension, self.problem.noises, self.task.count
        iterations = int(self.I[:, -2].sum())
        module = self.kernel.module
        return Ensemble(
            y=self.states(),
            W=np.moveaxis(self.W, 1, 0).reshape(m, -1)[:, :M].copy(),
            status=self._flat(self._integers(2)),
            failed_step=self._flat(self._integers(3)),
            energy_defect=self._flat(self._floats(module.ENERGY)),
            casimir_defect=self._flat(self._floats(module.CASIMIR)),
            gradient_evaluations=int(self.I[:, -5].sum()) or iterations * self.kernel.gradients,
            structure_evaluations=int(self.I[:, -4].sum()) or iterations * self.kernel.structures,
            iterations=iterations if module.IMPLICIT else 0,
            times=np.array(self.task.stops, dtype=np.float64) * self.task.h,
            states=kept if kept.size else np.empty((0, d, M)),
            engine="compiled",
        )


def run_compiled(task: Task, problem: Problem) -> Ensemble:
    """The chunk's ends, and its states at the stops."""
    chunk = Chunk(task, problem)
    kept = np.empty((len(task.stops), problem.dimension, task.count))
    for place, stop in enumerate(task.stops):
        chunk.advance(stop - chunk.done)
        kept[place] = chunk.states()
    chunk.advance(task.steps - chunk.done)
    return chunk.result(kept)
