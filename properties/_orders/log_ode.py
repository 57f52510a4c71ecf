"""The log-ODE of a step: dy/ds = h f_0 + Σ c_j ΔW_j f_j + Σ_{i<j} c_i c_j A_ij [f_i, f_j] with the
Lévy areas A_ij.

If all fields f_i commute, the brackets vanish and y(1) is the exact solution. Else this is the
log-ODE method of step 2 (F. Castell and J. Gaines, Stochastic Process. Appl. 60, 1995; T. Lyons,
in: ICIAM 2014). The logarithm of the exact flow has further brackets of three fields, whose
integrals are of the order of h^{3/2} with mean O(h²). So y(1) is the exact solution up to these
integrals, and consecutive steps converge with mean-square order 1. The method is a reference only:
no scheme under verification uses it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from sepv.problem import (
    Array,
    Problem,
    bracket,
    combined_field,
    each_noise,
)
from sepv.record import EPS
from sepv.schemes import CLASSICAL, DORMAND_PRINCE_8, ExplicitTableau
from sepv.simulate import RoughPath

# The least and largest numbers of explicit steps. The number is doubled until the result changes by
# roundings only.
LOG_ODE_MIN_STEPS, LOG_ODE_MAX_STEPS = 4, 64


def field(problem: Problem, y: Array, parts: Array, areas: Array, bridges: Array | None = None) -> Array:
    """Evaluate the log-ODE's field at y (d, M). `parts` (1 + m, M) holds h and c_j ΔW_j,
    `areas` (k, M) Lévy areas.

    `bridges` (m, M) are space-time areas H. They add the brackets with the drift, Σ c_j A_0j [f_0,
    f_j], A_0j = −hH_j. If the noises commute, the integrals of the terms that are still omitted are
    then of the order of h².
    """
    return with_brackets(combined_field(problem, y, parts), problem, y, parts[0], areas, bridges)


def with_brackets(
    total: Array, problem: Problem, y: Array, h: Any, areas: Array, bridges: Array | None
) -> Array:
    """Add to `total` (d, M) the brackets of the noises,
    and with `bridges` the brackets with the drift (`field`).
    """
    for area, (i, j) in zip(areas, combinations(range(problem.noises), 2), strict=False):
        factor = problem.c[i] * problem.c[j] * area
        if np.any(factor):
            total = total + factor * bracket(problem, 1 + i, 1 + j, y)
    for j, H in enumerate(() if bridges is None else bridges):
        total = total - problem.c[j] * h * H * bracket(problem, 0, 1 + j, y)
    return total


def runge_kutta(field: Callable[[Array], Array], y: Array, steps: int, tableau: ExplicitTableau) -> Array:
    """Return z(1) for ż = field(z), z(0) = y, by `steps` equal steps of an explicit Runge-Kutta
    method.
    """
    for _ in range(steps):
        slopes: list[Array] = []
        for row in tableau.A:
            at = y
            for j, a in row.items():
                at = at + (a / steps) * slopes[j]
            slopes.append(field(at))
        for i, b in tableau.b.items():
            y = y + (b / steps) * slopes[i]
    return y


def log_flow(problem: Problem, y: Array, parts: Array, areas: Array) -> tuple[Array, float]:
    """Return the solution y(1) of the log-ODE of one step from y (d, M), and its error.

    The number of Runge-Kutta steps of order 8 is doubled until two results agree to rounding.
    """
    right_side = partial(field, problem, parts=parts, areas=areas)
    steps, logarithm = LOG_ODE_MIN_STEPS, runge_kutta(right_side, y, LOG_ODE_MIN_STEPS, DORMAND_PRINCE_8)
    while True:
        steps *= 2
        finer = runge_kutta(right_side, y, steps, DORMAND_PRINCE_8)
        apart, scale = float(np.max(np.abs(finer - logarithm))), float(np.max(np.abs(finer)))
        logarithm = finer
        # The finer result's error is 1/256 of the difference, unless roundings are larger.
        error = apart / 128 + 16 * EPS * scale
        if apart <= 128 * EPS * scale or steps >= LOG_ODE_MAX_STEPS:
            return logarithm, error


def path(problem: Problem, y0: Array, rough: RoughPath, *, with_drift: bool) -> Array:
    """Return the log-ODE's y(T) (d, M) after the N steps of a rough path.

    Each step makes a classical Runge-Kutta step for the increments alone, and then adds the
    brackets at the old state. Because E[A_ij ΔW_k] = 0, this splitting omits terms of O(h^{3/2})
    with mean O(h²). It takes half as long as a step with the brackets in the field, and its errors
    are larger by a twentieth.

    `with_drift` is for noises whose brackets with each other vanish. It adds the brackets with the
    drift instead. The terms that a step omits are then O(h²).
    """
    y = np.repeat(y0[:, None], rough.dW.shape[2], axis=1)
    none = np.zeros((0, rough.dW.shape[2]))
    for increment, areas, bridges in zip(rough.dW, rough.areas, rough.bridges, strict=True):
        parts = each_noise(problem, rough.h, increment)
        moved = runge_kutta(partial(field, problem, parts=parts, areas=none), y, 1, CLASSICAL)
        chosen = (none, bridges) if with_drift else (areas, None)
        y = with_brackets(moved, problem, y, rough.h, *chosen)
    return y
