"""Measurements of a solver for each kind of noise: orders of one step and of paths, the limit,
and kept structure.

The laws "local-mean", "local-mean-square" and "local-weak" give slopes of errors of one step by
quadrature. By Milstein's theorem the mean-square order is the lesser of the slope of the mean error
less 1 and that of the rms error less ½; the weak order is the slope of the weak error less 1. The
order of paths is the slope of the rms error against the log-ODE, as in the law "mean-square-order".
It is measured if the documented order is at most the log-ODE's, 1.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache, partial
from typing import Any

import numpy as np
from sepv.properties import StrongErrors, local_states, one_step, refined
from sepv.properties import gaussian_rule_degree as rule_degree
from sepv.properties import gaussian_rule_for as rule_for
from sepv.properties import mean_square_slope as slope

from benchmarks.peers.compliance_measurements import _text_of, release
from benchmarks.peers.kept_measurements import Cell
from benchmarks.peers.solver import NOISE_KINDS, problem_of
from benchmarks.peers.solver import scheme as scheme_for
from sepv import __version__
from sepv.law import Effort, Verdict
from sepv.peers.peer import Solver
from sepv.problem import Array, Problem, channel_slope, matvec, noise_field
from sepv.schemes import LOCAL_LAWS, Scheme
from sepv.simulate import RoughPath, run_chunk
from sepv.verification import load_laws, verify

KEPT_LAWS = ("casimir", "poisson-map")
SOLVER_T, SOLVER_STEPS = 0.5, (8, 32, 128)
# The number of paths of solvers that take batches, and of solvers that take one state at a time.
BATCH_PATHS, UNBATCHED_PATHS = 512, 128
# The probability that the interval of an order of paths misses it.
PATHS_ORDER_ALPHA = 1e-4
# The order of the log-ODE, which is the reference for paths.
LOG_ODE_ORDER = 1.0
# A step that is small enough to show the limit up to LIMIT_ERROR: a mean is off by O(h), or O(√h)
# for differences over √h.
LIMIT_STEP, LIMIT_ERROR = 2.0**-16, 0.05


def cells(library: str, solver: Solver, effort: Effort) -> Iterator[Cell]:
    """The cells of all measurements of one solver."""
    texts = {law.name: _text_of(law) for law in load_laws((*LOCAL_LAWS, *KEPT_LAWS))}
    key = (release(library), __version__, effort.seed)
    for kind, documented in solver.documented.items():

        def cell(name: str, more: tuple[Any, ...], measure: Any, kind: str = kind) -> Cell:
            return Cell(solver.name, f"{kind}, {name}", (*key, NOISE_KINDS[kind], *more), measure)

        laws = (*(texts[law] for law in LOCAL_LAWS), *documented)
        yield cell("one step", laws, partial(_local, solver, kind, effort))
        yield cell("limit", (LIMIT_STEP,), partial(_limit, solver, kind))
        if (documented[0] or LOG_ODE_ORDER) <= LOG_ODE_ORDER:
            yield cell(
                "paths",
                (SOLVER_T, SOLVER_STEPS, BATCH_PATHS, UNBATCHED_PATHS, PATHS_ORDER_ALPHA),
                partial(_over_paths, solver, kind, effort.seed),
            )
        for law in KEPT_LAWS:
            yield cell(law, (texts[law], effort.examples), partial(_kept, solver, kind, law, effort))


def orders(solver: Solver, kind: str, local: dict[str, Any]) -> tuple[float, float]:
    """Mean-square and weak order from the slopes of `_local`.

    Steps are compared with the log-ODE. It differs from the solution by O(h^{3/2}), or by O(h²) if
    noises commute and space-time areas are known. So no order above 1, or 1.5, is visible.
    """
    mean, rms, weak = (local[law]["slope"] for law in LOCAL_LAWS)
    known = 1.5 if solver.asks == "space-time" and kind != "general" else LOG_ODE_ORDER
    return min(mean - 1, rms - 0.5, known), weak - 1


def _local(solver: Solver, kind: str, effort: Effort) -> dict[str, Any]:
    """Slopes of the three local errors, infinite if all errors are rounding,
    and verdicts on the documented orders.
    """
    report = verify(scheme_for(solver, kind), laws=list(LOCAL_LAWS), effort=effort)
    if report.interrupted:
        raise KeyboardInterrupt
    found: dict[str, Any] = {}
    for law in LOCAL_LAWS:
        finding = report.finding(law)
        seen = (finding.witness or {}).get("measured", ())
        value = math.nan if not seen else seen[0]["slope"]
        if value is None:  # rounding, where the law holds; too few step sizes, where it does not
            value = math.inf if finding.verdict is Verdict.HOLDS else math.nan
        found[law] = {"slope": value, "verdict": finding.verdict.value, "message": finding.message}
    return found


def _kept(solver: Solver, kind: str, law: str, effort: Effort) -> str:
    with np.errstate(over="ignore", invalid="ignore"):
        report = verify(scheme_for(solver, kind), laws=[law], effort=effort)
    if report.interrupted:
        raise KeyboardInterrupt
    return report.finding(law).verdict.value


def _limit(solver: Solver, kind: str) -> dict[str, float]:
    """λ in E[y1 − y0] = h(a + λs), and the remainder relative to |s|,
    for the drift a given and s = ½Σ F_j′F_j.

    λ is 0 for a solver that takes a as the drift of an Itô equation, and 1 for a solver of
    Stratonovich equations.
    """
    problem, scheme = problem_of(kind), scheme_for(solver, kind)
    h, states = LIMIT_STEP, local_states(scheme, problem)
    nodes = rule_for(scheme, problem, h, rule_degree(scheme))
    y, _ = one_step(scheme, problem, states, h, nodes)
    moved = (y - states[..., None]) @ nodes.weights / h
    s = _correction(problem, states)
    a = matvec(problem.structure(states), problem.gradient(states)) + (s if solver.ito else 0.0)
    size = float(np.sum(s * s))
    if not size:
        return {"share": math.nan, "left": float(np.max(np.abs(moved - a)) / np.max(np.abs(a)))}
    share = float(np.sum((moved - a) * s)) / size
    return {"share": share, "left": float(np.sqrt(np.sum((moved - a - share * s) ** 2) / size))}


def _correction(problem: Problem, y: Array) -> Array:
    """Itô's correction ½ Σ_j c_j² f_j′f_j of the drift."""
    parts = [
        0.5 * c * c * matvec(channel_slope(problem, 1 + j, y), noise_field(problem, j, y))
        for j, c in enumerate(problem.c)
    ]
    return np.asarray(sum(parts))


def limit_of(found: dict[str, float]) -> str:
    """The limit of a solver, Stratonovich's or Itô's solution, in words."""
    if math.isnan(found["share"]):
        return "both" if found["left"] < LIMIT_ERROR else "neither"
    if found["left"] < LIMIT_ERROR and abs(found["share"]) < LIMIT_ERROR:
        return "Itô"
    if found["left"] < LIMIT_ERROR and abs(found["share"] - 1) < LIMIT_ERROR:
        return "Stratonovich"
    return "neither"


@lru_cache(maxsize=8)
def _reference(kind: str, seed: int, paths: int) -> tuple[RoughPath, Array, float]:
    """The path with areas that solver and reference share, y(T),
    and the rms of the reference's own error.
    """
    problem = problem_of(kind)
    return refined(
        problem, np.array(problem.initial), SOLVER_T, SOLVER_STEPS[-1], range(paths), seed, order=1.0
    )


def _over_paths(solver: Solver, kind: str, seed: int) -> dict[str, Any]:
    """The order of paths as (estimate, low, high), rms errors,
    and the number of paths that failed at any step size.
    """
    scheme, problem = scheme_for(solver, kind), problem_of(kind)
    count = BATCH_PATHS if solver.batched else UNBATCHED_PATHS
    rough, exact, doubt = _reference(kind, seed, count)
    with np.errstate(all="ignore"):
        ends = [
            _end(solver, scheme, kind, problem, SOLVER_T / n, rough.rows(n, solver.asks))
            for n in SOLVER_STEPS
        ]
        errors = np.stack([y - exact for y in ends])
    arrived = np.isfinite(errors).all(axis=(0, 1))
    kept = errors[:, :, arrived]
    scale = float(np.max(np.abs(exact)))
    strong = StrongErrors(
        SOLVER_T,
        SOLVER_STEPS,
        np.sum(kept**2, axis=1),
        kept,
        (0,) * len(SOLVER_STEPS),
        scale,
        reference=doubt,
    )
    order = slope(strong, PATHS_ORDER_ALPHA)
    return {
        "order": (order.value, order.low, order.high),
        "rms": strong.rms().tolist(),
        "reference": doubt,
        "failed": int(np.count_nonzero(~arrived)),
    }


def _end(solver: Solver, scheme: Scheme, kind: str, problem: Problem, h: float, rows: Array) -> Array:
    start = np.array(problem.initial, dtype=np.float64)
    if solver.path is not None:
        return solver.path(kind)(problem, start, h, rows)[-1]
    return run_chunk(scheme, problem, start, h, rows, None, track=False).y
