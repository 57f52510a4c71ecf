"""The fields of a system, their slopes and brackets, from its channels alone.

The order of a scheme that uses no random numbers but the increments ΔW_j depends on the brackets of
the noises, [f_i, f_j] = f_j′f_i − f_i′f_j (`column`). It is 1 if all brackets vanish, as for one
noise, and ½ in general.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np

from sepv.core.arrays import Array, matmul, matvec
from sepv.core.problem import System, combined_gradient, hessian
from sepv.problem._checks import sample_states
from sepv.problem._directional import structure_slope
from sepv.problem._facts import damping_matrix, one_field, one_hamiltonian
from sepv.problem._problem import Problem

# The largest bracket that counts as zero, relative to its factors. Slopes by differences may have a
# relative error of 1e-8, and a bracket that does not vanish is far larger at some sample state.
BRACKET_ZERO = 1e-6


def field(problem: System, k: int, y: Array) -> Array:
    """The field F_k of channel k = 0, …, m at y, (d, ...), that of a noise without its c_j."""
    F = problem.channels[k]
    if F.structure is None or F.gradient is None:
        return np.broadcast_to(np.reshape(F.vector, (-1, *(1,) * (y.ndim - 1))), y.shape)
    flow = matvec(F.structure(y), F.gradient(y))
    if np.ndim(F.damping):
        return flow - matvec(_matrix(problem, y), y)
    return np.asarray(flow - F.damping * y) if F.damping else flow


def slope(problem: System, k: int, y: Array) -> Array:
    """The derivative F_k′(y), (d, d, ...), of the field of channel k."""
    F = problem.channels[k]
    if F.structure is None or F.gradient is None:
        return np.zeros((problem.dimension, *y.shape))
    turned = structure_slope(problem, y, F.gradient(y), F)
    total = turned + matmul(F.structure(y), hessian(problem, y, F))
    return total - _matrix(problem, y) if F.damping else total


def _matrix(problem: System, y: Array) -> Array:
    """Γ as an array (d, d, 1, …) for states y (d, ...)."""
    return damping_matrix(problem)[(..., *(None,) * (y.ndim - 1))]


def drift(problem: System, y: Array) -> Array:
    """The drift B(y)∇H − Γy of a problem, (d, ...), where Γy is γy for a number γ and 0 without
    damping.
    """
    return field(problem, 0, y)


def noise_field(problem: System, j: int, y: Array) -> Array:
    """The field of noise number j = 0, …, m − 1 without its c_j, (d, ...): B∇H_j, G_j∇H,
    or the vector g_j.
    """
    return field(problem, 1 + j, y)


def bracket(problem: System, k: int, l: int, y: Array) -> Array:
    """The Lie bracket [F_k, F_l] = F_l′F_k − F_k′F_l of two channels 0, …, m without their c_j, (d,
    ...).

    In the expansion of the solution it multiplies the Lévy area of two noises, and A_0j = ½∫(s dW_j
    − W_j ds) for the drift and noise number j.
    """
    first = matvec(slope(problem, l, y), field(problem, k, y))
    return first - matvec(slope(problem, k, y), field(problem, l, y))


def combined_field(problem: System, y: Array, parts: Array) -> Array:
    """The field h F_0(y) + Σ_j c_j ΔW_j F_j(y), (d, M); `parts` (1 + m, M) holds h and the c_jΔW_j.

    B or ∇H is evaluated once where all channels share it.
    """
    pairs = list(zip(parts, problem.channels, strict=True))
    if one_hamiltonian(problem):
        # A noise with increment zero does not use its structure, which may be undefined (NaN) at y.
        S = sum(np.where(part != 0, part * F.keeping(y), 0.0) for part, F in pairs if F.keeping)
        total = matvec(np.asarray(S), problem.gradient(y))
    else:
        slopes = sum(part * F.gradient(y) for part, F in pairs if F.gradient)
        total = matvec(problem.structure(y), np.asarray(slopes))
    for part, F in pairs:
        if F.vector is not None:
            total = total + part * np.reshape(F.vector, (-1, 1))
    damped = bool(problem.channels[0].damping)
    return total - parts[0] * matvec(_matrix(problem, y), y) if damped else total


def hamiltonian_field(problem: System, y: Array, parts: Array) -> Array:
    """The field B(y)(h∇H_0 + Σ c_j ΔW_j ∇H_j) of a step, (d, M), for problems with one B.

    `parts` (1 + m, M) holds h and the c_j ΔW_j.
    """
    return matvec(problem.structure(y), combined_gradient(problem, y, parts))


def ito_drift(problem: System, y: Array) -> Array:
    """The drift of the Itô form of a problem, f_0 + ½ Σ_j c_j² f_j′f_j, (d, ...),
    with f_0 = B∇H_0 − Γy.
    """
    total = drift(problem, y)
    for k, c in enumerate(problem.c, 1):
        total = total + 0.5 * c * c * matvec(slope(problem, k, y), field(problem, k, y))
    return total


def column(problem: Problem) -> str:
    """The kind of a problem's noise, on which claims of order depend: "additive", "one",
    "commutative" or "general".

    In "additive" noise all fields are constant. "one" is one noise, or several noises of one H, as
    in (1.1). For "commutative" noise all brackets of fields are 0. Fields are tested at sample
    states only, and may differ elsewhere.
    """
    if one_field(problem):
        return "one"
    acting = [1 + int(j) for j in np.flatnonzero(problem.c)]
    if acting and _vanish(problem, lambda y: [slope(problem, k, y) for k in acting], per_field=True):
        return "additive"
    if len(acting) < 2:
        return "one"
    pairs = list(combinations(acting, 2))
    if _vanish(problem, lambda y: [bracket(problem, k, l, y) for k, l in pairs]):
        return "commutative"
    return "general"


def commutes(problem: Problem) -> bool:
    """True if the drift and all noise fields commute: y(T) is then the flow of T f_0 + Σ c_j W_j(T)
    f_j at time 1.
    """

    def brackets(y: Array) -> list[Array]:
        return [bracket(problem, 0, 1 + int(j), y) for j in np.flatnonzero(problem.c)]

    return column(problem) != "general" and _vanish(problem, brackets)


def _vanish(problem: Problem, values: Callable[[Array], list[Any]], *, per_field: bool = False) -> bool:
    """True if all vectors or matrices `values(y)` are at most BRACKET_ZERO times a scale,
    at every sample state y.

    The scale is about max|f_j| · max|f_j′| for the noise fields f_j at y. With `per_field` it is
    max|f_j|/max(1, |y|).
    """
    acting = [1 + int(j) for j in np.flatnonzero(problem.c)]
    for y in sample_states(problem):
        lanes = y[:, None]
        rate = max((float(np.max(np.abs(field(problem, k, lanes)))) for k in acting), default=0.0)
        bend = max((float(np.max(np.abs(slope(problem, k, lanes)))) for k in acting), default=0.0)
        unit = rate / max(1.0, float(np.max(np.abs(y))))
        size = unit if per_field else max(rate, unit) * max(bend, unit)
        if max((float(np.max(np.abs(v))) for v in values(lanes)), default=0.0) > BRACKET_ZERO * size:
            return False
    return True
