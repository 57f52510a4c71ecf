"""Run the methods of a comparison on the same paths in turn,
so that a slow minute of the machine slows all methods.
"""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from time import get_clock_info, perf_counter, process_time
from typing import Any, NamedTuple

import numpy as np

from sepv.core.newton import Status
from sepv.errors import SepvError, TargetError, UsageError
from sepv.exact import clipping_error, exact_flow
from sepv.law import quiet_problem
from sepv.problem import Array, Problem
from sepv.simulate import step_count, wiener
from sepv.statistics import JACKKNIFE_GROUPS, Estimate, jackknife
from sepv.studies._compare.comparison import Comparison
from sepv.studies._compare.method import Followed, Method, MethodEnds
from sepv.studies._compare.record import Point, Seconds
from sepv.workers import run_all

# The error probability of the two-sided interval of each point.
POINT_ALPHA = 0.05
# The number of paths for drivers that go path by path: at about 10 µs per step, all paths would
# take hours.
PATH_BY_PATH_PATHS = 64
# A job of fewer seconds is repeated within one measurement of time.
SHORTEST_JOB_SECONDS = 2e-3
# A clock of the processor that has not ticked has counted less than this.
TICK_SECONDS = get_clock_info("process_time").resolution

# A function of the name of the current work and the fraction of the whole work that is done, 0
# to 1.
MethodProgress = Callable[[str, float], None]


def compare(
    methods: Sequence[Method],
    problem: Problem,
    *,
    steps: Sequence[int],
    T: float = 1.0,
    paths: int | None = None,
    repeats: int = 5,
    seed: int = 0,
    targets: Sequence[float] = (),
    workers: Any = 1,
    progress: MethodProgress = lambda *_: None,
) -> Comparison:
    """Measure errors (strong and weak), invariant defects,
    time and work of each method for each number of steps.

    If one of the methods is for problems without noise only, all methods run without noise, c = ().

    Parameters
    ----------
    steps : numbers of steps up to T, increasing; each must divide the last
    paths : int ≥ 32, optional
        1000 by default; methods that compute one path at a time take the first 64. Without noise
        all paths are equal: `paths` is then 1 by default, and a larger number only makes the timed
        batch larger.
    repeats : int ≥ 1
        The number of timed rounds; in each round every method runs once at every step size, in a
        rotating order.
    targets : strong errors
        For each of these errors, `Comparison.times_to_error` gives the time in which each method
        reaches it.
    progress : callable (text, share), optional
        Called before each piece of work with its name and the fraction of the whole work that is
        done, 0 to 1.
    workers : int, executor, map-like callable, Dask client or its address
        The workers (an int: threads) that compute errors and defects. Times are always measured in
        this process.

    Raises
    ------
    UsageError
        For invalid arguments.
    """
    if any(m.deterministic for m in methods):
        problem = quiet_problem(problem)
    if paths is None:
        paths = 1000 if problem.noises else 1
    _validate(methods, problem, steps, paths, repeats, targets)
    for count in steps:
        step_count(T / count, None, count)
    start = np.array(problem.initial, dtype=np.float64)
    fine = wiener.increments(seed, T=T, steps=steps[-1], noises=problem.noises, paths=paths)
    exact = exact_flow(problem, problem.random_step(T, fine.sum(axis=0)))
    coarse = {count: wiener.coarsen(fine, steps[-1] // count) for count in steps}
    # Pieces of work: for each method and step size the first call (which may compile), the errors,
    # the timed rounds.
    pieces, done = (2 + repeats) * sum(len(steps) if m.steps_matter else 1 for m in methods), 0

    def begin(text: str) -> None:
        nonlocal done
        progress(text, done / pieces)
        done += 1

    cells, failed = _prepared(methods, problem, start, T, coarse, begin)
    followed: list[Followed | str] = [""] * len(cells)

    def take(number: int, run: Followed | str) -> None:
        followed[number] = run
        begin(f"errors of {cells[number].method.name}, {cells[number].steps} steps")

    run_all(_follow, [cell.watched for cell in cells], workers, threads=True, receive=take)
    runs = list(zip(cells, followed, strict=True))
    failed |= {cell.method.name: run for cell, run in runs if isinstance(run, str)}
    there = [(c, run) for c, run in runs if c.method.name not in failed and not isinstance(run, str)]
    if not there:
        raise TargetError(
            expected="a method that takes its steps",
            received="; ".join(f"{name}: {text.splitlines()[0]}" for name, text in failed.items()),
            remedy="make one of them run on this problem first",
        )
    times = _alternate([cell.job for cell, _ in there], repeats, progress, done / pieces)
    points = [
        _point(cell, run, problem, T, exact.y, np.array(row))
        for (cell, run), row in zip(there, times, strict=True)
    ]
    return Comparison(
        problem=problem.name,
        T=T,
        seed=seed,
        repeats=repeats,
        confidence=1 - POINT_ALPHA,
        environment=environment(),
        sources={m.name: m.source for m in methods if m.name not in failed},
        looks={m.name: m.look for m in methods if m.look is not None and m.name not in failed},
        called_each_step=tuple(m.name for m in methods if m.called_each_step and m.name not in failed),
        failed=failed,
        deterministic=not problem.noises,
        has_casimirs=bool(problem.casimirs or problem.linear_casimirs),
        points=tuple(points),
        targets=tuple(targets),
    )


class _Cell(NamedTuple):
    """One pair of a method and a number of steps, to be measured.

    job : runs all paths, to be timed
    first : processor seconds of the first call of the job
    watched : the method's `follow` and its arguments, for a further, untimed run that measures
        defects
    """

    method: Method
    steps: int
    job: Callable[[], MethodEnds]
    first: float
    watched: tuple[Any, ...]


def _prepared(
    methods: Sequence[Method], problem: Problem, start: Array, T: float, coarse: dict[int, Array],
    begin: Callable[[str], None],
) -> tuple[list[_Cell], dict[str, str]]:  # fmt: skip
    """Run each method once with each number of steps; return the cells of methods without an error,
    and the errors.
    """
    cells: list[_Cell] = []
    failed: dict[str, str] = {}
    for method in methods:
        of_method: list[_Cell] = []
        try:
            for count in list(coarse) if method.steps_matter else [max(coarse)]:
                begin(f"{method.name}, {count} steps")
                dW = coarse[count] if method.batched else coarse[count][:, :, :PATH_BY_PATH_PATHS]
                job = method.prepare(problem, start, T / count, dW)
                watched = (method.follow, problem, start, T / count, dW)
                of_method.append(_Cell(method, count, job, _time(job)[0], watched))
        except SepvError as error:  # only this method fails: the others are still compared
            failed[method.name] = str(error)
            continue
        cells += of_method
    return cells, failed


def _follow(watched: tuple[Any, ...]) -> Followed | str:
    """Run `follow` as `_Cell.watched` says; return its results,
    or the message if the method raises an error.
    """
    follow, *arguments = watched
    try:
        followed: Followed = follow(*arguments)
        return followed
    except SepvError as error:
        return str(error)


def _alternate(
    jobs: Sequence[Callable[[], MethodEnds]], repeats: int, progress: MethodProgress, begin: float
) -> list[list[tuple[float, float]]]:
    """Measure (processor seconds, clock seconds) of each job in each of `repeats` rounds.

    Rounds begin with different jobs. `begin` is the fraction of the whole comparison that is
    already done; `progress` goes on from this fraction.
    """
    inner = [max(1, int(SHORTEST_JOB_SECONDS / max(_time(job)[1], 1e-9))) for job in jobs]
    times: list[list[tuple[float, float]]] = [[] for _ in jobs]
    for round_ in range(repeats):
        offset = round_ * len(jobs) // repeats
        for k in range(len(jobs)):
            n = (k + offset) % len(jobs)
            share = (round_ + k / len(jobs)) / repeats
            text = f"timing, round {round_ + 1} of {repeats}: {k + 1} of {len(jobs)}"
            progress(text, begin + (1 - begin) * share)
            times[n].append(_time(jobs[n], inner[n]))
    return times


def _time(job: Callable[[], MethodEnds], inner: int = 1) -> tuple[float, float]:
    begin = process_time(), perf_counter()
    for _ in range(inner):
        job()
    processor = max(process_time() - begin[0], TICK_SECONDS)
    return processor / inner, (perf_counter() - begin[1]) / inner


def _point(cell: _Cell, run: Followed, problem: Problem, T: float, exact: Array, seconds: Array) -> Point:
    method, count = cell.method, cell.steps
    paths = run.ends.y.shape[1]
    done = run.ends.status == Status.CONVERGED
    difference = run.ends.y[:, done] - exact[:, :paths][:, done]
    strong, weak = errors(difference) if problem.noises else _only(difference)
    if run.stated_error > strong.value:
        strong = weak = Estimate(run.stated_error, 0.0, POINT_ALPHA)
    processor, wall = seconds.T
    median, low, high = (float(np.quantile(processor, q)) for q in (0.5, 0.25, 0.75))
    cost = paths * (count if method.steps_matter else 1)
    work = run.work
    evaluations = {} if work is None else {k: n / cost for k, n in work.evaluations.items() if n}
    if method.evaluations is not None:
        evaluations = {"gradient": method.evaluations, "structure": method.evaluations}
    return Point(
        method=method.name,
        h=T / count if method.steps_matter else T,
        steps=count if method.steps_matter else 1,
        paths=paths,
        failures=int(np.count_nonzero(~done)),
        strong=strong,
        weak=weak,
        energy_defect=_largest(run.energy_defect[done]),
        casimir_defect=_largest(run.casimir_defect[done]),
        seconds=Seconds(median, low, high, float(np.median(wall)), cell.first - median),
        evaluations=evaluations,
        iterations=None if work is None or work.iterations is None else work.iterations / cost,
        steps_matter=method.steps_matter,
        clipping=clipping_error(problem, T=T, steps=count, k=method.truncation),
    )


def errors(difference: Array) -> tuple[Estimate, Estimate]:
    """The strong and the weak error from differences y_N − y(T) (d, M),
    with intervals by a jackknife over paths.
    """
    unbounded = Estimate(float("inf"), 0.0, POINT_ALPHA)
    if difference.shape[1] < JACKKNIFE_GROUPS:
        return unbounded, unbounded
    with np.errstate(over="ignore", invalid="ignore"):
        squared = np.sum(difference**2, axis=0, keepdims=True)
        if not np.all(np.isfinite(squared)) or not np.isfinite(np.mean(squared)):
            return unbounded, unbounded
        strong = jackknife(squared, lambda mean: float(np.sqrt(mean[0])), POINT_ALPHA)
        return strong, jackknife(difference, lambda mean: float(np.linalg.norm(mean)), POINT_ALPHA)


def _only(difference: Array) -> tuple[Estimate, Estimate]:
    """The error |y_N − y(T)| of the one path of a problem without noise,
    as its strong and its weak error.
    """
    size = float(np.linalg.norm(difference[:, 0])) if difference.size else float("inf")
    error = Estimate(size if np.isfinite(size) else float("inf"), 0.0, POINT_ALPHA)
    return error, error


def _largest(values: Array) -> float:
    return float(np.max(values)) if values.size and np.all(np.isfinite(values)) else float("inf")


def _validate(
    methods: Sequence[Method], problem: Problem, steps: Sequence[int], paths: int, repeats: int,
    targets: Sequence[float],
) -> None:  # fmt: skip
    if problem.initial is None:
        raise UsageError(
            expected="a problem with an initial state", received=f"{problem.name} without one",
            remedy="give initial= when making the problem",
        )  # fmt: skip
    grid = list(steps)
    if not grid or grid != sorted(set(grid)) or grid[0] < 1 or any(grid[-1] % n for n in grid):
        raise UsageError(
            expected="increasing numbers of steps ≥ 1, each dividing the last",
            received=f"{grid}",
            remedy="such as 8,16,32,64: all step sizes then see the same paths",
        )
    names, least = [m.name for m in methods], JACKKNIFE_GROUPS if problem.noises else 1
    for ok, expected, received in (
        (names and len(set(names)) == len(names), "methods with different names", names),
        (isinstance(paths, int) and paths >= least, f"paths (--paths), an integer ≥ {least}", paths),
        (isinstance(repeats, int) and repeats >= 1, "repeats, an integer ≥ 1", repeats),
        (all(0 < t < np.inf for t in targets), "errors to pay for, finite and > 0", list(targets)),
    ):
        if not ok:
            raise UsageError(expected=expected, received=repr(received), remedy=f"give {expected}")


@contextmanager
def one_core() -> Iterator[bool]:
    """Keep this process on one core within a `with` block,
    so that no library is faster because it uses two.

    The block is given True, or False if the operating system cannot do this.
    """
    if not hasattr(os, "sched_setaffinity"):
        yield False
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(cores)})
    try:
        yield True
    finally:
        os.sched_setaffinity(0, cores)


def environment() -> dict[str, str]:
    """The versions of Python, sepv and the loaded libraries, and the machine type of the
    processor.
    """
    import scipy

    from sepv._version import __version__

    versions = {"sepv": __version__, "python": platform.python_version(), "numpy": np.__version__}
    versions |= {"scipy": scipy.__version__, "machine": platform.machine()}
    for name in ("numba", "jax", "diffrax", "torch", "torchsde"):
        module = sys.modules.get(name)
        if module is not None:
            versions[name] = str(getattr(module, "__version__", "?"))
    return versions
