"""Ensembles of paths: `ensemble` runs them in NumPy or in compiled code, on threads,
processes or a cluster.
"""

from __future__ import annotations

import hashlib
import math
import platform
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from importlib import metadata
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from sepv._arguments import floats, require_flag, require_whole
from sepv._version import __version__
from sepv.errors import ChunkFailure, Interrupted, UsageError, require_one_of
from sepv.problem import Problem
from sepv.schemes import PointLaw, Scheme, Step, point_law
from sepv.simulate._batch import CHUNK, Ensemble
from sepv.simulate._ensembles.collectors import InMemory, OnDisk, Reduced, Reducing, Total, run
from sepv.simulate._ensembles.task import Task, portable
from sepv.simulate._results.code_hash import code_of
from sepv.simulate._results.reductions import Functionals, validate
from sepv.simulate._run_arguments import checked, require_drawable
from sepv.simulate.targets._target import CannotCompile, Target
from sepv.simulate.targets.registry import AUTOMATIC, TARGETS
from sepv.workers import check, run_all

# States from which steps are compared when a store is continued.
DRAWN_STATES = 32


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
    truncation: int | Literal["own"] | None = "own",
    increments: str | PointLaw | None = None,
    refine: int | None = None,
    dW: ArrayLike | None = None,
    times: ArrayLike | None = None,
    compensated: bool = False,
    engine: str = "auto",
    workers: Any = 1,
    chunk: int | None = None,
    store: Any = None,
    reduce: Functionals | None = None,
    until: Mapping[str, float] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Ensemble:
    """Run many paths to T. Memory grows only with the number of paths;
    with `store` or `reduce` it is constant.

    Path number p has the same Wiener increments for any number of paths, any workers and both
    engines, and is the same Wiener path for every h = T/(n·2^l) with the same odd n. The bits of
    its states depend on the engine, not workers.

    Parameters
    ----------
    scheme, problem, h, T, steps, y0, truncation
        As for `sepv.integrate`.
    paths : int; optional if `dW` is given.
    seed : int
        The seed of the increments.
    increments : "normal", "two-point", "three-point" or PointLaw, optional
        The distribution of the increments; by default the one that the scheme declares. A PointLaw
        replaces each normal increment by the law's quantile at the same probability. `Ensemble.W`
        is always the sum of the normal increments.
    refine : int, optional
        See `sepv.simulate.increments`.
    dW : (N, m, M), optional
        Untruncated Wiener increments for N steps, m noises and M paths, instead of drawn ones.
    times : (K,), optional
        Increasing multiples of h, from 0, at which states are kept in `Ensemble.states`, (d, K, M).
        By default only `Ensemble.y` is kept.
    compensated : bool
        Use Kahan's summation for y + increment: the rounding error of this sum is carried to the
        next step. If the error were lost, it would cause the larger part of the random walk of an
        invariant.
    engine : "auto", "numpy", "compiled" or "cuda"
        "auto" means the compiled engine (extra `fast`) if it can compile the scheme and the
        problem. `Ensemble.engine` names the engine used; `Ensemble.reason` says why it was not the
        compiled one. The engines agree to a few ulp, except if a step has no solution near its
        start. Newton's iteration is then chaotic: a path may fail with one engine and go on with
        the other, as 6 of 3000 paths of (2.1) did for Lotka-Volterra at h = 2⁻³. "cuda" runs the
        chunks on a card (extra `cuda`); "cuda-on-host" runs its code on the processor, for tests.
    workers : int, executor, map-like callable, Dask client or its address
        An int is a number of threads (compiled engine) or processes (NumPy). An executor, a
        map-like callable or a Dask client sends chunks to other processes or machines
        (docs/clusters.md). A chunk that a broken worker did not finish is computed by another
        worker or in this process.
    chunk : int, optional
        The number of paths that a worker computes at a time. It changes no path, only the last
        digits of `reduced`.
    store : path, optional
        A Zarr group on disk (extra `store`) for the ends of the paths. The arrays of the result are
        then zarr arrays, read from disk when they are indexed. Complete chunks found in the group
        are not computed again.
    reduce : dict of callables, optional
        Functionals by name. Each is called with the `Ensemble` of a chunk, and returns one number
        for each path in it. `Ensemble.reduced` has the moments and quantiles of the numbers.
        Without `store`, no path is kept.
    until : dict of float, optional
        Target standard errors of the means of functionals, by name. The run stops after the first
        chunk (in the order of chunks) with which all targets are reached.
    progress : callable (paths done, paths), optional

    Returns
    -------
    Ensemble
        States y (d, M) at T, W (m, M), the status of each path, the largest defects of H and of
        Casimirs, the work.

    Raises
    ------
    SchemeFault, TargetError
        SchemeFault if the scheme returns no state. TargetError if `scheme` is no scheme or
        `problem` is no problem.
    UsageError
        For invalid arguments, and for an engine that cannot run the scheme or the problem, or lacks
        a card. A path that fails raises nothing: see `Ensemble.status`.
    ChunkFailure
        If a chunk raises on its worker and again in this process, or if a cluster is gone. The
        exception carries the ends of all finished paths.
    Interrupted
        After Ctrl-C: a KeyboardInterrupt that carries the ends of all finished paths.

    Examples
    --------
    >>> import sepv
    >>> ends = sepv.ensemble("midpoint", "pendulum", h=2.0**-6, T=1.0, paths=100)
    >>> ends.y.shape, float(ends.energy_defect.max()) < 0.1
    ((2, 100), True)
    """
    require_flag("compensated", compensated)
    asked = checked(scheme, problem, h, T, steps, y0, truncation, increments)
    scheme, problem, start, count, k = asked
    raw, paths = _increments(dW, count, problem, paths)
    require_drawable(asked, h, seed, range(paths), refine)
    check(workers)
    target, reason = choose(engine, scheme, problem, compensated, paths, here=isinstance(workers, int))
    whole = Task(
        scheme=scheme, problem=problem, y0=start, h=float(h), steps=count, first=0, count=paths, seed=int(seed),
        refine=refine, truncation=k, stops=_stops(times, h, count), compensated=compensated, engine=target.name, dW=raw,
    )  # fmt: skip
    if reduce is not None or until is not None:
        validate(reduce, until)
    fixed = store is not None or reduce is not None
    if chunk is None:
        size = target.size(whole, workers, fixed)
    else:
        size = require_whole("chunk", chunk, "paths of one worker at a time")
    empty = _empty(whole, problem, reason, _about(whole, problem, raw))
    total: Total
    function: Any = run if reduce is None else Reducing(dict(reduce), keep=store is not None)
    if store is not None:
        empty = replace(empty, about={**empty.about, **_made_by(whole, problem)})
        total = OnDisk(whole, empty, progress, store, size, reduce, until)
    elif reduce is not None:
        total = Reduced(whole, empty, progress, reduce, until)
    else:
        total = InMemory(whole, empty, progress)
    # True if chunks may leave this process, so that their data must travel.
    far = not isinstance(workers, int) or (not target.threads and workers > 1)
    if isinstance(total, InMemory) and not far and size < paths:
        function = total.fill
    numbers = total.missing(range(-(-paths // size)))
    tasks = _Chunks(whole, size, numbers, far)
    try:
        repeated = run_all(
            function, tasks, workers, threads=target.threads, alike=target.packages,
            receive=lambda i, result: total.take(numbers[i], tasks[i], result),
            bounded=fixed,
        )  # fmt: skip
    except KeyboardInterrupt as error:
        raise Interrupted(total.finished()) from error
    except UsageError:
        raise
    except Exception as error:
        raise ChunkFailure(error, total.finished()) from error
    return replace(total.result(), repeated=repeated) if repeated else total.result()


def _increments(
    dW: ArrayLike | None, steps: int, problem: Problem, paths: int | None
) -> tuple[np.ndarray | None, int]:
    raw = None
    if dW is not None:
        raw = np.ascontiguousarray(dW, dtype=np.float64)
        paths = raw.shape[2] if raw.ndim == 3 and paths is None else paths
        # The extrema are finite if and only if all numbers are, and computing them needs no
        # temporary array.
        finite = raw.size == 0 or (np.isfinite(raw.min()) and np.isfinite(raw.max()))
        if raw.shape != (steps, problem.noises, paths) or not finite:
            where = ""
            if not finite:
                index = tuple(int(i) for i in np.argwhere(~np.isfinite(raw))[0])
                where = f", dW[{', '.join(map(str, index))}] = {float(raw[index])!r}"
            raise UsageError(
                expected=f"dW finite, of shape ({steps}, {problem.noises}, M): steps, noises, paths",
                received=f"shape {raw.shape}{where}",
                remedy="one increment for each step, noise and path",
            )
    return raw, require_whole("paths", paths, "give a whole number of paths, such as paths=1000")


def _stops(times: ArrayLike | None, h: float, steps: int) -> tuple[int, ...]:
    if times is None:
        return ()
    asked = np.atleast_1d(floats("times", times))
    with np.errstate(invalid="ignore", over="ignore"):
        stops = np.rint(asked / h)
        fits = np.abs(stops * h - asked) <= 1e-12 * np.abs(asked)
    if asked.ndim != 1 or not np.all(fits & (stops >= 0) & (stops <= steps)) or np.any(np.diff(stops) <= 0):
        raise UsageError(
            expected=f"times: increasing multiples of h = {h!r}, from 0 to T = {steps * h!r}",
            received=f"{times!r:.120}",
            remedy="choose times n·h",
        )
    return tuple(int(n) for n in stops)


def choose(
    engine: str,
    scheme: Scheme,
    problem: Problem,
    compensated: bool,
    paths: int = 2 * CHUNK,
    here: bool = True,
) -> tuple[Target, str]:
    """The target that runs the scheme for the problem,
    and the reason if another target was tried before.

    With here=False its chunks run on other machines. Raise UsageError for an unknown engine, for an
    engine that cannot run the scheme or the problem, and if this machine lacks what the engine
    needs.
    """
    require_one_of("engine", engine, ("auto", *TARGETS), "take auto")
    reason = "engine='numpy'" if engine == "numpy" else ""
    for name in AUTOMATIC if engine == "auto" else (engine,):
        try:
            TARGETS[name].prepare(scheme, problem, paths, compensated, here)
            return TARGETS[name], reason
        except CannotCompile as error:
            reason = str(error)
    raise UsageError(
        expected=f"a scheme and a problem that engine={engine!r} takes",
        received=reason,
        remedy="engine='auto' falls back to NumPy; problems given as data are compiled",
    )


class _Chunks(Sequence[Task]):
    """The tasks of an ensemble, one for each chunk; made on demand,
    because there may be a hundred thousand.
    """

    def __init__(self, whole: Task, size: int, numbers: Sequence[int], far: bool) -> None:
        self.whole, self.size, self.numbers, self.far = whole, size, numbers, far
        self.problem = portable(whole.problem) if far else whole.problem  # type: ignore[arg-type]

    def __len__(self) -> int:
        return len(self.numbers)

    def __getitem__(self, index: Any) -> Any:
        whole, first = self.whole, self.numbers[index] * self.size
        if self.size >= whole.count and not self.far:
            return whole
        count = min(self.size, whole.count - first)
        dW, place = whole.dW, first
        if dW is not None and self.far:
            dW, place = np.ascontiguousarray(dW[:, :, first : first + count]), 0
        return replace(whole, problem=self.problem, first=first, count=count, dW=dW, place=place)


def _empty(whole: Task, problem: Problem, reason: str, about: dict[str, Any]) -> Ensemble:
    """An ensemble of no paths: its arrays show the shapes and dtypes of the real ones."""
    d, m, K = problem.dimension, problem.noises, len(whole.stops)
    none, integers = np.empty(0), np.empty(0, dtype=np.int64)
    return Ensemble(
        y=np.empty((d, 0)), W=np.empty((m, 0)), status=integers, failed_step=integers, energy_defect=none,
        casimir_defect=none, gradient_evaluations=0, structure_evaluations=0, iterations=0,
        times=np.array(whole.stops, dtype=np.float64) * whole.h, states=np.empty((d, K, 0)), problem=problem,
        engine=whole.engine, reason=reason, about=about,
    )  # fmt: skip


def _about(whole: Task, problem: Problem, dW: Any) -> dict[str, Any]:
    """Describe the paths as JSON: equal descriptions mean equal paths.

    A fingerprint (a hash of values) stands for the problem and the scheme. If the engine compiles
    both, they are immutable records, and their fingerprint is cached.
    """
    known = (whole.scheme, problem, whole.y0.tobytes(), whole.h)
    try:
        fingerprint = (_kept_fingerprint if TARGETS[whole.engine].recorded else _fingerprint)(*known)
    except TypeError:  # a scheme without a hash cannot be cached
        fingerprint = _fingerprint(*known)
    law = point_law(whole.scheme.increments)
    return {
        "sepv_version": __version__,
        "problem": problem.name,
        "scheme": whole.scheme.name,
        "fingerprint": fingerprint,
        "h": whole.h,
        "steps": whole.steps,
        "T": whole.h * whole.steps,
        "seed": "given increments" if dW is not None else whole.seed,
        "increments": (
            "drawn" if dW is None else hashlib.sha256(np.ascontiguousarray(dW).data).hexdigest()[:16]
        )
        + ("" if law is None else f", {law}"),
        "refine": "as far as it goes" if whole.refine is None else whole.refine,
        "truncation": "none" if whole.truncation is None else whole.truncation,
        "compensated": whole.compensated,
        "engine": whole.engine,
        "y0": [float(v) for v in whole.y0],
        "noise": [float(c) for c in problem.c],
        "stops": list(whole.stops),
    }


def _made_by(whole: Task, problem: Problem) -> dict[str, Any]:
    """Describe what computes the paths of a store, as JSON: steps from drawn states,
    hashes of code, versions.
    """
    y0, rng = whole.y0, np.random.default_rng(20140203)
    starts = y0[:, None] + (1 + np.abs(y0))[:, None] * rng.standard_normal((len(y0), DRAWN_STATES))
    steps = [_fingerprint(whole.scheme, problem, y.tobytes(), whole.h) for y in starts.T]
    packages = TARGETS[whole.engine].packages
    return {
        "steps from drawn states": hashlib.sha256("".join(steps).encode()).hexdigest()[:16],
        "code": code_of(whole.scheme, problem),
        "versions": {key: metadata.version(key) for key in packages} | {"python": platform.python_version()},
    }


def _fingerprint(scheme: Scheme, problem: Problem, start: bytes, h: float) -> str:
    """Hash the problem's values at a state and one step of the scheme,
    because functions cannot be compared.
    """
    y0 = np.frombuffer(start).copy()
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        values = []
        for part in (problem.hamiltonian, problem.gradient, problem.structure):
            values.append(_value(lambda part=part: part(y0.copy())))  # type: ignore[misc]
        increment = np.full(problem.noises, 0.25 * math.sqrt(h))
        values.append(_value(lambda: scheme.step(problem, y0.copy(), h, increment)))
    bits = b"".join(np.ascontiguousarray(value).tobytes() for value in values)
    return hashlib.sha256(bits).hexdigest()[:16]


def _value(function: Callable[[], Any]) -> Any:
    """The value of a function, or the name of its exception:
    a refused step is part of a scheme's behaviour too.
    """
    try:
        return function()
    except Exception as error:
        return np.frombuffer(type(error).__name__.encode(), dtype=np.uint8)


_kept_fingerprint = lru_cache(maxsize=256)(_fingerprint)
