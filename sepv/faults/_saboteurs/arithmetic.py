"""Faults of the arithmetic: the formula is right, and digits are lost on the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from sepv.faults._saboteurs.formula import quadrature
from sepv.faults._saboteurs.record import Saboteur, around, implicit, middle, right_side
from sepv.problem import Array, Problem
from sepv.problem._fields import matvec
from sepv.schemes._energy_preserving import formula, jacobian
from sepv.schemes._one_step import random_step
from sepv.schemes._scheme import Step
from sepv.solve import Fields
from sepv.solve._formula import counted

_SEEN = ("energy", "casimir", "midpoint", "symmetry", "reference")


def _after(change: Callable[[Array, Array], Array]) -> Callable[[Step], Step]:
    """The right step, and then change(y0, y1)."""
    return lambda step: lambda problem, y, h, dW: change(y, step(problem, y, h, dW))


def _single(values: Array) -> Array:
    return values.astype(np.float32).astype(np.float64)


def _single_structure(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return step[0] * matvec(_single(fields.structure(middle(y, z))), fields.mean_gradient(y, z))


def _off_skew(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return formula(fields, y, z, step) + 1e-9 * step[0] * fields.mean_gradient(y, z)


def _short_nodes(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    if fields.problem.degree is None:
        return formula(fields, y, z, step)
    average = quadrature(fields, y, z, max(1, -(-fields.problem.degree // 2)), digits=8)
    return step[0] * matvec(fields.structure(middle(y, z)), average)


def _differences(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    def gradient(y: Array) -> Array:
        # Wide enough that the noise of the differences stays below what the solver takes for rounding.
        d, H = fields.problem.dimension, fields.problem.hamiltonian
        width = 1e-3 * np.eye(d).reshape(d, -1, *(1,) * (y.ndim - 1))
        return np.stack([(H(y + e) - H(y - e)) / 2e-3 for e in width])

    changed = replace(fields.problem, gradient=gradient, check=False)
    return counted(formula, changed, y, y + z, step).value


def _shortcut(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    short = np.max(np.abs(z), axis=0) < 1e-4 * np.max(np.abs(y), axis=0)
    average = np.where(short, fields.gradient(y), fields.mean_gradient(y, z))
    return step[0] * matvec(fields.structure(middle(y, z)), average)


def _toward_zero(step: Step) -> Step:
    """The last addition y0 + Δ B∇̄H rounded toward zero, as a chopping machine does."""

    def chopped(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        move = right_side(problem, y, step(problem, y, h, dW), random_step(problem, h, dW))
        total = y + move
        # Knuth's two-sum: what the rounding of y + move left over, exactly.
        part = total - y
        lost = (y - (total - part)) + (move - part)
        return np.where(lost * total < 0, np.nextafter(total, 0.0), total)

    return chopped


def _nudged(step: Step) -> Step:
    """In one step of twenty, chosen by the last digits of y, a component moves one ulp to where H is larger."""

    def nudged(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y1 = step(problem, y, h, dW)
        slope = problem.gradient(y1)
        gain = np.abs(slope) * np.spacing(np.abs(y1))
        largest = np.arange(len(y1)).reshape(-1, *(1,) * (y1.ndim - 1)) == np.argmax(gain, axis=0)
        digits = np.ascontiguousarray(y).view(np.uint64).sum(axis=0, dtype=np.uint64)
        chosen = largest & (digits % 20 == 0) & np.any(y1 != y, axis=0)
        return np.where(chosen, np.nextafter(y1, np.copysign(np.inf, slope)), y1)

    return nudged


_TABLE = (
    (
        "relative-error-1e-10",
        "y1 has a relative error of 1e-10",
        around(_after(lambda _, y1: y1 * (1 + 1e-10))),
        ("identity", *_SEEN, "rounding"),
    ),
    (
        "step-off-by-1e-10",
        "Δ has a relative error of 1e-10",
        implicit(lambda fields, y, z, step: (1 + 1e-10) * formula(fields, y, z, step)),
        ("midpoint", "reference", "reduction"),
    ),
    (
        "float32",
        "y1 passes through single precision",
        around(_after(lambda _, y1: _single(y1))),
        ("identity", *_SEEN, "equivariance", "rounding"),
    ),
    (
        "float32-increment",
        "y1 − y0 passes through single precision",
        around(_after(lambda y0, y1: y0 + _single(y1 - y0))),
        (*_SEEN, "rounding"),
    ),
    (
        "float32-structure",
        "B passes through single precision",
        implicit(_single_structure, jacobian=jacobian),
        ("casimir", "midpoint", "reference"),
    ),
    (
        "off-skew",
        "B is off skew by 1e-9",
        implicit(_off_skew),
        ("energy", "casimir", "midpoint", "reference", "reduction", "equivariance", "rounding"),
    ),
    (
        "short-nodes",
        "the quadrature's nodes have eight digits",
        implicit(_short_nodes),
        ("energy", "reference", "reduction"),
    ),
    (
        "differenced-gradient",
        "∇H is formed from differences of H",
        implicit(_differences),
        ("energy", "symmetry", "reference", "reduction"),
    ),
    (
        "large-constant",
        "1e4 is added to y1 and taken away",
        around(_after(lambda _, y1: (y1 + 1e4) - 1e4)),
        ("identity", *_SEEN, "equivariance", "rounding"),
    ),
    (
        "short-step-shortcut",
        "∇H is not averaged where y moves by less than 1e-4 of its size",
        implicit(_shortcut),
        ("energy", "midpoint", "symmetry", "reference"),
    ),
    (
        "off-at-huge-states",
        "y1 has a relative error of 1e-10 where |y| exceeds 1e40",
        around(_after(lambda y0, y1: np.where(np.max(np.abs(y0), axis=0) > 1e40, y1 * (1 + 1e-10), y1))),
        ("reference",),
    ),
    (
        "one-signed-nudge",
        "in one step of twenty a component is moved by one ulp to where H is larger",
        around(_nudged),
        ("rounding",),
    ),
    ("toward-zero", "the last addition is rounded toward zero", around(_toward_zero), ("rounding",)),
)

SABOTEURS = tuple(Saboteur(name, "arithmetic", broken, make, laws) for name, broken, make, laws in _TABLE)
