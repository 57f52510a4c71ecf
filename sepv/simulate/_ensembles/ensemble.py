"""Ensembles of paths: one call for the NumPy batch and for the compiled engine, on any workers."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from sepv._arguments import floats, require_flag, require_whole
from sepv._version import __version__
from sepv.errors import ChunkFailure, Interrupted, UsageError, require_one_of
from sepv.problem import Problem
from sepv.schemes import PointLaw, Scheme, Step, point_law
from sepv.simulate._batch import CHUNK, Ensemble
from sepv.simulate._compiled.compile import FEW, CannotCompile, kernel
from sepv.simulate._compiled.layout import LANES
from sepv.simulate._ensembles.collectors import InMemory, OnDisk, Reduced, Reducing, Total, run
from sepv.simulate._ensembles.task import Task, portable
from sepv.simulate._results.reductions import Functionals, validate
from sepv.simulate._run_arguments import checked, require_drawable
from sepv.workers import check, run_all
from sepv.workers import count as threads_of

ENGINES = ("auto", "numpy", "compiled")
# Chunks for each worker, so that a slow worker does not keep the others waiting.
SHARES = 4
# Path-steps of a chunk that is sent or stored: some tenths of a second, long beside a scheduler's millisecond.
PATH_STEPS = 2**24
# The most paths in such a chunk: the engine's arrays for them take some 20 MB.
LARGEST = 16 * CHUNK
# The most paths of a chunk whose ends are sent as a whole: some 80 MB for each thread.
FARTHEST = 4 * LARGEST


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
    """Run many paths to T; memory grows with the number of paths only, and with `store` or `reduce` not at all.

    Path number p is the same for any number of paths, for every h = T/(n·2^l) with the same odd n, for both engines,
    and, with one engine to the bit, for any workers.

    Parameters
    ----------
    scheme, problem, h, T, steps, y0, truncation
        As for `sepv.integrate`.
    paths : int, optional with dW.
    seed : int
        The seed of the increments.
    increments : "normal", "two-point", "three-point" or PointLaw, optional
        By default the scheme's own. Each is taken at the rank of the increment drawn or given
        (`sepv.simulate._truncation.seen`), so that a path number means the same stream whatever increments it
        takes; `Ensemble.W` stays that of the stream.
    refine : int, optional
        See `sepv.simulate.increments`.
    dW : (N, m, M), optional
        Untruncated increments to use instead of drawn ones.
    times : (K,), optional
        Increasing multiples of h at which the states are kept: `Ensemble.states`. Nothing is stored without.
    compensated : bool
        Kahan's summation of y + increment over the steps: the rounding of the update, the larger part of an
        invariant's random walk, is then carried along and not lost.
    engine : "auto", "numpy" or "compiled"
        "auto" takes the compiled engine (extra `fast`) where it takes the scheme and the problem;
        `Ensemble.engine` names the engine and `Ensemble.reason` says why it was not the compiled one.
        Both agree to a few ulp. Where a step has no solution near y0 Newton's iteration is chaotic, and a path
        may end with one engine and go on with the other: 6 of 3000 paths of (2.1) for Lotka-Volterra at h = 2⁻³.
    workers : int, executor, map-like callable, Dask client or its address
        With an int that many threads (compiled engine) or processes (NumPy). An executor, a map, or a
        `distributed.Client` sends chunks elsewhere (docs/clusters.md); what a broken worker did not finish is computed
        by another one, or here.
    chunk : int, optional
        Paths that one worker computes at a time. No path depends on it; the last digits of `reduced` do.
    store : path, optional
        A Zarr group on disk (extra `store`) for the ends, which are then zarr arrays, read where they are indexed.
        Chunks that it holds already are not computed again; those that were torn by a crash are.
    reduce : dict of callables, optional
        Functionals: each is given the `Ensemble` of a chunk and returns one number for each of its paths. Their
        moments and quantiles are in `Ensemble.reduced`; without `store` no path is kept.
    until : dict of float, optional
        Standard errors of functionals at which to stop before all paths are done: at the first chunk, in the order of
        chunks, after which each is reached by its mean.
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
        the problem. A failing path raises nothing: see `Ensemble.status`.
    ChunkFailure
        Where a chunk raises here as well, and where a cluster is gone; it carries the ends of all paths that are
        finished.
    Interrupted
        A KeyboardInterrupt (Ctrl-C) that carries them as well.

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
    compiled, reason = choose(engine, scheme, problem, compensated, LANES if paths > FEW else 1)
    whole = Task(
        scheme=scheme, problem=problem, y0=start, h=float(h), steps=count, first=0, count=paths, seed=int(seed),
        refine=refine, truncation=k, stops=_stops(times, h, count), compensated=compensated, compiled=compiled, dW=raw,
    )  # fmt: skip
    check(workers)
    if reduce is not None or until is not None:
        validate(reduce, until)
    size = _chunk_size(whole, workers, chunk, fixed=store is not None or reduce is not None)
    empty = _empty(whole, problem, reason, _about(whole, problem, raw))
    total: Total
    function: Any = run if reduce is None else Reducing(dict(reduce), keep=store is not None)
    if store is not None:
        total = OnDisk(whole, empty, progress, store, size, reduce, until)
    elif reduce is not None:
        total = Reduced(whole, empty, progress, reduce, until)
    else:
        total = InMemory(whole, empty, progress)
    # True if chunks may leave this process, so that their data must travel.
    far = not isinstance(workers, int) or (not compiled and workers > 1)
    numbers = total.missing(range(-(-paths // size)))
    tasks = _Chunks(whole, size, numbers, far)
    try:
        repeated = run_all(
            function, tasks, workers, threads=compiled, alike=("numpy", "numba") if compiled else ("numpy",),
            receive=lambda i, result: total.take(numbers[i], tasks[i], result),
            bounded=store is not None or reduce is not None,
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
        # The extrema are finite if all numbers are, and need no temporary.
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
    """Decide if the compiled engine runs this, with the reason if not.

    Raises UsageError for an unknown engine, and if the compiled one is required and impossible.
    """
    require_one_of("engine", engine, ENGINES, "take auto")
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


class _Chunks(Sequence[Task]):
    """The tasks of an ensemble, made on demand: there may be a hundred thousand."""

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


def _chunk_size(whole: Task, workers: Any, chunk: int | None, fixed: bool) -> int:
    """The number of paths in a chunk.

    Chunks on disk or reduced have the same size for any workers, so that reduced results have the same bits.
    """
    if chunk is not None:
        return require_whole("chunk", chunk, "paths of one worker at a time")
    if not whole.compiled:
        return CHUNK
    if isinstance(workers, int) and not fixed:
        shares = SHARES * workers if workers > 1 else 1
        share = -(-whole.count // (shares * LANES)) * LANES
        return min(max(share, LANES), (4 if workers > 1 else 8) * CHUNK)
    size = min(max(PATH_STEPS // whole.steps // LANES * LANES, LANES), LARGEST)
    if fixed:
        return size
    # A scheduler's work is the same for every chunk: large chunks where there are enough for all threads.
    share = whole.count // (SHARES * max(threads_of(workers), 1)) // LANES * LANES
    return max(size, min(share, PATH_STEPS // whole.steps // LANES * LANES, FARTHEST))


def _empty(whole: Task, problem: Problem, reason: str, about: dict[str, Any]) -> Ensemble:
    """The ensemble without paths."""
    d, m, K = problem.dimension, problem.noises, len(whole.stops)
    none, integers = np.empty(0), np.empty(0, dtype=np.int64)
    return Ensemble(
        y=np.empty((d, 0)), W=np.empty((m, 0)), status=integers, failed_step=integers, energy_defect=none,
        casimir_defect=none, gradient_evaluations=0, structure_evaluations=0, iterations=0,
        times=np.array(whole.stops, dtype=np.float64) * whole.h, states=np.empty((K, d, 0)),
        engine="compiled" if whole.compiled else "numpy", reason=reason, about=about,
    )  # fmt: skip


def _about(whole: Task, problem: Problem, dW: Any) -> dict[str, Any]:
    """Describe the paths as JSON: equal descriptions mean equal paths.

    Fingerprints stand for the problem and the scheme. Those of compiled ones are cached, as kernels are: these are
    records, which do not change.
    """
    known = (whole.scheme, problem, whole.y0.tobytes(), whole.h)
    try:
        fingerprint = (_kept_fingerprint if whole.compiled else _fingerprint)(*known)
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
        "increments": ("drawn" if dW is None else hashlib.sha256(dW.tobytes()).hexdigest()[:16])
        + ("" if law is None else f", {law}"),
        "refine": "as far as it goes" if whole.refine is None else whole.refine,
        "truncation": "none" if whole.truncation is None else whole.truncation,
        "compensated": whole.compensated,
        "engine": "compiled" if whole.compiled else "numpy",
        "y0": [float(v) for v in whole.y0],
        "noise": [float(c) for c in problem.c],
        "stops": list(whole.stops),
    }


def _fingerprint(scheme: Scheme, problem: Problem, start: bytes, h: float) -> str:
    """A fingerprint of a problem and a scheme from their values at y0 and one step: functions cannot be compared."""
    y0 = np.frombuffer(start).copy()
    with np.errstate(all="ignore"):
        values = [problem.hamiltonian(y0), problem.gradient(y0), problem.structure(y0)]
        try:
            increment = np.full(problem.noises, 0.25 * math.sqrt(h))
            values.append(scheme.step(problem, y0.copy(), h, increment))
        except Exception as error:  # a refused step is part of the scheme's behaviour too
            values.append(np.frombuffer(type(error).__name__.encode(), dtype=np.uint8))
    bits = b"".join(np.ascontiguousarray(value).tobytes() for value in values)
    return hashlib.sha256(bits).hexdigest()[:16]


_kept_fingerprint = lru_cache(maxsize=256)(_fingerprint)
