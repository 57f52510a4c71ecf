"""A chunk of paths in the compiled engine: the arrays that its kernel reads and writes, and what they mean."""

from __future__ import annotations

import ctypes
import math
from typing import Any

import numpy as np

from sepv.problem import Array, Problem
from sepv.schemes import point_law
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener
from sepv.simulate._batch import Ensemble
from sepv.simulate._compiled import layout
from sepv.simulate._compiled.compile import FEW, Kernel, kernel
from sepv.simulate._ensembles.task import Task
from sepv.solve import Status


def aligned(shape: tuple[int, ...], dtype: Any = np.float64) -> np.ndarray:
    """An array of zeros that starts at a cache line, so that no register of 512 bits crosses two."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    room = np.zeros(size + layout.CACHE_LINE, np.uint8)
    first = -room.ctypes.data % layout.CACHE_LINE
    return room[first : first + size].view(dtype).reshape(shape)


# The C signature of `Chunk._solve`: three addresses and the length of a row of increments.
LEFT_OVER = ctypes.CFUNCTYPE(*[ctypes.c_int64] * 5)


def _at(address: int, count: int, dtype: Any = np.float64) -> np.ndarray:
    """The array with this many numbers at an address."""
    room: Any = (ctypes.c_char * (count * 8)).from_address(address)
    return np.frombuffer(room, dtype)


class Chunk:
    """A chunk of paths at some step; `advance` takes further steps by the compiled kernel."""

    def __init__(self, task: Task, problem: Problem) -> None:
        from sepv.simulate._compiled.store import ordinary

        lanes = 1 if task.count <= FEW else layout.LANES
        self.task, self.problem, self.driver = task, problem, ordinary("driver")
        self.kernel: Kernel = kernel(task.scheme, problem, lanes=lanes, compensated=task.compensated)
        # The exception of a solve that compiled code called: exceptions do not pass through compiled code.
        self.raised: BaseException | None = None
        module, m, blocks = self.kernel.module, problem.noises, -(-task.count // lanes)
        self.lanes = lanes
        self.start = np.zeros(module.SIZE)
        self.start[: problem.dimension * lanes] = np.repeat(np.asarray(task.y0, dtype=np.float64), lanes)
        integers = np.zeros(4 * lanes + layout.NUMBERS, np.int64)
        module.start(self.start, integers, np.zeros((1, 1, 1)), self.kernel.parameters)
        self.S = aligned((blocks, module.SIZE))
        self.I = aligned((blocks, 4 * lanes + layout.NUMBERS), np.int64)
        self.W = aligned((blocks, m, lanes))
        self.grid = wiener.grid(task.steps, task.refine)
        drawn = task.dW is None and m > 0
        self.words = wiener.stream_words(task.seed, self.grid) if drawn else np.empty((0, 3), np.uint64)
        self.spreads = wiener.spreads(task.h * task.steps, self.grid) if drawn else np.empty(0)
        k = task.truncation
        self.bound = math.inf if k is None else bounded.truncation_bound(task.h, k) * math.sqrt(task.h)
        self.thresholds, self.values = bounded.points(task.h, point_law(task.scheme.increments))
        self.given = np.empty((0, m, 0)) if task.dW is None else np.ascontiguousarray(task.dW)

    def advance(self, steps: int) -> None:
        """Take the next `steps` steps."""
        self._run(self.done + steps)

    def _solve(self, S: int, I: int, increments: int, width: int) -> int:
        """Solve a step in Python, by the scheme's own solver, for the lanes that compiled code has not solved.

        S, I : addresses of the block's floats and integers
        increments : address of the step's increments (m, width), of which the first columns are the block's lanes
        """
        L, d, m, module = self.lanes, self.problem.dimension, self.problem.noises, self.kernel.module
        state = _at(S, module.SIZE).reshape(-1, L)
        integers = _at(I, 4 * L + layout.NUMBERS, np.int64)
        busy = np.flatnonzero(integers[layout.BUSY * L :][:L])
        dW = _at(increments, m * width).reshape(m, width)[:, busy].clip(-self.bound, self.bound)
        scheme: Any = self.task.scheme
        solve = scheme.solve or scheme.step.solve
        while True:
            try:
                found = solve(self.problem, state[:d, busy], self.task.h, dW)
                break
            except KeyboardInterrupt as error:  # raised again between two pieces; this solve is repeated
                self.raised = error
            except BaseException as error:
                self.raised = error
                integers[layout.STATUS * L :][busy] = Status.NO_CONVERGENCE
                return 0
        for stage in range(module.STAGES):  # the weights of the stages have the sum 1
            state[module.UNKNOWNS + stage * d :][:d, busy] = found.change
        integers[layout.STATUS * L :][busy] = found.status
        counts = found.iterations, found.gradient_evaluations, found.structure_evaluations
        for place, count in zip((layout.WORK, layout.EVALUATIONS, layout.STRUCTURES), counts, strict=True):
            # If a kernel counts no work, the work is its iterations times the cost of one.
            integers[4 * L + place] += count.sum() if place == layout.WORK or integers[4 * L + place] else 0
        return 0

    def _run(self, goal: int) -> None:
        module = self.kernel.module
        if self.done == 0:
            # Streams, waiting halves, and coarse increments. Blocks that run to the end at once share one set, which
            # then stays in the cache.
            blocks = 1 if goal == self.task.steps else len(self.S)
            m, grid, streams = self.problem.noises, self.grid, len(self.words)
            self.rng = aligned((blocks, streams, 4, self.lanes), np.uint64)
            self.stack = aligned((blocks, streams, m, self.lanes))
            coarse = grid.base << grid.top if streams and grid.base <= wiener.TOP else 0
            self.top = aligned((blocks, coarse, m, self.lanes))
        L, m, piece = self.lanes, self.problem.noises, max(16, 1024 // self.lanes)
        buffer, points, halves = (
            aligned((n, m, L)) for n in (piece, piece * (self.values.size > 0), len(self.top[0]) // 2)
        )
        scratch = aligned((L,), np.uint64), aligned((-(-L // 64) * 64,), np.uint8)
        left_over = LEFT_OVER(self._solve)
        # Not `ctypes.cast`, whose references go round: the arrays of a chunk would wait for the garbage collector.
        address = ctypes.c_void_p.from_buffer(left_over).value
        self.driver.run(
            self.driver.BEGINNING, self.driver.FILLING, self.driver.DRAWING, module.ADVANCING, address,
            self.S, self.I, self.W, self.start, self.task.count, self.words, self.task.first, self.rng, self.stack,
            self.top, self.spreads, self.grid.base, self.grid.top, self.given, self.task.place, self.done, goal,
            self.task.h, self.bound, self.thresholds, self.values, self.kernel.parameters, buffer, points, halves,
            scratch,
        )  # fmt: skip
        if self.raised is not None:
            raised, self.raised = self.raised, None
            raise raised

    @property
    def done(self) -> int:
        """The number of steps that are done."""
        return int(self.I[-1, 4 * self.lanes + layout.DONE])

    def _settle(self) -> None:
        """Set the blocks to the initial state, unless a step has done so."""
        if self.done == 0:
            self._run(0)

    def failed(self) -> bool:
        """True if no path goes on."""
        self._settle()
        return not bool(self._integers(layout.ALIVE).any())

    def _integers(self, row: int) -> np.ndarray:
        return self.I[:, row * self.lanes : (row + 1) * self.lanes]

    def _paths(self, rows: np.ndarray) -> np.ndarray:
        """Rearrange numbers of all lanes, (blocks, n, L), as those of the paths, (n, M)."""
        blocks, n, lanes = rows.shape
        return rows.transpose(1, 0, 2).reshape(n, blocks * lanes)[:, : self.task.count].copy()

    def _rows(self, of: np.ndarray, first: int, count: int) -> np.ndarray:
        """Rows of the floats S or the integers I of all blocks, as (blocks, count, L)."""
        L = self.lanes
        return of[:, first * L : (first + count) * L].reshape(-1, count, L)

    def states(self) -> Array:
        """The states (d, M)."""
        self._settle()
        return self._paths(self._rows(self.S, 0, self.problem.dimension))

    def result(self, kept: Array) -> Ensemble:
        """The ensemble of the present states; `kept` are the states at the chosen times, (K, d, M)."""
        module, L, y = self.kernel.module, self.lanes, self.states()
        sums = self.I[:, 4 * L :].sum(axis=0).tolist()
        gradients, structures = sums[layout.EVALUATIONS], sums[layout.STRUCTURES]
        iterations = sums[layout.WORK]
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
