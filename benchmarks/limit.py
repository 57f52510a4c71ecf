"""How close does the compiled engine come to hand-written C? ``python -m benchmarks.limit``.

The limit is a hand-written C kernel for the rigid body, compiled here if there is a compiler. Runs
of the engine and of the kernel alternate. Ratios of their times are shown as medians with
quartiles. Times are CPU times of one thread, so that other programs on the machine disturb less;
two threads are compared with one by wall time.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import sepv
from benchmarks import over, start
from sepv import problems, schemes
from sepv.simulate import Task
from sepv.simulate._compiled.block_run import Chunk

PATHS, STEPS, H, ONE = 5008, 100, 0.01, 200_000
# Step sizes are H, or a quarter of a problem's longest step if less: Lotka-Volterra has unsolvable
# steps at h = 0.01.

EP = schemes.energy_preserving


def compile_limit() -> Any:
    """Compile and load the C kernels; None if there is no compiler."""
    compiler = shutil.which(os.environ.get("CC", "cc"))
    if compiler is None:
        return None
    out = Path(tempfile.mkdtemp()) / "limit.so"
    source = Path(__file__).with_name("limit.c")
    flags = ["-O3", "-march=native", "-shared", "-fPIC"]
    subprocess.run([compiler, *flags, "-o", str(out), str(source)], check=True)
    return ctypes.CDLL(str(out))


class Limit:
    """The C kernels on the rigid body of the paper."""

    def __init__(self, library: Any, dW: np.ndarray, one: np.ndarray) -> None:
        self.library = library
        inverse = 1 / np.array(dict(problems.rigid_body().data.parameters)["inertia"])  # type: ignore[union-attr]
        self.g = np.array([inverse[2] - inverse[1], inverse[0] - inverse[2], inverse[1] - inverse[0]])
        self.start = np.asarray(problems.rigid_body().initial)
        self.blocks = np.ascontiguousarray(dW[:, 0].reshape(STEPS, -1, 16).transpose(1, 0, 2))
        self.one = one[:, 0, 0].copy()
        self.y = np.repeat(self.start[:, None], PATHS, axis=1)

    def many(self, iterations: int = 3) -> Callable[[], None]:
        """Run the C kernel over all paths at once."""

        def job() -> None:
            self.y[:] = self.start[:, None]
            self.library.simd(
                _at(self.y), ctypes.c_long(PATHS), _at(self.blocks), ctypes.c_long(STEPS), ctypes.c_double(H),
                _at(self.g), ctypes.c_int(iterations),
            )  # fmt: skip

        return job

    def volterra(self, h: float, iterations: int) -> Callable[[], None]:
        """Run the C kernel of Lotka-Volterra with steps h over all paths.
        Increments for H are scaled to h.
        """
        start, blocks = np.asarray(problems.lotka_volterra().initial), np.sqrt(h / H) * self.blocks

        def job() -> None:
            self.y[:] = start[:, None]
            self.library.simd_volterra(
                _at(self.y), ctypes.c_long(PATHS), _at(blocks), ctypes.c_long(STEPS), ctypes.c_double(h),
                ctypes.c_int(iterations),
            )  # fmt: skip

        return job

    def single(self, iterations: int = 3) -> Callable[[], None]:
        """Run the scalar C kernel over one path."""

        def job() -> None:
            self.library.scalar(
                _at(self.start.copy()), _at(self.one), ctypes.c_long(ONE), ctypes.c_double(H), _at(self.g),
                ctypes.c_int(iterations),
            )  # fmt: skip

        return job

    def defect(self, problem: sepv.Problem) -> float:
        """The largest energy defect at the end of the last run, which was of this problem."""
        before = problem.hamiltonian(np.asarray(problem.initial))
        return float(np.abs(problem.hamiltonian(self.y) - before).max())


def _at(array: np.ndarray) -> Any:
    return array.ctypes.data_as(ctypes.c_void_p)


def given(problem: sepv.Problem, h: float, dW: np.ndarray) -> Callable[[], Any]:
    """The engine's kernel over given increments, as `sepv.ensemble(dW=…)` runs it."""
    steps, _, paths = dW.shape
    start = np.asarray(problem.initial, dtype=np.float64)
    task = Task(EP, problem, start, h, steps, 0, paths, 0, None, 2, (), False, True, dW)

    def job() -> Any:
        chunk = Chunk(task, problem)
        chunk.advance(steps)
        return chunk.result(np.empty((0, problem.dimension, paths)))

    return job


def drawn(problem: sepv.Problem, h: float, workers: int = 1, paths: int = PATHS) -> Callable[[], Any]:
    """A complete run of `sepv.ensemble`, which draws the increments itself."""
    return lambda: sepv.ensemble(
        EP, problem, h=h, steps=STEPS, paths=paths, engine="compiled", workers=workers
    )


def paired(
    jobs: list[tuple[str, Callable[[], Any], float]], base: int | list[int], rounds: int, clock: Any
) -> list[list[str]]:
    """Rows (name, ns per path and step, ratio to jobs[base]) with medians and quartiles.
    The jobs run in turn.

    If `base` is a list, it has the index of the base of each job.
    """
    bases = [base] * len(jobs) if isinstance(base, int) else base
    times = np.empty((rounds, len(jobs)))
    for _, job, _ in jobs:
        job()
    for r in over(range(rounds), lambda n: f"round {n + 1} of {rounds}"):
        for j, (_, job, size) in enumerate(jobs):
            begun = clock()
            job()
            times[r, j] = (clock() - begun) / size * 1e9
    rows = []
    for j, (name, _, _) in enumerate(jobs):
        low, middle, high = np.quantile(times[:, j], [0.25, 0.5, 0.75])
        a, b, c = np.quantile(times[:, j] / times[:, bases[j]], [0.25, 0.5, 0.75])
        rows.append([name, f"{middle:.2f}  [{low:.2f}, {high:.2f}]", f"{b:.2f}  [{a:.2f}, {c:.2f}]"])
    return rows


def show(title: str, rows: list[list[str]], notes: dict[int, str] | None = None) -> None:
    """Print one table of times and their ratios to the base."""
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for heading in ("", "ns per path and step", "ratio", "largest energy defect"):
        table.add_column(heading)
    for n, row in enumerate(rows):
        table.add_row(*row, (notes or {}).get(n, ""))
    out = Console(width=116)
    out.print(table)
    out.print()


def many_paths(limit: Limit | None, dW: np.ndarray, rounds: int) -> None:
    """Print the times of many paths of three problems, with increments given and drawn,
    against the C kernels.
    """
    jobs: list[tuple[str, Callable[[], Any], float]] = []
    size, notes = float(PATHS * STEPS), {}
    if limit is not None:
        for iterations in (3, 4):
            jobs.append((f"C, SIMD, {iterations} iterations (P1)", limit.many(iterations), size))
            limit.many(iterations)()
            notes[len(jobs) - 1] = f"{limit.defect(problems.rigid_body()):.1e}"
    for name in ("rigid-body", "pendulum", "lotka-volterra"):
        problem = problems.by_name(name)
        h = min(H, (problem.longest_step or 1.0) / 4)
        scale = np.sqrt(h / H)
        increments = np.ascontiguousarray(scale * np.repeat(dW, problem.noises, axis=1))
        for what, job in (("increments given", given(problem, h, increments)), ("drawn", drawn(problem, h))):
            jobs.append((f"{name}, {what}", job, size))
            notes[len(jobs) - 1] = f"{job().energy_defect.max():.1e}"
    bases = [0] * len(jobs)
    if limit is not None:
        # The last two rows are of Lotka-Volterra. Their base is the C kernel of this problem with
        # four iterations, the most that a path needs with these increments.
        bases[-2:] = [len(jobs)] * 3
        jobs.append(("C, SIMD, lotka-volterra, 4 iterations", limit.volterra(h, 4), size))
        limit.volterra(h, 4)()
        notes[len(jobs) - 1] = f"{limit.defect(problem):.1e}"
    show(f"{PATHS} paths, one core, CPU time", paired(jobs, bases, rounds, time.thread_time), notes)


def one_path(limit: Limit | None, dW: np.ndarray, rounds: int) -> None:
    """Print the time of one path against scalar C."""
    jobs: list[tuple[str, Callable[[], Any], float]] = []
    if limit is not None:
        jobs += [(f"C, {n} iterations", limit.single(n), float(ONE)) for n in (3, 4)]
    problem = problems.rigid_body()
    job = given(problem, H, dW)
    jobs.append(("rigid-body, increments given", job, float(ONE)))
    many = lambda: sepv.long_path(EP, problem, h=H, steps=ONE, engine="compiled")  # noqa: E731
    jobs.append(("rigid-body, sepv.long_path", many, float(ONE)))
    show(f"one path of {ONE} steps, CPU time", paired(jobs, 0, rounds, time.thread_time),
         {len(jobs) - 2: f"{job().energy_defect.max():.1e}"})  # fmt: skip


def threads(limits: list[Limit], rounds: int) -> None:
    """Print the wall times of two threads and of one, with so many paths that waking a second core
    costs little.

    The C kernel runs too, twenty times over two sets of paths, because two cores are seldom twice
    as fast as one.
    """
    problem, size = problems.rigid_body(), 40.0 * PATHS * STEPS
    jobs = [(f"{w} thread{'s' * (w > 1)}", drawn(problem, H, w, 40 * PATHS), size) for w in (2, 1)]
    with ThreadPoolExecutor(2) as pool:
        if limits:
            work = [limit.many() for limit in limits]
            twenty = lambda job: [job() for _ in range(20)]  # noqa: E731
            jobs.append(("C, 2 threads", lambda: list(pool.map(twenty, work)), size))
            jobs.append(("C, 1 thread", lambda: [twenty(job) for job in work], size))
        rows = paired(jobs, [0, 0, 2, 2][: len(jobs)], rounds, time.perf_counter)
    show(f"{40 * PATHS} paths, wall time", rows)


def scaling(rounds: int) -> None:
    """Print how the cost grows with paths and steps: slopes of log time against log size."""
    problem, table = (
        problems.rigid_body(),
        Table(title="cost, CPU time", title_justify="left", box=None, pad_edge=False),
    )
    for heading in ("", "sizes", "ns per path and step", "exponent"):
        table.add_column(heading)
    grids: list[tuple[str, list[int], Callable[[int], Any], Callable[[int], int]]] = [
        ("paths M, 100 steps", [100, 1000, 10_000, 100_000, 1_000_000],
         lambda n: sepv.ensemble(EP, problem, h=H, steps=STEPS, paths=n, engine="compiled"), lambda n: n * STEPS),
        ("steps N, 64 paths", [100, 1000, 10_000, 100_000],
         lambda n: sepv.ensemble(EP, problem, h=H, steps=n, paths=64, engine="compiled"), lambda n: n * 64),
        ("steps N, one path", [1000, 10_000, 100_000, 1_000_000, 10_000_000],
         lambda n: sepv.long_path(EP, problem, h=H, steps=n, engine="compiled"), lambda n: n),
    ]  # fmt: skip
    for name, sizes, job, work in over(grids, lambda grid: grid[0]):
        costs = []
        for size in sizes:
            repeats = rounds if work(size) < 10**7 else 1
            taken = []
            for _ in range(repeats):
                begun = time.thread_time()
                job(size)
                taken.append(time.thread_time() - begun)
            costs.append(float(np.median(taken)))
        exponent = np.polyfit(np.log(sizes), np.log(costs), 1)[0]
        each = ", ".join(f"{c / work(s) * 1e9:.1f}" for c, s in zip(costs, sizes, strict=True))
        table.add_row(name, f"{sizes[0]:.0e} … {sizes[-1]:.0e}", each, f"{exponent:.2f}")
    Console(width=116).print(table)


_FRESH = """
import time
begun = time.perf_counter()
import sepv
imported = time.perf_counter() - begun
problem = sepv.problems.rigid_body()
begun = time.perf_counter()
sepv.ensemble(sepv.schemes.energy_preserving, problem, h=0.01, steps=100, paths={paths}, engine="compiled")
seconds = time.perf_counter() - begun
# Not getrusage, whose maximum begins with what the parent has.
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(imported, seconds, int(peak.split()[1]) / 1024)
"""


def fresh(paths: int, folder: str) -> list[float]:
    """The import time, the time of the first ensemble, and the peak memory in MB, of a new
    process.
    """
    environment = {**os.environ, "SEPV_CACHE_DIR": folder}
    out = subprocess.run(
        [sys.executable, "-c", _FRESH.format(paths=paths)],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return [float(v) for v in out.stdout.split()]


def starts() -> None:
    """Print the times of a start with a cold and a warm cache, and the memory of a million
    paths.
    """
    with tempfile.TemporaryDirectory() as folder:
        cold, warm, large = fresh(5000, folder), fresh(5000, folder), fresh(1_000_000, folder)
    out = Console(width=116)
    out.print(f"\nimport sepv: {warm[0]:.3f} s")
    out.print(f"first ensemble of 5000 paths, wall: cold cache {cold[1]:.2f} s, warm cache {warm[1]:.2f} s")
    out.print(f"peak memory: 5000 paths {warm[2]:.0f} MB, 10⁶ paths {large[2]:.0f} MB")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--skip", nargs="*", default=[], choices=["scaling", "starts", "threads", "one"])
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    # The increments are truncated beforehand, as the scheme requires, because the C kernels do not
    # truncate.
    cut = sepv.simulate.truncate
    dW = cut(np.sqrt(H) * rng.standard_normal((STEPS, 1, PATHS)), H)
    single = cut(np.sqrt(H) * rng.standard_normal((ONE, 1, 1)), H)
    library = compile_limit()
    limit = None if library is None else Limit(library, dW, single)
    if limit is None:
        print("no C compiler: ratios are to the engine's own first row")
    parts: dict[str, Callable[[], None]] = {
        "many": lambda: many_paths(limit, dW, options.rounds),
        "one": lambda: one_path(limit, single, options.rounds),
        "threads": lambda: threads(
            [] if limit is None else [limit, Limit(library, dW, single)], options.rounds
        ),
        "scaling": lambda: scaling(3),
        "starts": starts,
    }
    for name in over([name for name in parts if name not in options.skip]):
        parts[name]()
    print(f"load of the machine at the end: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; "
          f"peak memory here {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024} MB")  # fmt: skip


if __name__ == "__main__":
    start(main)
