"""Faults of the arithmetic: the formula is right, but digits are lost in the computation."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from sepv.core.formula import Fields, counted
from sepv.problem import Array, Problem
from sepv.schemes import Step, random_step
from sepv.schemes import energy_preserving_formula as formula
from sepv.schemes import energy_preserving_jacobian as jacobian

from .formula import of_degree, quadrature, with_average, with_structure
from .record import Family, answering, implicit, middle, right_side

FAMILY = Family("arithmetic")
_ROUNDING_LAWS = ("energy", "casimir", "midpoint", "symmetry", "reference")


def _single(values: Array) -> Array:
    return values.astype(np.float32).astype(np.float64)


FAMILY.rows(
    ("relative-error-1e-10", "y1 has a relative error of 1e-10", ("identity", *_ROUNDING_LAWS, "rounding"),
     answering(lambda _, y1: y1 * (1 + 1e-10))),
    ("step-off-by-1e-10", "Δ has a relative error of 1e-10", ("midpoint", "reference", "reduction"),
     implicit(lambda fields, y, z, step: (1 + 1e-10) * formula(fields, y, z, step))),
    ("float32", "y1 passes through single precision", ("identity", *_ROUNDING_LAWS, "equivariance", "rounding"),
     answering(lambda _, y1: _single(y1))),
    ("float32-increment", "y1 − y0 passes through single precision", (*_ROUNDING_LAWS, "rounding"),
     answering(lambda y, y1: y + _single(y1 - y))),
    ("float32-structure", "B passes through single precision", ("casimir", "midpoint", "reference"),
     implicit(with_structure(lambda fields, y, z: _single(fields.structure(middle(y, z)))), jacobian=jacobian)),
    ("off-skew", "B is off skew by 1e-9",
     ("energy", "casimir", "midpoint", "reference", "reduction", "equivariance", "rounding"),
     implicit(lambda fields, y, z, step: formula(fields, y, z, step) + 1e-9 * step[0] * fields.mean_gradient(y, z))),
    ("short-nodes", "the quadrature's nodes have eight digits", ("energy", "reference", "reduction"),
     implicit(quadrature(of_degree(lambda degree: -(-degree // 2)), digits=8))),
)  # fmt: skip


@FAMILY.formula("∇H is formed from differences of H", ("energy", "symmetry", "reference", "reduction"))
def differenced_gradient(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    def gradient(y: Array) -> Array:
        # The width keeps the rounding noise of the differences below the rounding of the solver.
        d, H = fields.problem.dimension, fields.problem.hamiltonian
        width = 1e-3 * np.eye(d).reshape(d, -1, *(1,) * (y.ndim - 1))
        return np.stack([(H(y + e) - H(y - e)) / 2e-3 for e in width])

    changed = replace(fields.problem, gradient=gradient, check=False)
    return counted(formula, changed, y, y + z, step).value


def _shortcut(fields: Fields, y: Any, z: Any) -> Any:
    short = np.max(np.abs(z), axis=0) < 1e-4 * np.max(np.abs(y), axis=0)
    return np.where(short, fields.gradient(y), fields.mean_gradient(y, z))


FAMILY.rows(
    ("large-constant", "1e4 is added to y1 and taken away", ("identity", *_ROUNDING_LAWS, "equivariance", "rounding"),
     answering(lambda _, y1: (y1 + 1e4) - 1e4)),
    ("short-step-shortcut", "∇H is not averaged where y moves by less than 1e-4 of its size",
     ("energy", "midpoint", "symmetry", "reference"), implicit(with_average(_shortcut))),
    ("off-at-huge-states", "y1 has a relative error of 1e-10 where |y| exceeds 1e40", ("reference",),
     answering(lambda y, y1: np.where(np.max(np.abs(y), axis=0) > 1e40, y1 * (1 + 1e-10), y1))),
    ("squares-underflow", "|y|⁴ decides if a state moves, which is 0 for |y| < 1e-81", ("reference", "midpoint"),
     answering(lambda y, y1: np.where(np.sum(y**4, axis=0) > 0, y1, y))),
    ("still-near-rest", "a component does not move where it would by less than 1e-9 of |y|",
     ("reference", "midpoint"),
     answering(lambda y, y1: np.where(np.max(np.abs(y1 - y), axis=0) < 1e-9 * np.max(np.abs(y), axis=0), y, y1))),
)  # fmt: skip


@FAMILY.around("a step with |Δ| below 1e-12 is none", ("reference", "midpoint", "reduction"))
def short_step_is_none(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return np.where(np.abs(problem.random_step(h, dW)) < 1e-12, y, step(problem, y, h, dW))


@FAMILY.around("a step with |Δ| above 50 is made of two", ("reference", "midpoint", "reduction"))
def long_step_halved(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    halved = step(problem, step(problem, y, h / 2, dW / 2), h / 2, dW / 2)
    return np.where(np.abs(problem.random_step(h, dW)) > 50, halved, step(problem, y, h, dW))


@FAMILY.around("y1 − y0 is divided by Δ and multiplied again", ("contract",))
def divided_by_the_step(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    delta = problem.random_step(h, dW)
    with np.errstate(all="ignore"):
        return y + (step(problem, y, h, dW) - y) / delta * delta


@FAMILY.around("in one step of twenty a component is moved by one ulp to where H is larger", ("rounding",))
def one_signed_nudge(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Move one component of y1 by an ulp so that H grows, in one step of twenty,
    chosen by the last digits of y.
    """
    y1 = step(problem, y, h, dW)
    slope = problem.gradient(y1)
    gain = np.abs(slope) * np.spacing(np.abs(y1))
    largest = np.arange(len(y1)).reshape(-1, *(1,) * (y1.ndim - 1)) == np.argmax(gain, axis=0)
    digits = np.ascontiguousarray(y).view(np.uint64).sum(axis=0, dtype=np.uint64)
    chosen = largest & (digits % 20 == 0) & np.any(y1 != y, axis=0)
    return np.where(chosen, np.nextafter(y1, np.copysign(np.inf, slope)), y1)


@FAMILY.around("the last addition is rounded toward zero", ("rounding",))
def toward_zero(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Round the sum y1 = y0 + Δ B∇̄H, as in (2.1), toward zero and not to nearest."""
    move = right_side(problem, y, step(problem, y, h, dW), random_step(problem, h, dW))
    total = y + move
    # Knuth's two-sum: the exact rounding error of y + move.
    part = total - y
    lost = (y - (total - part)) + (move - part)
    return np.where(lost * total < 0, np.nextafter(total, 0.0), total)
