"""Measurements for clusters: memory of many paths, and the cost of Dask beside threads.

    python -m benchmarks.clusters memory --paths 1e8     two functionals of 10⁸ paths, the memory
    python -m benchmarks.clusters overhead --paths 1e6   Dask against threads on the pendulum

`docs/clusters.md` has the printed results and the conditions of the measurements.
"""

from __future__ import annotations

import argparse
import os
import resource
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import sepv
from benchmarks import over, start
from sepv import problems, schemes

PENDULUM = problems.pendulum()


def position(ends: Any) -> Any:
    """The first component of each path at T."""
    return ends.y[0]


def energy(ends: Any) -> Any:
    """The energy of each path at T."""
    return PENDULUM.hamiltonian(ends.y)


def memory(paths: int, steps: int, workers: int) -> None:
    """Print moments and quantiles of two functionals, and this process's peak memory for few and
    for many paths.
    """

    def one(count: int) -> sepv.Ensemble:
        return sepv.ensemble(
            schemes.energy_preserving,
            PENDULUM,
            h=1 / steps,
            steps=steps,
            paths=count,
            reduce={"q": position, "H": energy},
            workers=workers,
        )

    before = time.perf_counter(), time.process_time()
    peaks = []
    for count in over(sorted({paths // 100, paths}), lambda n: f"{n:,} paths"):
        ends = one(count)
        peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
        print(f"{count:,} paths of {steps} steps: peak memory {peaks[-1]:.0f} MiB", flush=True)
    wall, cpu = time.perf_counter() - before[0], time.process_time() - before[1]
    print(
        f"{wall:.0f} s by the clock, {cpu:.0f} s of processor time, {workers} threads, {ends.engine} engine"
    )
    for name, found in ends.reduced.items():
        quantiles = ", ".join(f"{found.quantile(p):.6g}" for p in (1e-6, 0.5, 1 - 1e-6))
        print(
            f"{name}: mean {found.mean:.9g} ± {found.standard_error:.2g}, quantiles 1e-6, ½, 1 − 1e-6: {quantiles}"
        )


def overhead(paths: int, steps: int, rounds: int) -> None:
    """Print the time of Dask (two processes of one thread) relative to that of two threads,
    for pairs of runs.
    """
    from distributed import Client, LocalCluster

    def run(workers: Any) -> None:
        sepv.ensemble(
            schemes.energy_preserving, PENDULUM, h=1 / steps, steps=steps, paths=paths, workers=workers
        )

    with (
        LocalCluster(
            n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
        ) as cluster,
        Client(cluster) as client,
    ):
        for workers in (2, client):
            run(workers)  # compiles, and loads the code in all workers
        ratios, cpu = [], []
        for number in over(range(rounds), lambda n: f"round {n + 1} of {rounds}"):
            order: list[Any] = [2, client] if number % 2 else [client, 2]
            found = {id(w): _timed(lambda w=w: run(w), client) for w in order}
            dask, threads = found[id(client)], found[id(2)]
            ratios.append(dask[0] / threads[0])
            cpu.append(dask[1] / threads[1])
            print(
                f"threads {threads[0]:.2f} s ({threads[1]:.2f} s of processors), "
                f"Dask {dask[0]:.2f} s ({dask[1]:.2f} s): ratio {ratios[-1]:.3f}, "
                f"of processor time {cpu[-1]:.3f}; load {os.getloadavg()[0]:.1f}",
                flush=True,
            )
    for name, values in (("by the clock", ratios), ("of processor time", cpu)):
        print(
            f"{name}: median {np.median(values):.3f}, quartiles {np.quantile(values, [0.25, 0.75]).round(3)}"
        )


def _timed(job: Callable[[], None], client: Any) -> tuple[float, float]:
    """The clock and processor seconds of a job; the processor seconds include those of the
    workers.
    """

    def spent() -> float:
        return time.process_time() + sum(client.run(time.process_time).values())

    begin = spent(), time.perf_counter()
    job()
    wall = time.perf_counter() - begin[1]
    return wall, spent() - begin[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("what", choices=["memory", "overhead"])
    parser.add_argument("--paths", type=float, default=1e6)
    parser.add_argument("--steps", type=int, default=0, help="[default: 4 for memory, 128 for overhead]")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    if asked.what == "memory":
        memory(int(asked.paths), asked.steps or 4, asked.workers)
    else:
        overhead(int(asked.paths), asked.steps or 128, asked.rounds)


if __name__ == "__main__":
    start(main)
