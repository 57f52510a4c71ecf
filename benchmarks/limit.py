"""How close does the compiled engine come to hand-written C? ``python -m benchmarks.limit``.

The limit is a hand-written C kernel for the rigid body, compiled here if there is a compiler. Runs
of the engine and of the kernel alternate. Ratios of their times are shown as medians with
quartiles. Times are CPU times of one thread, so that other programs on the machine disturb less.
How the cost grows with paths, steps and cores is in `benchmarks.growth`.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import sepv
from benchmarks import arguments, over, start
from sepv import problems, schemes
from sepv.simulate import truncate

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
    """A run of `sepv.ensemble` with given increments (N, m, M)."""
    return lambda: sepv.ensemble(EP, problem, h=h, steps=len(dW), dW=dW, engine="compiled")


def drawn(problem: sepv.Problem, h: float) -> Callable[[], Any]:
    """A complete run of `sepv.ensemble`, which draws the increments itself."""
    return lambda: sepv.ensemble(EP, problem, h=h, steps=STEPS, paths=PATHS, engine="compiled")


def paired(
    jobs: list[tuple[str, Callable[[], Any], float]], bases: list[int], rounds: int
) -> list[list[str]]:
    """Rows (name, ns per path and step, ratio to the job `bases` names) with medians and quartiles.
    The jobs run in turn.
    """
    times = np.empty((rounds, len(jobs)))
    for _, job, _ in jobs:
        job()
    for r in over(range(rounds), lambda n: f"round {n + 1} of {rounds}"):
        for j, (_, job, size) in enumerate(jobs):
            begun = time.thread_time()
            job()
            times[r, j] = (time.thread_time() - begun) / size * 1e9
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
    show(f"{PATHS} paths, one core, CPU time", paired(jobs, bases, rounds), notes)


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
    show(f"one path of {ONE} steps, CPU time", paired(jobs, [0] * len(jobs), rounds),
         {len(jobs) - 2: f"{job().energy_defect.max():.1e}"})  # fmt: skip


def main() -> None:
    """Print the tables."""
    options = arguments(__doc__, rounds=15)
    rng = np.random.default_rng(0)
    # The increments are truncated beforehand, as the scheme requires, because the C kernels do not
    # truncate.
    dW = truncate(np.sqrt(H) * rng.standard_normal((STEPS, 1, PATHS)), H)
    single = truncate(np.sqrt(H) * rng.standard_normal((ONE, 1, 1)), H)
    library = compile_limit()
    limit = None if library is None else Limit(library, dW, single)
    if limit is None:
        print("no C compiler: ratios are to the engine's own first row")
    many_paths(limit, dW, options.rounds)
    one_path(limit, single, options.rounds)


if __name__ == "__main__":
    start(main)
