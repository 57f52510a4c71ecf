"""The compiled engine as a target: lanes of SIMD code by numba (`sepv.simulate._compiled`)."""

from __future__ import annotations

from typing import Any

from sepv.problem import Problem
from sepv.schemes import Scheme
from sepv.simulate._batch import CHUNK
from sepv.simulate._compiled.compile import SINGLE_MAX_PATHS, kernel
from sepv.simulate._compiled.layout import BLOCK_LANES
from sepv.simulate._ensembles.task import Task
from sepv.simulate.targets._target import Chunk, Target
from sepv.workers import count as threads_of

# The number of chunks for each worker: several, so that the other workers need not wait for a slow
# one.
CHUNKS_PER_WORKER = 4
# Paths × steps of a chunk that is sent or stored: tenths of a second of work. A scheduler adds a
# millisecond to each.
PATH_STEPS = 2**24
# Paths × steps of a chunk for a thread, if it has few steps: hundredths of a second of work.
THREAD_STEPS = 2**20
# The most paths in a chunk that is sent or stored: the engine's arrays then take about 20 MB.
CHUNK_MAX_PATHS = 16 * CHUNK
# The most paths in a chunk if the ends of all its paths are sent to a cluster's client: about 80 MB
# for each thread.
SENT_MAX_PATHS = 4 * CHUNK_MAX_PATHS


def _prepare(scheme: Scheme, problem: Problem, paths: int, compensated: bool, _here: bool) -> None:
    kernel(scheme, problem, lanes=BLOCK_LANES if paths > SINGLE_MAX_PATHS else 1, compensated=compensated)


def _chunk(task: Task, problem: Problem) -> Chunk:
    from sepv.simulate._compiled.block_run import CompiledChunk  # needs numba

    return CompiledChunk(task, problem)


def _size(whole: Task, workers: Any, fixed: bool) -> int:
    if isinstance(workers, int) and not fixed:
        shares = CHUNKS_PER_WORKER * workers if workers > 1 else 1
        share = -(-whole.count // (shares * BLOCK_LANES)) * BLOCK_LANES
        # Python needs a tenth of a millisecond for a chunk, one thread at a time: of few steps,
        # chunks have more paths.
        long = min(THREAD_STEPS // whole.steps // BLOCK_LANES * BLOCK_LANES, SENT_MAX_PATHS)
        return min(max(share, BLOCK_LANES), max((4 if workers > 1 else 8) * CHUNK, long))
    size = min(max(PATH_STEPS // whole.steps // BLOCK_LANES * BLOCK_LANES, BLOCK_LANES), CHUNK_MAX_PATHS)
    if fixed:
        return size
    # A scheduler has the same work for a chunk of any size, so chunks are large if there are enough
    # for all threads.
    share = whole.count // (CHUNKS_PER_WORKER * max(threads_of(workers), 1)) // BLOCK_LANES * BLOCK_LANES
    return max(size, min(share, PATH_STEPS // whole.steps // BLOCK_LANES * BLOCK_LANES, SENT_MAX_PATHS))


NUMBA = Target(
    "compiled", _prepare, _chunk, _size, piece=2**21, threads=True, recorded=True, packages=("numpy", "numba")
)
