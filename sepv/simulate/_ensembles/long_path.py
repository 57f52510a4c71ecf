"""One long path, run in pieces of a fraction of a second: progress can be shown,
and Ctrl-C keeps the steps done.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from sepv._arguments import require_flag
from sepv.children import interruption_answered
from sepv.core.newton import Status
from sepv.errors import UsageError, require_one_of
from sepv.problem import Array, Problem
from sepv.schemes import PointLaw, Scheme, Step
from sepv.simulate._ensembles.ensemble import choose
from sepv.simulate._ensembles.task import NumpyChunk, Task
from sepv.simulate._run_arguments import checked, require_drawable

# The intended duration of a piece of the path in seconds, and the number of steps of the first
# piece.
PIECE_SECONDS, FIRST_PIECE = 0.2, 4096
# The engines that run a single path.
ENGINES = ("auto", "numpy", "compiled")


@dataclass(frozen=True)
class LongPath:
    """The result of `long_path`: the whole path, or the steps before an interrupt or an unsolved
    step.

    Attributes
    ----------
    steps, planned : int
        The number of steps that were solved, and the number of steps requested.
    t : float
    y : (d,), W : (m,)
        The state at the time t that was reached, and W(t).
    times, states : (K,), (d, K)
        The times n·h of the states that were kept (see `every`), and these states.
    energy_defect, casimir_defect : float
        The largest |H(y_n) − H(y_0)|, and |C(y_n) − C(y_0)| of any quadratic or linear Casimir C,
        over all steps done.
    energy_defects : (K,)
        H(y) − H(y_0) at `times`.
    status, failed_step : the status of the step that failed, and the number of steps before it (−1
        if all were solved).
    iterations, gradient_evaluations : counts of the work.
    seconds : float
        Wall time without compilation.
    interrupted : bool
    engine, reason : the engine used, and why it is not the compiled one.
    """

    steps: int
    planned: int
    t: float
    y: Array
    W: Array
    times: Array
    states: Array
    energy_defect: float
    casimir_defect: float
    energy_defects: Array
    status: Status
    failed_step: int
    iterations: int
    gradient_evaluations: int
    seconds: float
    interrupted: bool
    engine: str
    reason: str
    chunk: Any = field(repr=False, default=None)


def long_path(
    scheme: str | Scheme | Step,
    problem: str | Problem,
    *,
    h: float,
    steps: int | None = None,
    T: float | None = None,
    seed: int = 0,
    path: int = 0,
    y0: ArrayLike | None = None,
    truncation: int | Literal["own"] | None = "own",
    increments: str | PointLaw | None = None,
    refine: int | None = None,
    every: int | None = None,
    compensated: bool = False,
    engine: str = "auto",
    progress: Callable[[int, int], None] | None = None,
    resume: LongPath | None = None,
) -> LongPath:
    """Run path number `path` of `ensemble` over any number of steps;
    the memory needed does not grow with this number.

    Parameters
    ----------
    scheme, problem, h, steps, T, seed, y0, truncation, increments, refine, engine
        As for `ensemble`.
    path : int
        The number of the path in `ensemble`.
    every : int, optional
        Keep the state after every `every` steps; by default no state is kept.
    compensated : bool
        Use Kahan's summation for y + increment. The rounding of a plain sum causes most of the
        energy's random walk.
    progress : callable (steps done, steps), optional
        Called a few times a second.
    resume : LongPath, optional
        The result of an earlier call with the same arguments in this process, to continue from.

    Returns
    -------
    LongPath
        After Ctrl-C: the steps done so far, with `interrupted` set. After a step that was not
        solved: the steps before it, with its `status`.

    Raises
    ------
    UsageError
        For invalid arguments, as in `ensemble`.
    """
    require_flag("compensated", compensated)
    asked = checked(scheme, problem, h, T, steps, y0, truncation, increments)
    scheme, problem, start, count, k = asked
    if every is not None and (not isinstance(every, (int, np.integer)) or every < 1):
        raise UsageError(
            expected="every, an integer ≥ 1", received=repr(every), remedy="say how many steps apart"
        )
    require_drawable(asked, h, seed, range(path, path + 1), refine)
    require_one_of("engine", engine, ENGINES, "a card runs many paths: sepv.ensemble")
    target, reason = choose(engine, scheme, problem, compensated, paths=1)
    task = Task(
        scheme=scheme, problem=problem, y0=start, h=float(h), steps=count, first=path, count=1, seed=int(seed),
        refine=refine, truncation=k, stops=(), compensated=compensated, engine=target.name,
    )  # fmt: skip
    if resume is None:
        times, states, chunk, before = [], [], target.chunk(task, problem), 0.0
    else:
        if replace(resume.chunk.task, y0=task.y0) != task:
            raise UsageError(
                expected="resume: a path made with the same arguments",
                received="other arguments",
                remedy="repeat the call with resume= added, and nothing else changed",
            )
        times, states, chunk = list(resume.times), list(resume.states.T), resume.chunk
        before = resume.seconds
    begun = time.perf_counter()
    interrupted = False
    try:
        for kept in _pieces(chunk, count, every):
            if kept and not chunk.failed():
                times.append(chunk.done * h)
                states.append(chunk.states()[:, 0])
            if progress is not None:
                progress(chunk.done, count)
            if chunk.failed():
                break
    except KeyboardInterrupt:
        interruption_answered()
        interrupted = True
    ends = chunk.result(np.empty((0, problem.dimension, 1)))
    done = chunk.done if ends.failed_step[0] < 0 else int(ends.failed_step[0])
    W = ends.W[:, 0].copy()
    if ends.failed_step[0] >= 0:  # increments after t were added too
        W = sum(islice(NumpyChunk(task, problem).increments, done), np.zeros((problem.noises, 1)))[:, 0]
    table = np.array(states).reshape(-1, problem.dimension).T
    return LongPath(
        steps=done,
        planned=count,
        t=done * h,
        y=ends.y[:, 0].copy(),
        W=W,
        times=np.array(times),
        states=table,
        energy_defect=float(ends.energy_defect[0]),
        casimir_defect=float(ends.casimir_defect[0]),
        energy_defects=problem.hamiltonian(table) - problem.hamiltonian(start),
        status=Status(int(ends.status[0])),
        failed_step=int(ends.failed_step[0]),
        iterations=ends.iterations,
        gradient_evaluations=ends.gradient_evaluations,
        seconds=before + time.perf_counter() - begun,
        interrupted=interrupted,
        engine=target.name,
        reason=reason,
        chunk=chunk,
    )


def _pieces(chunk: Any, count: int, every: int | None) -> Any:
    """Advance the chunk in pieces of about PIECE_SECONDS; after each,
    yield True if its state is to be kept.
    """
    length = FIRST_PIECE
    while chunk.done < count:
        stop = min(chunk.done + length, count)
        if every is not None:
            stop = min(stop, (chunk.done // every + 1) * every)
        begun = time.perf_counter()
        asked = stop - chunk.done
        chunk.advance(asked)
        seconds = max(time.perf_counter() - begun, 1e-9)
        length = int(min(max(asked * PIECE_SECONDS / seconds, 1), 16 * length))
        yield every is not None and chunk.done % every == 0
