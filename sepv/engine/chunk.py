"""A chunk of paths in the compiled engine: the arrays that its kernel works on, and what they mean."""

from __future__ import annotations

import math

import numpy as np

from sepv import wiener
from sepv.engine.compile import FEW, LANES, Kernel, kernel
from sepv.engine.task import Task
from sepv.engine.workers import Halted, halted
from sepv.point_laws import point_law
from sepv.problem import Array, Problem
from sepv.simulation import Ensemble

# Path-steps between two looks at whether the chunk is still wanted, and at Ctrl-C: some hundredths of a second.
PIECE = 2**21
# Of paths whose increments are given, or that have none.
_NO_STREAMS = np.empty((0, 3), dtype=np.uint64)


class Chunk:
    """The state of a chunk between two calls of its kernel; `advance` goes on where it was left."""

    def __init__(self, task: Task, problem: Problem) -> None:
        lanes = 1 if task.count <= FEW else LANES
        self.task, self.problem = task, problem
        self.kernel: Kernel = kernel(task.scheme, problem, lanes=lanes, compensated=task.compensated)
        module, m = self.kernel.module, problem.noises
        blocks = -(-task.count // lanes)
        self.lanes = lanes
        self.S = np.empty((blocks, module.SIZE))
        self.I = np.empty((blocks, 4 * lanes + 5), dtype=np.int64)
        self.W = np.empty((blocks, m, lanes))
        self.grid = wiener.grid(task.steps, task.refine)
        words = wiener.stream_words(task.seed, self.grid) if task.dW is None and m else _NO_STREAMS
        streams = len(words)
        self.rng = np.empty((blocks, streams, 4, lanes), dtype=np.uint64)
        self.stack = np.empty((blocks, streams, m, lanes))
        coarse = self.grid.base << self.grid.top if streams and self.grid.base <= wiener.TOP else 0
        self.top = np.empty((blocks, coarse, m, lanes))
        self.spreads = wiener.spreads(task.h * task.steps, self.grid)
        k = task.truncation
        self.bound = math.inf if k is None else wiener.truncation_bound(task.h, k) * math.sqrt(task.h)
        self.thresholds, self.values = wiener.points(task.h, point_law(task.scheme.increments))
        self.given = np.empty((0, m, 0)) if task.dW is None else np.ascontiguousarray(task.dW)
        # All arrays are filled by the kernel, which holds no lock meanwhile.
        module.begin(
            self.S, self.I, self.W, self.rng, self.top, np.array(task.y0), words, self.spreads, self.grid.base,
            self.grid.top, task.first, task.count, self.kernel.parameters,
        )  # fmt: skip

    def advance(self, steps: int) -> None:
        """The next `steps` steps."""
        self.kernel.module.run(
            self.S, self.I, self.W, self.rng, self.stack, self.top, self.spreads, self.grid.top, self.given,
            self.task.place, self.done, self.done + steps, self.task.h, self.bound, self.thresholds,
            self.values, self.kernel.parameters,
        )  # fmt: skip

    @property
    def done(self) -> int:
        """Steps done."""
        return int(self.I[-1, -1])

    def failed(self) -> bool:
        """Whether no path goes on."""
        return not bool(self._integers(1).any())

    def _integers(self, row: int) -> np.ndarray:
        return self.I[:, row * self.lanes : (row + 1) * self.lanes]

    def states(self) -> Array:
        """(d, M)."""
        d, L = self.problem.dimension, self.lanes
        rows = self.S[:, : d * L].reshape(-1, d, L)
        return rows.swapaxes(0, 1).reshape(d, -1)[:, : self.task.count].copy()

    def result(self, kept: Array) -> Ensemble:
        """The ends so far."""
        d, m, M = self.problem.dimension, self.problem.noises, self.task.count
        y, W, energy, casimir = np.empty((d, M)), np.empty((m, M)), np.empty(M), np.empty(M)
        status, failed, work = np.empty(M, np.int64), np.empty(M, np.int64), np.empty(3, np.int64)
        self.kernel.module.ends(self.S, self.I, self.W, y, W, status, failed, energy, casimir, work)
        gradients, structures, iterations = (int(count) for count in work)
        return Ensemble(
            y=y,
            W=W,
            status=status,
            failed_step=failed,
            energy_defect=energy,
            casimir_defect=casimir,
            gradient_evaluations=gradients or iterations * self.kernel.gradients,
            structure_evaluations=structures or iterations * self.kernel.structures,
            iterations=iterations if self.kernel.module.IMPLICIT else 0,
            times=np.array(self.task.stops, dtype=np.float64) * self.task.h,
            states=kept if kept.size else np.empty((0, d, M)),
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
