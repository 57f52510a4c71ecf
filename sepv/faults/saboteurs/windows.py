"""Faults that show only for some step sizes h, noises or states, for varying B,
or for H that is not quadratic.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sepv.core.formula import Fields
from sepv.problem import Array, Problem, matvec, vector_field
from sepv.schemes import StatefulStep, Step, energy_preserving
from sepv.schemes import energy_preserving_formula as formula

from .formula import one_point_quadrature, with_structure
from .noise import clipped_at_one
from .record import Family, claiming, implicit, middle

FAMILY = Family("windows")


def _widths(h: float) -> float:
    return math.sqrt(2 * abs(math.log(h)))


@FAMILY.around("increments are clipped again, with k = 1, where 0.001 < h < 0.01", ("truncation",))
def clipped_in_a_window(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return clipped_at_one(step, problem, y, h, dW, _widths(h) if 1e-3 < h < 1e-2 else math.inf)


@FAMILY.around("increments are clipped at three standard deviations where h < 1e-8", ("truncation",))
def clipped_when_short(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return clipped_at_one(step, problem, y, h, dW, 3.0 if h < 1e-8 else math.inf)


@FAMILY.around("the second noise is clipped again, with k = 1, where 1e-4 < h < 0.1", ("truncation",))
def second_clipped_in_a_window(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    bound = math.sqrt(h) * _widths(h) if 1e-4 < h < 0.1 else math.inf
    return step(problem, y, h, np.concatenate([dW[:1], np.clip(dW[1:2], -bound, bound), dW[2:]]))


def _euler(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Euler's step, whose rms error in one step is O(h),
    where a scheme of order 1 needs O(h^(3/2)), as in (3.9).
    """
    return np.asarray(y + problem.random_step(h, dW) * vector_field(problem, y))


_WINDOW_LAWS = ("local-mean-square",)


@FAMILY.around("Euler's step where 0.001 < h < 0.01", _WINDOW_LAWS)
def euler_in_a_window(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return (_euler if 1e-3 < h < 1e-2 else step)(problem, y, h, dW)


@FAMILY.around("Euler's step where h < 1e-8", _WINDOW_LAWS)
def euler_when_short(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return (_euler if h < 1e-8 else step)(problem, y, h, dW)


@FAMILY.around("Euler's step where a noise is larger than 4", _WINDOW_LAWS)
def euler_in_large_noise(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return (_euler if np.max(problem.c, initial=0.0) > 4 else step)(problem, y, h, dW)


@FAMILY.around("Euler's step where 3 < |y| < 300", ("energy",))
def euler_at_some_sizes(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return (_euler if 3 < np.max(np.abs(y)) < 300 else step)(problem, y, h, dW)


@FAMILY.around("Euler's step where the problem has noises and ΔW = 0", ("energy",))
def euler_where_noise_rests(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return (_euler if dW.size and not np.any(dW) else step)(problem, y, h, dW)


@FAMILY.formula("∇H is taken at the midpoint where B varies", ("energy", "reference", "rounding"))
def midpoint_where_b_varies(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    varies = np.any(fields.structure(y) != fields.structure(y + 1.0))
    return (one_point_quadrature if varies else formula)(fields, y, z, step)


# A cell of width 1/8, on the orbit of the rigid body.
_CELL = np.array([6.0, 1.0, -4.0])


@FAMILY.around("a table has a wrong entry: in one cell y1 moves by 1e-9 Δ on its level of H", ("casimir",))
def wrong_cell_of_a_table(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y1 = step(problem, y, h, dW)
    if len(y) != 3:
        return y1
    g = problem.gradient(y1)
    along = np.zeros_like(y1)
    along[0] = 1.0
    along = along - g * g[0] / np.sum(g * g, axis=0)
    here = np.all(np.floor(8 * y).T == _CELL, axis=-1)
    return np.where(here, y1 + 1e-9 * problem.random_step(h, dW) * along, y1)


def _frozen(fields: Fields, y: Any, z: Any) -> Any:
    return fields.structure(middle(y, z) if fields.problem.degree == 2 else y)


FAMILY.rows(
    ("b-frozen-where-h-bends", "B is taken at y0 where H is not quadratic",
     ("mean-square-order", "weak-order", "right-limit", "casimir", "reference"), with_structure(_frozen)),
    by=implicit,
)  # fmt: skip


def _begun(problem: Problem, y: Array) -> Any:
    return y.copy(), problem.structure(y), 0


def _stale(problem: Problem, state: Any, h: float, dW: Array) -> Any:
    """In each second step, take B from the step before, unless H is quadratic."""
    y, before, number = state
    y1 = energy_preserving.step(problem, y, h, dW)
    B, g = problem.structure(middle(y, y1 - y)), problem.gradient(middle(y, y1 - y))
    if number % 2 and problem.degree != 2:
        y1 = y1 + problem.random_step(h, dW) * matvec(before - B, g)
    return y1, B, number + 1


FAMILY.rows(
    ("b-of-the-step-before", "in each second step B is that of the step before, where H is not quadratic",
     ("mean-square-order", "right-limit"), lambda: claiming(StatefulStep(_begun, _stale, lambda state: state[0]))),
)  # fmt: skip
