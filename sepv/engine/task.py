"""A chunk of paths: a pure function of what it is asked for, that any worker on any machine can run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sepv import wiener
from sepv.problem import Array, NamedProblem, PolynomialSystem, Problem
from sepv.problems import build
from sepv.scheme import Scheme
from sepv.simulation import Batch, Ensemble

# Steps whose increments the NumPy engine holds at once.
PIECE = 256


@dataclass(frozen=True)
class Task:
    """Paths first … first + count − 1 over `steps` steps.

    Attributes
    ----------
    problem : Problem, or its data where it can be built again from them: they travel.
    dW : (N, m, M) or None
        Given increments, untruncated, of paths `place` … `place` + count − 1.
    stops : increasing numbers of steps at which states are kept.
    """

    scheme: Scheme
    problem: Problem | PolynomialSystem | NamedProblem
    y0: Array
    h: float
    steps: int
    first: int
    count: int
    seed: int
    refine: int | None
    truncation: int | None
    stops: tuple[int, ...]
    compensated: bool
    compiled: bool
    dW: Array | None = None
    place: int = 0


def portable(problem: Problem) -> Problem | PolynomialSystem | NamedProblem:
    """The problem's data where they are all there is to it, else the problem."""
    if problem.data is not None and np.array_equal(build(problem.data).c, problem.c):
        return problem.data
    return problem


def run(task: Task) -> Ensemble:
    """The chunk's ends."""
    problem = task.problem if isinstance(task.problem, Problem) else build(task.problem)
    if task.compiled:
        from sepv.engine.chunk import run_compiled

        return run_compiled(task, problem)
    return _run_numpy(task, problem)


def _run_numpy(task: Task, problem: Problem) -> Ensemble:
    batch = Batch(task.scheme, problem, task.y0, task.count, compensated=task.compensated)
    W = np.zeros((problem.noises, task.count))
    kept = np.empty((len(task.stops), problem.dimension, task.count))
    done = 0
    for raw in _increments(task, problem):
        used = wiener.truncate(raw, task.h, task.truncation)
        for row, increment in zip(raw, used, strict=True):
            batch.step(task.h, increment)
            W += row
            done += 1
            for place in np.flatnonzero(np.equal(task.stops, done)):
                kept[place] = batch.y
    return batch.result(W, kept)


def _increments(task: Task, problem: Problem):  # type: ignore[no-untyped-def]
    if task.dW is not None:
        yield task.dW[:, :, task.place : task.place + task.count]
        return
    yield from wiener.walk(
        task.seed, T=task.h * task.steps, steps=task.steps, noises=problem.noises,
        paths=range(task.first, task.first + task.count), refine=task.refine, size=PIECE,
    )  # fmt: skip
