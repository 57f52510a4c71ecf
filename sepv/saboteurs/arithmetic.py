"""Faults of the arithmetic: the formula is right, and digits are lost on the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sepv.fields import matvec
from sepv.problem import Array, Problem
from sepv.saboteurs.formula import quadrature
from sepv.saboteurs.record import Saboteur, around, implicit, mean, middle, random_step, right_side
from sepv.scheme import Step
from sepv.schemes.energy_preserving import jacobian

_SEEN = ("energy", "casimir", "midpoint", "symmetry", "reference")


def _after(change: Callable[[Array, Array], Array]) -> Callable[[Step], Step]:
    """The right step, and then change(y0, y1)."""
    return lambda step: lambda problem, y, h, dW: change(y, step(problem, y, h, dW))


def _single(values: Array) -> Array:
    return values.astype(np.float32).astype(np.float64)


def _single_structure(problem: Problem, y0: Array, y1: Array, step: Array) -> Array:
    return step[0] * matvec(_single(problem.structure(middle(y0, y1))), mean(problem, y0, y1))


def _off_skew(problem: Problem, y0: Array, y1: Array, step: Array) -> Array:
    return right_side(problem, y0, y1, step) + 1e-9 * step[0] * mean(problem, y0, y1)


def _short_nodes(problem: Problem, y0: Array, y1: Array, step: Array) -> Array:
    if problem.degree is None:
        return right_side(problem, y0, y1, step)
    average = quadrature(problem, y0, y1, max(1, -(-problem.degree // 2)), digits=8)
    return step[0] * matvec(problem.structure(middle(y0, y1)), average)


def _differences(problem: Problem, y0: Array, y1: Array, step: Array) -> Array:
    def gradient(y: Array) -> Array:
        # Wide enough that the noise of the differences stays below what the solver takes for rounding.
        width = 1e-3 * np.eye(problem.dimension).reshape(problem.dimension, -1, *(1,) * (y.ndim - 1))
        H = problem.hamiltonian
        return np.stack([(H(y + e) - H(y - e)) / 2e-3 for e in width])

    return right_side(replace(problem, gradient=gradient, check=False), y0, y1, step)


def _shortcut(problem: Problem, y0: Array, y1: Array, step: Array) -> Array:
    short = np.max(np.abs(y1 - y0), axis=0) < 1e-4 * np.max(np.abs(y0), axis=0)
    average = np.where(short, problem.gradient(y0), mean(problem, y0, y1))
    return step[0] * matvec(problem.structure(middle(y0, y1)), average)


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
        implicit(lambda problem, y0, y1, step: (1 + 1e-10) * right_side(problem, y0, y1, step)),
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
