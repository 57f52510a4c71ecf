"""Ensembles on a card: agreement with NumPy, times, compilation, and many paths in constant memory,
as JSON.

    python -m benchmarks.gpu

A time is that of the whole run of a chunk, increments drawn and defects of invariants included, in
nanoseconds for one step of one path. The parts of it are measured by CUDA's events. Beside it stand
diffrax's solvers, if diffrax sees the card: they draw their own increments and compute no defects.
On a machine without a card it says so and exits with 2.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import sepv
from benchmarks import start
from sepv import problems, schemes
from sepv.posing import field_in
from sepv.simulate import Task, run_arguments, run_task
from sepv.simulate.targets.cuda import chunk, devices

GPU_PROBLEMS = ("rigid-body", "pendulum", "lotka-volterra")
GPU_H, GPU_STEPS, GPU_REPEATS = 0.01, 100, 3
# Paths of a timed chunk, of the comparison with NumPy, and of the reduced run.
TIMED_PATHS, COMPARED_PATHS, REDUCED_PATHS = 2**20, 500, 2**30
# The largest relative difference from NumPy that counts as agreement after GPU_STEPS steps, in
# roundings of a step.
ULPS = 64


def task(scheme: str, problem: str, paths: int) -> Task:
    """The chunk of all `paths` paths of an ensemble."""
    method, system, start, steps, k = run_arguments(
        schemes.by_name(scheme), problem, GPU_H, None, GPU_STEPS, None, "own", None
    )
    return Task(
        scheme=method, problem=system, y0=start, h=GPU_H, steps=steps, first=0, count=paths, seed=1, refine=None,
        truncation=k, stops=(), compensated=False, engine="cuda",
    )  # fmt: skip


def agreement(whole: Task) -> dict[str, Any]:
    """The largest differences between the card and NumPy over paths of an ensemble,
    in roundings of the largest |y|.
    """
    card, plain = run_task(whole), run_task(replace(whole, engine="numpy"))
    scale = np.finfo(float).eps * np.abs(plain.y).max()
    return {
        "increments_differ": int(np.count_nonzero(card.W != plain.W)),
        "statuses_differ": int(np.count_nonzero(card.status != plain.status)),
        "roundings": float(np.abs(card.y - plain.y).max() / scale),
        "energy_defect": float(card.energy_defect.max()),
        "energy_defect_numpy": float(plain.energy_defect.max()),
    }


def timed(whole: Task, problem: sepv.Problem) -> dict[str, float]:
    """The best of GPU_REPEATS times of a chunk, in ns per path and step: in all, and of each
    kernel.
    """
    import cupy

    device = devices.card()
    best: dict[str, float] = {}
    for measured in [False] * GPU_REPEATS + [
        True
    ] * GPU_REPEATS:  # events between launches take time of their own
        own: dict[str, float] = {}

        def launcher(launch: Callable[..., None], own: dict[str, float] = own) -> Callable[..., None]:
            def launched(kernel: str, *arguments: Any) -> None:
                start, stop = cupy.cuda.Event(), cupy.cuda.Event()
                start.record()
                launch(kernel, *arguments)
                stop.record()
                stop.synchronize()
                own[kernel] = own.get(kernel, 0.0) + cupy.cuda.get_elapsed_time(start, stop) / 1e3

            return launched

        begun = time.perf_counter()
        run = chunk.CudaChunk(whole, problem, device)
        if measured:
            run.launch = launcher(run.launch)
            run.increments.launch = launcher(run.increments.launch)
        run.advance(GPU_STEPS)
        cupy.cuda.Device().synchronize()
        if not measured:
            own["whole"] = time.perf_counter() - begun
        del run
        for name, seconds in own.items():
            best[name] = min(best.get(name, np.inf), seconds)
    return {name: round(seconds / whole.count / GPU_STEPS * 1e9, 5) for name, seconds in best.items()}


COMPILE = f"""
import time
from sepv import problems, schemes
from sepv.simulate.targets.cuda import devices, text

card = devices.card()
card.xp.zeros(1)
begun = time.perf_counter()
card.compiled(text.draw_text(1), exact=True)
for name in {GPU_PROBLEMS}:
    card.compiled(text.kernel_text(schemes.energy_preserving, problems.by_name(name), False).text)
print(time.perf_counter() - begun)
"""


def compilation() -> dict[str, float]:
    """Seconds to record and compile (2.1) for the three systems, with an empty cache on disk,
    and with a full one.
    """
    with TemporaryDirectory() as room:
        where = {**os.environ, "CUPY_CACHE_DIR": room}
        found = [subprocess.run([sys.executable, "-c", COMPILE], env=where, text=True, check=True, capture_output=True)
                 for _ in range(2)]  # fmt: skip
    return {name: round(float(run.stdout), 3) for name, run in zip(("cold", "warm"), found, strict=True)}


def bandwidth() -> float:
    """Bytes read and written by a copy of a large array, in TB/s."""
    import cupy

    a = cupy.zeros(2**28)
    b = cupy.empty_like(a)
    seconds = []
    for _ in range(GPU_REPEATS + 1):
        start, stop = cupy.cuda.Event(), cupy.cuda.Event()
        start.record()
        cupy.copyto(b, a)
        stop.record()
        stop.synchronize()
        seconds.append(cupy.cuda.get_elapsed_time(start, stop) / 1e3)
    return round(2 * a.nbytes / min(seconds) / 1e12, 2)


def peers(name: str, paths: int = 2**18) -> dict[str, Any]:
    """diffrax's solvers for a system whose noises drive one field: ns per path and step,
    and the largest error of H.
    """
    import diffrax
    import jax

    jax.config.update("jax_enable_x64", True)
    jnp = jax.numpy
    problem = problems.by_name(name)
    f, c, start = field_in(jnp, problem), jnp.asarray(problem.c), jnp.asarray(problem.initial)

    def run(solver: Any, key: Any) -> Any:
        noise = diffrax.UnsafeBrownianPath(shape=(len(problem.c),), key=key)
        terms = diffrax.MultiTerm(
            diffrax.ODETerm(lambda t, y, _: f(y)),  # noqa: ARG005 - diffrax's signature
            diffrax.ControlTerm(lambda t, y, _: f(y)[:, None] * c, noise),  # noqa: ARG005
        )
        found = diffrax.diffeqsolve(
            terms,
            solver,
            0.0,
            GPU_STEPS * GPU_H,
            GPU_H,
            start,
            max_steps=GPU_STEPS + 8,
            adjoint=diffrax.ForwardMode(),
        )
        return found.ys[-1]

    keys, table = jax.random.split(jax.random.PRNGKey(0), paths), {}
    for solver in (diffrax.EulerHeun(), diffrax.Heun(), diffrax.ReversibleHeun()):
        whole = jax.jit(jax.vmap(lambda key, solver=solver: run(solver, key)))
        begun = time.perf_counter()
        whole(keys).block_until_ready()
        first = time.perf_counter() - begun
        seconds = []
        for _ in range(GPU_REPEATS):
            begun = time.perf_counter()
            ends = whole(keys).block_until_ready()
            seconds.append(time.perf_counter() - begun)
        with np.errstate(all="ignore"):  # an explicit solver may leave the domain
            defect = problem.hamiltonian(np.asarray(ends).T) - problem.hamiltonian(np.array(start))
        table[type(solver).__name__] = {
            "ns": round(min(seconds) / paths / GPU_STEPS * 1e9, 4), "first_call_s": round(first, 2),
            "end_energy_defect": float(np.nanmax(np.abs(defect))),
        }  # fmt: skip
    return table


def reduced(paths: int = REDUCED_PATHS) -> dict[str, Any]:
    """Moments and quantiles of many paths: seconds, and the card's memory before and after."""
    import cupy

    pool = cupy.get_default_memory_pool()
    begun = time.perf_counter()
    ends = sepv.ensemble(
        "energy-preserving", "rigid-body", h=GPU_H, steps=GPU_STEPS, paths=paths, engine="cuda",
        reduce={"y1": lambda ends: ends.y[0], "energy": lambda ends: ends.energy_defect},
    )  # fmt: skip
    seconds, y1 = time.perf_counter() - begun, ends.reduced["y1"]
    return {
        "paths": y1.count, "seconds": round(seconds, 2), "ns": round(seconds / paths / GPU_STEPS * 1e9, 4),
        "mean_y1": y1.mean, "standard_error": y1.standard_error,
        "largest_energy_defect": ends.reduced["energy"].maximum,
        "card_gigabytes": round(pool.total_bytes() / 1e9, 2), "reason": ends.reason,
    }  # fmt: skip


def main() -> None:
    """Print the measurements as JSON; the exit code is 1 if the card and NumPy disagree,
    and 2 without a card.
    """
    try:
        device = devices.card()
    except sepv.UsageError as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from None
    properties = device.xp.cuda.runtime.getDeviceProperties(0)
    found: dict[str, Any] = {
        "card": properties["name"].decode(),
        "cupy": device.xp.__version__,
        "bandwidth_TB_s": bandwidth(),
    }
    found["compile_s"] = compilation()
    for name in GPU_PROBLEMS:
        found[name] = agreement(task("energy-preserving", name, COMPARED_PATHS)) | {
            scheme: timed(task(scheme, name, TIMED_PATHS), problems.by_name(name))
            for scheme in ("energy-preserving", "euler-heun")
        }
        device.xp.get_default_memory_pool().free_all_blocks()
    found["reduced"] = reduced()
    device.xp.get_default_memory_pool().free_all_blocks()
    if find_spec("diffrax"):
        os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
        found["diffrax"] = {name: peers(name) for name in GPU_PROBLEMS}
    print(json.dumps(found, indent=1))
    agree = all(
        found[name]["roundings"] <= ULPS * GPU_STEPS**0.5 and not found[name]["increments_differ"]
        for name in GPU_PROBLEMS
    )
    if not agree:
        raise SystemExit(1)


if __name__ == "__main__":
    start(main)
