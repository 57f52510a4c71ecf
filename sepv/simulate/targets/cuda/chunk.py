"""A chunk of paths whose steps run on a device (`devices`):
its arrays stay there until a result is asked for.
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from sepv.core.newton import Status
from sepv.problem import Problem
from sepv.problems import build
from sepv.schemes import point_law
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener
from sepv.simulate._batch import Ensemble
from sepv.simulate._ensembles.task import Task
from sepv.simulate.targets.cuda.text import draw_text, kernel_text

# The status of a path whose step waits for the core (`path.c`).
WAITING_STATUS = -1
# The bytes of the increments that are drawn before they are used, and the fewest and most steps of
# such a block.
BLOCK_BYTES, BLOCK_MIN_STEPS, BLOCK_MAX_STEPS = 2**29, 16, 256


def block_length(noises: int, paths: int) -> int:
    """The number of steps, a power of two, whose increments are in the device's memory at once."""
    return (
        1
        << min(
            max(BLOCK_BYTES // (8 * max(noises, 1) * paths), BLOCK_MIN_STEPS), BLOCK_MAX_STEPS
        ).bit_length()
        - 1
    )


def bytes_of_path(task: Task) -> int:
    """The bytes of a path's arrays: state and results, increments that wait,
    and the streams that draw them.
    """
    problem = task.problem if isinstance(task.problem, Problem) else build(task.problem)
    m, grid = problem.noises, wiener.grid(task.steps, task.refine)
    normals = grid.base << grid.top if grid.base <= wiener.TOP_INCREMENTS else 0
    return 8 * (2 * problem.dimension + 2 * m + 10 + m * (BLOCK_MAX_STEPS + normals) + grid.streams * (4 + m))


@lru_cache(maxsize=1)
def layers() -> tuple[np.ndarray, ...]:
    """The tables of NumPy's ziggurat (numpy/random/src/distributions/ziggurat_constants.h): limits,
    widths, heights.
    """
    with np.load(Path(__file__).parent / "ziggurat.npz") as tables:
        return tables["ki"], tables["wi"], tables["fi"]


class CudaChunk:
    """A chunk of paths at some step; `advance` takes further steps,
    as the chunks of the other targets do.
    """

    def __init__(self, task: Task, problem: Problem, device: Any) -> None:
        self.task, self.problem, self.device = task, problem, device
        self.kernel = kernel_text(task.scheme, problem, task.compensated)
        self.launch = device.compiled(self.kernel.text)
        self.done = 0
        xp, M, d, m = device.xp, task.count, problem.dimension, problem.noises
        self.y0 = xp.asarray(np.array(task.y0, dtype=np.float64))
        self.y, self.W = xp.repeat(self.y0[:, None], M, axis=1), xp.zeros((m, M))
        self.lost, self.worst = xp.zeros((d if task.compensated else 0, M)), xp.zeros((2, M))
        self.status, self.failed_step = xp.zeros(M, dtype=np.int64), xp.full(M, -1, dtype=np.int64)
        # Newton iterations or sweeps, evaluations of ∇H and of B, for each path.
        self.work = xp.zeros((3, M), dtype=np.int64)
        k = task.truncation
        self.bound = math.inf if k is None else bounded.truncation_bound(task.h, k) * math.sqrt(task.h)
        self.points = [xp.asarray(v) for v in bounded.points(task.h, point_law(task.scheme.increments))]
        self.length = block_length(m, M)
        given = task.dW is not None or not m
        self.increments: Any = GivenBlocks(task, device) if given else Drawn(task, device, m, self.length)

    def advance(self, steps: int) -> None:
        """Take the next `steps` steps."""
        goal = self.done + steps
        while self.done < goal:
            count = min(self.length - self.done % self.length, goal - self.done)
            dW = self.increments.block(self.done, count)
            arguments = (
                count, self.done, self.task.h, self.bound, dW, self.points[0].size, *self.points, self.y0, self.y,
                self.W, self.lost, self.worst, self.status, self.failed_step, self.work,
            )  # fmt: skip
            self.launch("advance", self.task.count, *arguments)
            while self._solved(dW, arguments):
                pass
            self.done += count

    def _solved(self, dW: Any, arguments: Any) -> bool:
        """Step the paths that wait by the scheme's own solver, and let them catch up;
        False if none waits.
        """
        xp, task = self.device.xp, self.task
        lanes = xp.flatnonzero(self.status == WAITING_STATUS)
        if not lanes.size:
            return False
        begins = self.failed_step[lanes] - self.done
        fetched = self.device.fetched
        y, raw = fetched(self.y[:, lanes]), fetched(dW[begins, :, lanes]).T
        scheme: Any = task.scheme
        solve = scheme.solve or scheme.step.solve
        seen = bounded.seen(raw, task.h, task.truncation, scheme.increments)
        found = solve(self.problem, y, task.h, np.ascontiguousarray(seen))
        self.status[lanes] = xp.asarray(found.status)
        for row, count in enumerate(
            (found.iterations, found.gradient_evaluations, found.structure_evaluations)
        ):
            self.work[row, lanes] += xp.asarray(count)
        good = found.status == Status.CONVERGED
        lanes, begins = lanes[xp.asarray(good)], begins[xp.asarray(good)]
        if lanes.size:
            self.failed_step[lanes] = -1
            changes = xp.asarray(np.ascontiguousarray(found.change[:, good]))
            self.launch("resume", lanes.size, self.task.count, lanes, begins, changes, *arguments)
        return True

    def failed(self) -> bool:
        """True if every path of the chunk has failed."""
        return bool(self.status.all())

    def states(self) -> Any:
        """The present states (d, M), an array of the device."""
        return self.y.copy()

    def result(self, kept: Any) -> Ensemble:
        """The present states as an `Ensemble` of arrays of the device;
        `kept` are the states at the chosen times.
        """
        iterations, gradients, structures = (int(v) for v in self.work.sum(axis=1))
        return Ensemble(
            y=self.y, W=self.W, status=self.status, failed_step=self.failed_step, energy_defect=self.worst[0],
            casimir_defect=self.worst[1], gradient_evaluations=gradients, structure_evaluations=structures,
            iterations=iterations if self.kernel.implicit else 0,
            times=np.array(self.task.stops, dtype=np.float64) * self.task.h, states=kept, engine=self.task.engine,
        )  # fmt: skip


class GivenBlocks:
    """Blocks of given increments, or of none if there is no noise."""

    def __init__(self, task: Task, device: Any) -> None:
        self.task, self.device = task, device

    def block(self, first: int, count: int) -> Any:
        """The increments (count, m, M) from step `first` on."""
        task, xp = self.task, self.device.xp
        if task.dW is None:
            return xp.zeros((count, 0, task.count))
        part = task.dW[first : first + count, :, task.place : task.place + task.count]
        return xp.asarray(np.ascontiguousarray(part))


class Drawn:
    """Blocks of `length` increments of m noises drawn on a device,
    with the bits of `sepv.simulate._wiener`.
    """

    def __init__(self, task: Task, device: Any, m: int, length: int) -> None:
        self.task, self.length, self.start, xp, M = task, length, -1, device.xp, task.count
        self.grid = grid = wiener.grid(task.steps, task.refine)
        words = xp.asarray(wiener.stream_words(task.seed, grid))
        self.factors = xp.asarray(wiener.spreads(task.h * task.steps, grid))
        self.layers = device.tables(layers)
        self.base = grid.base if grid.base <= wiener.TOP_INCREMENTS else 0
        self.normals = xp.empty((self.base << grid.top, m, M))
        self.states = xp.empty((len(words), 4, M), dtype=np.uint64)
        self.stack = xp.empty((len(words), m, M))
        self.out = xp.empty((min(length, task.steps), m, M))
        self.launch = device.compiled(draw_text(m), exact=True)
        self.launch(
            "begin",
            M,
            task.first,
            len(words),
            words,
            self.states,
            self.normals,
            len(self.normals),
            *self.layers,
        )

    def block(self, first: int, _count: int) -> Any:
        """The increments (k, m, M) from step `first` on; they end with their aligned block."""
        start, steps = first // self.length * self.length, self.task.steps
        if start != self.start:
            self.launch(
                "fill", self.task.count, start, min(self.length, steps - start), self.states, self.stack, self.normals,
                self.base, self.out, self.grid.streams - 1, self.factors, self.grid.top, *self.layers,
            )  # fmt: skip
            self.start = start
        return self.out[first - start :]
