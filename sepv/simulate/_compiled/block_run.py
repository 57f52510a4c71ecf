"""A chunk of paths in the compiled engine: the arrays that its kernel reads and writes,
and their meaning.
"""

from __future__ import annotations

import ctypes
import math
from itertools import accumulate
from typing import Any

import numpy as np

from sepv.core.newton import Status
from sepv.problem import Array, Problem
from sepv.schemes import point_law
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener
from sepv.simulate._batch import Ensemble
from sepv.simulate._compiled import layout
from sepv.simulate._compiled.compile import SINGLE_MAX_PATHS, Kernel, kernel
from sepv.simulate._ensembles.task import Task


def aligned(*shapes: tuple[int, ...]) -> list[np.ndarray]:
    """Make arrays of zeros in one memory block, each from a cache line on,
    so that no 512-bit load spans two lines.
    """
    line = layout.CACHE_LINE // 8
    sizes = [-(-math.prod(shape) // line) * line for shape in shapes]
    room = np.zeros(sum(sizes) + line)
    ends = list(accumulate(sizes, initial=-room.ctypes.data // 8 % line))
    return [
        room[end : end + math.prod(shape)].reshape(shape) for end, shape in zip(ends, shapes, strict=False)
    ]


# The C signature of `CompiledChunk._solve`: three addresses and the length of a row of increments.
LEFT_OVER = ctypes.CFUNCTYPE(*[ctypes.c_int64] * 5)


def _at(address: int, count: int, dtype: Any = np.float64) -> np.ndarray:
    """The array of `count` numbers at an address."""
    room: Any = (ctypes.c_char * (count * 8)).from_address(address)
    return np.frombuffer(room, dtype)


class CompiledChunk:
    """A chunk of paths at some step; `advance` takes further steps by the compiled kernel."""

    def __init__(self, task: Task, problem: Problem) -> None:
        from sepv.simulate._compiled.store import ordinary

        lanes = 1 if task.count <= SINGLE_MAX_PATHS else layout.BLOCK_LANES
        self.task, self.problem = task, problem
        self.driver, self.draws = ordinary("driver"), ordinary("lanes")
        self.kernel: Kernel = kernel(task.scheme, problem, lanes=lanes, compensated=task.compensated)
        # An exception in `_solve`, kept here because it cannot pass through the compiled code that
        # calls `_solve`.
        self.raised: BaseException | None = None
        m, self.lanes = problem.noises, lanes
        self.y0 = np.array(task.y0, dtype=np.float64)
        # Results that are read from outside: the number of steps done, the sums of the increments,
        # the states and the defects of energy and Casimirs, the status and the failed step of each
        # path.
        self.steps, self.W = np.zeros(1, np.int64), np.empty((m, task.count))
        self.ends = np.empty((problem.dimension + 2, task.count))
        self.marks = np.empty((2, task.count), np.int64)
        self.grid = wiener.grid(task.steps, task.refine)
        drawn = task.dW is None and m > 0
        self.words = wiener.stream_words(task.seed, self.grid) if drawn else np.empty((0, 3), np.uint64)
        self.spreads = wiener.spreads(task.h * task.steps, self.grid) if drawn else np.empty(0)
        k = task.truncation
        self.bound = math.inf if k is None else bounded.truncation_bound(task.h, k) * math.sqrt(task.h)
        thresholds, self.values = bounded.points(task.h, point_law(task.scheme.increments))
        self.thresholds = np.array([-math.inf, *thresholds])
        self.given = np.empty((0, m, 0)) if task.dW is None else np.ascontiguousarray(task.dW)

    def _solve(self, S: int, I: int, increments: int, width: int) -> int:
        """Solve a step by the scheme's own solver in Python, for the lanes (paths)
        that compiled code has not solved.

        S, I : addresses of the block's floats and integers
        increments : address of the step's increments (m, width), of which the first columns are the
            block's lanes
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
            except KeyboardInterrupt as error:  # raised again by `advance`; this solve is repeated
                self.raised = error
            except BaseException as error:
                self.raised = error
                integers[layout.STATUS * L :][busy] = Status.NO_CONVERGENCE
                return 0
        for stage in range(module.STAGES):  # each z_i is the whole change Σ b_i z_i, because Σ b_i = 1
            state[module.UNKNOWNS + stage * d :][:d, busy] = found.change
        integers[layout.STATUS * L :][busy] = found.status
        counts = found.iterations, found.gradient_evaluations, found.structure_evaluations
        for place, count in zip((layout.WORK, layout.EVALUATIONS, layout.STRUCTURES), counts, strict=True):
            # If a kernel counts no evaluations, their number is its iterations times the
            # evaluations in an iteration.
            integers[4 * L + place] += count.sum() if place == layout.WORK or integers[4 * L + place] else 0
        return 0

    def advance(self, steps: int) -> None:
        """Take the next `steps` steps."""
        module, goal = self.kernel.module, self.done + steps
        if self.done == 0:
            # Arrays of each block: its state, streams, right halves for later steps, coarse
            # increments. If blocks run to the end at once, they share one set of these arrays,
            # which then stays in the cache.
            L, m, grid, streams = self.lanes, self.problem.noises, self.grid, len(self.words)
            blocks = 1 if goal == self.task.steps else -(-self.task.count // L)
            piece = max(16, 1024 // L)
            coarse = grid.base << grid.top if streams and grid.base <= wiener.TOP_INCREMENTS else 0
            S, I, sums, rng, stack, top, *self.buffers = aligned(
                (blocks, module.SIZE), (blocks, 4 * L + layout.NUMBERS), (blocks, m, L), (blocks, streams, 4, L),
                (blocks, streams, m, L), (blocks, coarse, m, L), (piece, m, L), (piece * (self.values.size > 0), m, L),
            )  # fmt: skip
            self.I = I.view(np.int64)
            self.blocks = S, self.I, sums, rng.view(np.uint64), stack, top
        left_over = LEFT_OVER(self._solve)
        # `ctypes.cast` would make a cycle of references: the garbage collector alone could then
        # free the arrays.
        address = ctypes.c_void_p.from_buffer(left_over).value
        self.driver.run(
            self.draws.BEGIN_ADDRESS, self.draws.FILL_ADDRESS, self.draws.NORMALS_ADDRESS, module.STARTING,
            module.ADVANCING, address,
            *self.blocks, self.ends, self.W, self.marks, self.steps, goal, self.y0, self.words, self.task.first,
            self.spreads, self.grid.base, self.grid.top, self.given, self.task.place, self.task.h, self.bound,
            self.thresholds, self.values, self.kernel.parameters, *self.buffers,
        )  # fmt: skip
        if self.raised is not None:
            raised, self.raised = self.raised, None
            raise raised

    @property
    def done(self) -> int:
        """The number of steps done."""
        return int(self.steps[0])

    def _settle(self) -> None:
        """Set the paths to the initial state if no step has been taken."""
        if self.done == 0:
            self.advance(0)

    def failed(self) -> bool:
        """True if every path of the chunk has failed."""
        self._settle()
        return bool(self.marks[0].all())

    def states(self) -> Array:
        """The present states (d, M)."""
        self._settle()
        return self.ends[:-2].copy()

    def result(self, kept: Array) -> Ensemble:
        """The present states as an `Ensemble` of the chunk's own arrays;
        `kept` are the states at the chosen times.
        """
        self._settle()
        sums = self.I[:, 4 * self.lanes :].sum(axis=0).tolist()
        gradients, structures = sums[layout.EVALUATIONS], sums[layout.STRUCTURES]
        iterations = sums[layout.WORK]
        return Ensemble(
            y=self.ends[:-2],
            W=self.W,
            status=self.marks[0],
            failed_step=self.marks[1],
            energy_defect=self.ends[-2],
            casimir_defect=self.ends[-1],
            gradient_evaluations=gradients or iterations * self.kernel.gradients,
            structure_evaluations=structures or iterations * self.kernel.structures,
            iterations=iterations if self.kernel.module.IMPLICIT else 0,
            times=np.array(self.task.stops, dtype=np.float64) * self.task.h,
            states=kept,
            engine="compiled",
        )
