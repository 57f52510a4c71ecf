"""The fifth argument of a step, after dW: Lévy areas, space-time areas,
or half-step increments (`Scheme.asks`).

`sepv.simulate._areas` draws them. In arrays of increments they are k further rows below the m rows
of dW: the A_ij with i < j, the H_i, or the increments W(h/2) − W(0). `answer` separates them, and
calls the step with a fifth argument.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np

from sepv.errors import UsageError
from sepv.problem import Array, Problem
from sepv.schemes._scheme import Scheme, Step
from sepv.schemes._stateful import StatefulStep


def further_rows(asks: str, noises: int) -> int:
    """The number k of further rows below the m = `noises` rows of dW,
    for a scheme with `Scheme.asks` = `asks`.
    """
    return {"": 0, "areas": noises * (noises - 1) // 2, "halves": noises, "space-time": noises}[asks]


def answer(
    scheme: Scheme, problem: Problem, y: Any, h: float, dW: Array, *, any_path: bool = False, step: Step | None = None
) -> Any:  # fmt: skip
    """y1 of one step of the scheme, for dW (m, ...), or (m + k, ...)
    with the rows for the scheme's fifth argument.

    A law that holds for every path may leave these rows out: with `any_path`, `rows_of_any_path`
    makes them. Otherwise missing rows are a UsageError, because rows made up for a path do not have
    the distribution of drawn ones. A given `step` replaces the scheme's step. If it is
    `StatefulStep.step`, y is the internal state.
    """
    step = step or scheme.step
    if not scheme.asks:
        return step(problem, y, h, dW)
    wiener, count = dW[: problem.noises], further_rows(scheme.asks, problem.noises)
    if len(dW) == problem.noises and any_path:
        rows = rows_of_any_path(scheme.asks, h, wiener)
    elif len(dW) == problem.noises + count:
        rows = dW[problem.noises :]
    else:
        raise UsageError(
            expected=f"increments with {count} further rows, the {scheme.asks} that {scheme.name} asks for",
            received=f"{len(dW)} rows for {problem.noises} noises",
            remedy="sepv.simulate.drawn(…).rows(steps, asks) draws both; sepv.integrate does where dW is not given",
        )
    further = as_matrix(rows, problem.noises) if scheme.asks == "areas" else np.array(rows)
    return step(problem, y, h, np.array(wiener), further)


def carry(
    scheme: Scheme, problem: Problem, y: Array, state: Any, h: float, dW: Array, *, any_path: bool = False
) -> tuple[Any, Any]:
    """One step of a path from y: y1, and the state that the scheme carries to its next step.

    `state` is that after the previous step, or None at first and without a `StatefulStep`. For
    `any_path` see `answer`.
    """
    rule = scheme.step
    if not isinstance(rule, StatefulStep):
        return answer(scheme, problem, y, h, dW, any_path=any_path), None
    before = rule.begin(problem, y, h) if state is None else state
    after = answer(scheme, problem, before, h, dW, any_path=any_path, step=rule.step)
    return rule.value(after), after


def joined(asks: str, dW: Array, further: Array) -> Array:
    """The array (m + k, ...) of the increments `dW` and, below them, `further` as rows:
    the argument dW of `answer`.
    """
    return np.concatenate([dW, as_rows(further) if asks == "areas" else further])


def rows_of_any_path(asks: str, h: float, dW: Array) -> Array:
    """Further rows (k, ...) of one possible path with the increments dW,
    for laws that hold for every path.

    The rows are not random. With u_i = ΔW_i/(1 + ΔW_i²/|h|) and s = ±1, the sign of h, A_ij is
    s(u_iΔW_j − u_jΔW_i)/8, H_i is su_i/8, and the increments over the first half are ½ΔW + ¼su.
    Exchanging noises exchanges the rows. The reverse step, with −h and −ΔW, has areas −A and
    space-time areas H. Its first half is minus this step's second half.
    """
    size = abs(h) if h else 1.0
    u = dW / (1 + dW * dW / size)
    if asks == "halves":
        return np.asarray(0.5 * dW + np.sign(h) * 0.25 * u)
    sign = -1.0 if h < 0 else 1.0
    if asks == "space-time":
        return np.asarray(0.125 * sign * u)
    rows = [0.125 * sign * (u[i] * dW[j] - u[j] * dW[i]) for i, j in combinations(range(len(dW)), 2)]
    return np.array(rows).reshape(len(rows), *dW.shape[1:])


def as_matrix(rows: Array, noises: int) -> Array:
    """The skew matrix of Lévy areas, (m, m, ...), from its entries with i < j, (k, ...)."""
    matrix = np.zeros((noises, noises, *rows.shape[1:]))
    for row, (i, j) in zip(rows, combinations(range(noises), 2), strict=True):
        matrix[i, j], matrix[j, i] = row, -row
    return matrix


def as_rows(areas: Array) -> Array:
    """The entries with i < j of a skew matrix of Lévy areas (m, m, ...), as rows (k, ...)."""
    pairs = list(combinations(range(areas.shape[0]), 2))
    return np.array([areas[i, j] for i, j in pairs]).reshape(len(pairs), *areas.shape[2:])
