"""Measurement of a scheme in one case: counts of work as exact integers,
errors and defects of paths, times.

This file also runs with another checkout (`sepv.studies._bench.timed_process`), which may be older.
So it uses only the contract of a scheme and names that every release has, such as `exact_flow`,
`problems` and `truncate`.
"""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter, process_time
from typing import Any

import numpy as np

import sepv
from sepv import problems
from sepv.exact import exact_flow
from sepv.problem import Problem
from sepv.schemes import Scheme
from sepv.simulate import _truncation as bounded
from sepv.simulate._batch import Carried, batch_step
from sepv.statistics import JACKKNIFE_GROUPS
from sepv.studies._evaluation_count import Work, counted

_EPS = float(np.finfo(np.float64).eps)


def measure(scheme: Scheme, case: dict[str, Any]) -> dict[str, Any]:
    """Measure one case; return `counters`, and `error`, `energy`,
    `casimir` as hex mean squares over groups of paths.

    The rounding error of evaluating H and C is added to their defects, so that ratios of tiny
    defects are near 1.
    """
    problem = build(case)
    dW = increments(scheme, problem, case)
    work = Work()
    _, solves = run(scheme, counted(problem, work), case, dW)
    y, _ = run(scheme, problem, case, dW, watch=True)
    ends, defects = y
    theta = problem.random_step(case["h"] * case["steps"], raw_increments(problem, case).sum(axis=0))
    squared = np.sum((ends - exact_flow(problem, theta).y) ** 2, axis=0)
    if scheme.solve is not None:
        work.iterations = solves["iterations"]
    return {
        "case": case,
        "counters": {**work.to_json(), "failed solves": solves["failed"]},
        "error": _groups(squared),
        "energy": _groups(defects[0] ** 2),
        "casimir": _groups(defects[1] ** 2),
    }


def build(case: dict[str, Any]) -> Problem:
    """Load or build the problem that a case names or contains as data,
    with the case's initial state if it has one.
    """
    given = case["problem"]
    if isinstance(given, str) and ":" in given:  # a user's problem, which only newer releases support
        from sepv.schemes import load_problem

        problem = load_problem(given)
    else:
        problem = (
            problems.by_name(given) if isinstance(given, str) else problems.build(problems.from_json(given))
        )
    return (
        problem if case["initial"] is None else replace(problem, initial=tuple(case["initial"]), check=False)
    )


def raw_increments(problem: Problem, case: dict[str, Any]) -> np.ndarray:
    """Wiener increments (N, m, M) from NumPy's generator alone,
    so that every release of sepv has the same ones.
    """
    rng = np.random.Generator(np.random.PCG64(case["seed"]))
    shape = (case["steps"], problem.noises, case["paths"])
    return np.asarray(np.sqrt(case["h"]) * rng.standard_normal(shape))


def increments(scheme: Scheme, problem: Problem, case: dict[str, Any]) -> np.ndarray:
    """The `raw_increments` of a case, truncated as the scheme declares."""
    return bounded.truncate(raw_increments(problem, case), case["h"], scheme.truncation)


def run(
    scheme: Scheme, problem: Problem, case: dict[str, Any], dW: np.ndarray, *, watch: bool = False
) -> tuple[tuple[np.ndarray, np.ndarray], dict[str, int]]:
    """Run all paths; return (last states (d, M), largest defects (2, M) of H and Casimirs),
    and the counts of solves.

    The counts are of iterations and failures. A path stops at its first failed step. Without
    `watch`, defects are 0.
    """
    y = np.repeat(np.asarray(problem.initial, dtype=np.float64)[:, None], dW.shape[2], axis=1)
    first = _invariants(problem, y) if watch else None
    defects = np.zeros((2, y.shape[1]))
    solves = {"iterations": 0, "failed": 0}
    alive, carried = np.arange(y.shape[1]), Carried(scheme)
    for row in dW:
        value, failed, iterations = _advance(scheme, problem, y[:, alive], case["h"], row[:, alive], carried)
        solves["iterations"] += iterations
        solves["failed"] += int(np.count_nonzero(failed))
        y[:, alive[~failed]] = value[:, ~failed]
        alive = alive[~failed]
        carried.keep(~failed)
        if first is not None:
            now = np.abs(_invariants(problem, y) - first)
            defects = np.maximum(defects, [now[0], now[1:].max(axis=0, initial=0.0)])
    if first is not None:
        defects = defects + _EPS * _scales(problem, y)[:, None]
    return (y, defects), solves


def _advance(
    scheme: Scheme, problem: Problem, y: np.ndarray, h: float, dW: np.ndarray, carried: Carried
) -> tuple[np.ndarray, np.ndarray, int]:
    """Take one step of all M paths; return new states (d, M), flags (M,) of failed paths,
    and the sum of iterations.
    """
    if scheme.solve is not None:
        solution = scheme.solve(problem, y, h, dW)
        return solution.value, np.asarray(solution.status) != 0, int(np.sum(solution.iterations))
    value, _ = batch_step(scheme, problem, y, h, dW, carried)
    return value, ~np.all(np.isfinite(value), axis=0), 0


def seconds(scheme: Scheme, case: dict[str, Any], loops: int, call: str = "step") -> tuple[float, float]:
    """Measure the processor seconds and the clock seconds of `loops` runs of a case.

    call : "step" times the scheme's steps alone, with given increments. "ensemble" times
        `sepv.ensemble` as users call it, with its engine, its random numbers and its defects of
        invariants
    """
    problem = build(case)
    h, N = case["h"], case["steps"]
    dW = increments(scheme, problem, case)
    begin = process_time(), perf_counter()
    for _ in range(loops):
        if call == "ensemble":
            sepv.ensemble(scheme, problem, h=h, T=h * N, paths=case["paths"], seed=case["seed"])
        else:
            run(scheme, problem, case, dW)
    return process_time() - begin[0], perf_counter() - begin[1]


def _groups(values: np.ndarray) -> list[str]:
    return [float(np.mean(part)).hex() for part in np.array_split(values, JACKKNIFE_GROUPS)]


def _invariants(problem: Problem, y: np.ndarray) -> np.ndarray:
    rows = [problem.hamiltonian(y)]
    rows += [np.sum(y * np.tensordot(A, y, 1), axis=0) for A in problem.casimirs]
    rows += [np.tensordot(b, y, 1) for b in problem.linear_casimirs]
    return np.stack(rows)


def _scales(problem: Problem, y: np.ndarray) -> np.ndarray:
    """Typical sizes (2,) of the terms of H and of the Casimirs;
    eps times them is the rounding of an evaluation.
    """
    energy = float(np.mean(np.sum(np.abs(problem.gradient(y) * y), axis=0)))
    casimirs = [np.sum(np.abs(y) * (np.abs(A) @ np.abs(y)), axis=0) for A in problem.casimirs]
    casimirs += [np.sum(np.abs(b[:, None] * y), axis=0) for b in problem.linear_casimirs]
    return np.array([energy, max((float(np.mean(c)) for c in casimirs), default=0.0)])
