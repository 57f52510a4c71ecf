"""A card as a target (the extra cuda), and the same text on this machine's processor,
by its C compiler.

Read the C first: `path.c`, the loop over the steps of a path; `newton.c`, `explicit.c` or
`stages.c`, the solution of a step; `draw.c`, the increments. `text` prints a problem's and a
scheme's functions before them (`printer`); `devices` compiles and launches, on a card by CuPy,
which uses NVRTC, or on the host; `chunk` drives a chunk of paths on a device. A path whose step the
kernel does not solve waits for the core, which solves it, and then catches up.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from sepv.problem import Problem
from sepv.schemes import Scheme
from sepv.simulate._ensembles.task import Task
from sepv.simulate.targets._target import Chunk, Target
from sepv.simulate.targets.cuda import chunk, devices
from sepv.simulate.targets.cuda.text import kernel_text

# The most paths of a chunk, which fill a card, and the bytes of its arrays.
CHUNK_PATHS, CHUNK_BYTES = 2**20, 2**32


def _prepare(
    device: Callable[[], Any], scheme: Scheme, problem: Problem, _paths: int, compensated: bool, here: bool
) -> None:
    kernel = kernel_text(scheme, problem, compensated)
    if here:
        device().compiled(kernel.text)


def _chunk(device: Callable[[], Any], task: Task, problem: Problem) -> Chunk:
    return chunk.CudaChunk(task, problem, device())


def _size(task: Task, _workers: Any, _fixed: bool) -> int:
    return max(min(CHUNK_PATHS, CHUNK_BYTES // chunk.bytes_of_path(task) // 1024 * 1024), 1024)


def _target(name: str, device: Callable[[], Any], packages: tuple[str, ...]) -> Target:
    return Target(
        name,
        partial(_prepare, device),
        partial(_chunk, device),
        _size,
        piece=2**27,
        threads=True,
        recorded=True,
        packages=packages,
    )


# The client of a cluster needs no CuPy, so that its version is not compared.
CUDA = _target("cuda", devices.card, ("numpy",))
ON_HOST = _target("cuda-on-host", devices.host, ("numpy",))
