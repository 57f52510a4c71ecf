"""Ensembles of paths: one call for the NumPy batch and for the compiled engine, on any workers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sepv import wiener
from sepv.arguments import require_flag
from sepv.candidate import ask_once
from sepv.engine.compile import FEW, LANES, CannotCompile, kernel
from sepv.engine.task import Task, portable, run
from sepv.engine.workers import run_all
from sepv.errors import ChunkFailure, UsageError
from sepv.problem import Problem
from sepv.scheme import Scheme, Step
from sepv.simulation import CHUNK, Ensemble, chosen_truncation, initial_state, step_count
from sepv.target import load_problem, load_scheme

ENGINES = ("auto", "numpy", "compiled")
# Chunks for each worker, so that one that is slower than the others does not keep them waiting.
SHARES = 4


def ensemble(
    scheme: str | Scheme | Step,
    problem: str | Problem,
    *,
    h: float,
    T: float | None = None,
    steps: int | None = None,
    paths: int | None = None,
    seed: int = 0,
    y0: ArrayLike | None = None,
    truncation: int | None = -1,
    refine: int | None = None,
    dW: ArrayLike | None = None,
    times: ArrayLike | None = None,
    compensated: bool = False,
    engine: str = "auto",
    workers: Any = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Ensemble:
    """The ends of `paths` paths; memory grows with the number of paths alone.

    Path number p is the same for any number of paths, for every h = T/(n·2^l) with the same odd n, for both engines,
    and, with one engine to the bit, for any workers.

    Parameters
    ----------
    scheme : str, Scheme or function
        As for `sepv.verify`: a built-in name, ``module:attribute``, a `Scheme`, or ``step(problem, y, h, dW)``.
    problem : str or Problem
        A built-in name, ``module:attribute``, a ``.json`` file of polynomial data, or a `Problem`.
    h : float > 0
    T, steps : one of them; T must be a multiple of h.
    paths : int, optional with dW.
    seed : int
        Of the increments.
    y0 : (d,), optional
        By default the problem's initial state.
    truncation : int or None
        k of Remark 2.1; by default the scheme's own. None for untruncated.
    refine : int, optional
        See `sepv.wiener.increments`.
    dW : (N, m, M), optional
        Untruncated increments to use instead of drawn ones.
    times : (K,), optional
        Increasing multiples of h at which the states are kept: `Ensemble.states`. Nothing is stored without.
    compensated : bool
        Kahan's summation of y + increment over the steps: the rounding of the update, the larger part of an
        invariant's random walk, is then carried along and not lost.
    engine : "auto", "numpy" or "compiled"
        "auto" takes the compiled engine (extra `fast`) where it takes the scheme and the problem;
        `Ensemble.engine` says which it was and `Ensemble.reason` why it was not the compiled one.
    workers : int, executor or map-like callable
        With an int that many threads (compiled engine) or processes (NumPy). An executor's `map`, of a process
        pool or of a cluster, sends chunks elsewhere; what a broken worker did not finish is computed here.
    progress : callable (paths done, paths), optional

    Returns
    -------
    Ensemble
        y (d, M) at T, W (m, M), the status of each path, the largest defects of H and the Casimirs, the work.

    Raises
    ------
    SchemeFault, TargetError
        For an answer of the scheme that is no state, for what is no scheme or no problem.
    UsageError
        For arguments that make no ensemble, and for engine="compiled" where there is none for the scheme or
        the problem. A failing path raises nothing: see `Ensemble.status`. Beyond the fold of the solutions the
        NumPy engine may still solve a step that the compiled one refuses: it approaches once more, damped.
    ChunkFailure
        Where a chunk raises here as well; it carries the ends of all paths that are finished.

    Examples
    --------
    >>> ends = sepv.ensemble("midpoint", "pendulum", h=2.0**-6, T=1.0, paths=100)
    >>> ends.y.shape, float(ends.energy_defect.max()) < 0.1
    ((2, 100), True)
    """
    problem = load_problem(problem)
    scheme = load_scheme(scheme, problems=(problem,))
    require_flag("compensated", compensated)
    count = step_count(h, T, steps)
    raw, paths = _increments(dW, count, problem, paths)
    start = initial_state(problem, y0)
    k = chosen_truncation(scheme, truncation)
    if k is not None:
        wiener.truncate(np.zeros(1), h, k)  # refuses h and k that Remark 2.1 does not cover
    wiener.validate(seed, h * count, count, problem.noises, range(paths))
    wiener.grid(count, refine)
    ask_once(scheme, problem, start, float(h))
    compiled, reason = choose(engine, scheme, problem, compensated, LANES if paths > FEW else 1)
    whole = Task(
        scheme=scheme, problem=problem, y0=start, h=float(h), steps=count, first=0, count=paths, seed=int(seed),
        refine=refine, truncation=k, stops=_stops(times, h, count), compensated=compensated, compiled=compiled, dW=raw,
    )  # fmt: skip
    total = _total(whole, problem, reason, progress)
    tasks = _chunks(whole, workers)
    try:
        repeated = run_all(
            run, tasks, workers, threads=compiled, receive=lambda i, e: total.take(tasks[i], e)
        )
    except (UsageError, KeyboardInterrupt):
        raise
    except Exception as error:
        raise ChunkFailure(error, total.finished()) from error
    return replace(total.ensemble, repeated=repeated)


def _increments(
    dW: ArrayLike | None, steps: int, problem: Problem, paths: int | None
) -> tuple[np.ndarray | None, int]:
    raw = None
    if dW is not None:
        raw = np.ascontiguousarray(dW, dtype=np.float64)
        paths = raw.shape[2] if raw.ndim == 3 and paths is None else paths
        # The extrema are finite where all are, and take no temporary.
        finite = raw.size == 0 or (np.isfinite(raw.min()) and np.isfinite(raw.max()))
        if raw.shape != (steps, problem.noises, paths) or not finite:
            raise UsageError(
                expected=f"dW finite, of shape ({steps}, {problem.noises}, M): steps, noises, paths",
                received=f"shape {raw.shape}" + ("" if finite else f", {_first_not_finite(raw)}"),
                remedy="one increment for each step, noise and path",
            )
    if not isinstance(paths, (int, np.integer)) or isinstance(paths, bool) or paths < 1:
        raise UsageError(expected="paths, an integer ≥ 1", received=repr(paths), remedy="ask for a path")
    return raw, int(paths)


def _first_not_finite(raw: np.ndarray) -> str:
    index = tuple(int(i) for i in np.argwhere(~np.isfinite(raw))[0])
    return f"dW[{', '.join(map(str, index))}] = {float(raw[index])!r}"


def _stops(times: ArrayLike | None, h: float, steps: int) -> tuple[int, ...]:
    if times is None:
        return ()
    asked = np.atleast_1d(np.asarray(times, dtype=np.float64))
    with np.errstate(invalid="ignore", over="ignore"):
        stops = np.rint(asked / h)
        fits = np.abs(stops * h - asked) <= 1e-12 * np.abs(asked)
    if asked.ndim != 1 or not np.all(fits & (stops >= 1) & (stops <= steps)) or np.any(np.diff(stops) <= 0):
        raise UsageError(
            expected=f"times: increasing multiples of h = {h!r}, from h to T = {steps * h!r}",
            received=f"{times!r:.120}",
            remedy="choose times n·h; the state at 0 is y0",
        )
    return tuple(int(n) for n in stops)


def choose(
    engine: str, scheme: Scheme, problem: Problem, compensated: bool, lanes: int = LANES
) -> tuple[bool, str]:
    """Whether the compiled engine takes this, and why not.

    Raises
    ------
    UsageError
        For an unknown engine, and where it must be the compiled one and cannot.
    """
    if engine not in ENGINES:
        raise UsageError(
            expected=f"engine, one of {', '.join(ENGINES)}", received=repr(engine), remedy="take auto"
        )
    if engine == "numpy":
        return False, "engine='numpy'"
    try:
        kernel(scheme, problem, lanes=lanes, compensated=compensated)
    except CannotCompile as error:
        if engine == "compiled":
            raise UsageError(
                expected="a scheme and a problem that the compiled engine takes",
                received=str(error),
                remedy="engine='auto' falls back to NumPy; problems given as data are compiled",
            ) from error
        return False, str(error)
    return True, ""


def _chunks(whole: Task, workers: Any) -> list[Task]:
    size = CHUNK
    if whole.compiled and isinstance(workers, int):
        shares = SHARES * workers if workers > 1 else 1
        share = -(-whole.count // (shares * LANES)) * LANES
        size = min(max(share, LANES), (4 if workers > 1 else 8) * CHUNK)
    tasks = []
    near = isinstance(workers, int) and (whole.compiled or workers == 1)
    problem = whole.problem if near else portable(whole.problem)  # type: ignore[arg-type]
    for first in range(0, whole.count, size):
        count = min(size, whole.count - first)
        dW, place = whole.dW, first
        if dW is not None and not near:
            dW, place = np.ascontiguousarray(dW[:, :, first : first + count]), 0
        tasks.append(replace(whole, problem=problem, first=first, count=count, dW=dW, place=place))
    return tasks


def _total(task: Task, problem: Problem, reason: str, progress: Any) -> _Total:
    try:
        return _Total(task, problem, reason, progress)
    except MemoryError as error:
        raise UsageError(
            expected="paths whose ends fit into memory",
            received=f"{task.count} paths with {len(task.stops)} kept states: {error}",
            remedy="fewer paths at a time, or fewer times; `seed` and the number of a path name its increments",
        ) from error


class _Total:
    """The ensemble being filled, chunk by chunk, in place."""

    def __init__(self, task: Task, problem: Problem, reason: str, progress: Any) -> None:
        d, m, M = problem.dimension, problem.noises, task.count
        self.ensemble = Ensemble(
            y=np.empty((d, M)), W=np.empty((m, M)), status=np.empty(M, dtype=np.int64),
            failed_step=np.empty(M, dtype=np.int64), energy_defect=np.empty(M), casimir_defect=np.empty(M),
            gradient_evaluations=0, structure_evaluations=0, iterations=0,
            times=np.array(task.stops, dtype=np.float64) * task.h, states=np.empty((len(task.stops), d, M)),
            engine="compiled" if task.compiled else "numpy", reason=reason,
        )  # fmt: skip
        self.done = np.zeros(M, dtype=bool)
        self.progress = progress

    def take(self, task: Task, chunk: Ensemble) -> None:
        """A chunk's ends go to their places; where it is the whole, they are the ends."""
        whole, here = self.ensemble, slice(task.first, task.first + task.count)
        if task.count == self.done.size:
            self.ensemble = replace(chunk, times=whole.times, engine=whole.engine, reason=whole.reason)
        else:
            for key in ("y", "W", "status", "failed_step", "energy_defect", "casimir_defect", "states"):
                getattr(whole, key)[..., here] = getattr(chunk, key)
            work = (
                "gradient_evaluations",
                "structure_evaluations",
                "iterations",
                "divisions",
                "continuations",
            )
            self.ensemble = replace(whole, **{key: getattr(whole, key) + getattr(chunk, key) for key in work})
        self.done[here] = True
        if self.progress is not None:
            self.progress(int(self.done.sum()), self.done.size)

    def finished(self) -> tuple[np.ndarray, Ensemble]:
        """The numbers of the finished paths and their ends."""
        keys = ("y", "W", "status", "failed_step", "energy_defect", "casimir_defect", "states")
        return np.flatnonzero(self.done), replace(
            self.ensemble, **{key: getattr(self.ensemble, key)[..., self.done] for key in keys}
        )
