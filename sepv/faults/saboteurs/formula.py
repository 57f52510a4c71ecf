"""Faults of the formula: B or ∇H at the wrong place, another scheme's formula, or (2.1)
with a wrong claim.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sepv import schemes
from sepv.core.formula import Fields, Formula
from sepv.problem import Array, Problem, matvec, vector_field
from sepv.record import gauss_legendre
from sepv.schemes import LOCAL_LAWS, Step, coordinate_increments, itoh_abe_formula
from sepv.schemes import energy_preserving as original
from sepv.schemes import energy_preserving_formula as formula

from .record import Family, claiming, explicit, explicit_step, implicit, middle

# A function (fields, y, z) -> B or an averaged gradient.
Part = Callable[[Fields, Any, Any], Any]

FAMILY = Family("formula")
_WRONG_LIMIT = ("expansion", *LOCAL_LAWS, "mean-square-order", "right-limit", "weak-order")
_WRONG_B_LAWS = ("casimir", "midpoint", "symmetry", "reference")
_QUADRATURE_LAWS = ("energy", "reference", "reduction")
_EXPLICIT = ("energy", *_WRONG_B_LAWS, "reduction", "rounding")


def with_structure(structure: Part) -> Formula:
    """The right side of (2.1) with the matrix structure(fields, y, z) in place of B(y + z/2),
    where z = y1 − y.
    """
    return lambda fields, y, z, step: step[0] * matvec(structure(fields, y, z), fields.mean_gradient(y, z))


def with_average(average: Part) -> Formula:
    """The right side of (2.1) with the vector average(fields, y, z) in place of ∫∇H,
    where z = y1 − y.
    """
    return lambda fields, y, z, step: step[0] * matvec(fields.structure(middle(y, z)), average(fields, y, z))


def quadrature(nodes: Callable[[Problem], int | None], digits: int = 17) -> Formula:
    """The right side of (2.1) with ∫∇H by nodes(problem) Gauss nodes rounded to `digits`,
    exact ∫∇H for None.
    """

    def average(fields: Fields, y: Any, z: Any) -> Any:
        count = nodes(fields.problem)
        if count is None:
            return fields.mean_gradient(y, z)
        points, weights = gauss_legendre(count)
        rounded = [round(float(t), digits) for t in points]
        terms = [w * fields.gradient(y + t * z) for t, w in zip(rounded, weights, strict=True)]
        return np.sum(terms, axis=0)

    return with_average(average)


def of_degree(nodes: Callable[[int], int]) -> Callable[[Problem], int | None]:
    """Make a function that gives a problem's number of quadrature nodes by the degree of H;
    None if H has none.
    """
    return lambda problem: None if problem.degree is None else max(1, nodes(problem.degree))


b_at_y0 = with_structure(lambda fields, y, _z: fields.structure(y))


def one_point_quadrature(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    """The midpoint rule, y1 − y0 = Δ f(ȳ) with ȳ = (y0 + y1)/2."""
    return step[0] * fields.field(middle(y, z))


def _constant_b_only(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    predicted = y + 0.5 * step[0] * fields.field(y)
    return step[0] * matvec(fields.structure(predicted), fields.mean_gradient(y, z))


def _first(y: Any, count: int) -> Any:
    """The array (d, 1, ...) of ones for the first `count` components and zeros for the others,
    to multiply y by.
    """
    return (np.arange(len(y)) < count).reshape(-1, *(1,) * (np.ndim(y) - 1))


def _constant(fields: Fields, y: Any) -> Any:
    return fields.problem.hamiltonian(np.zeros_like(y))


def _block_by_block(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    B = fields.structure(middle(y, z))
    before = np.logical_and.accumulate(np.any(B != 0, axis=1), axis=0)
    return step[0] * matvec(B, fields.mean_gradient(y, z)) * before


def _three_components_only(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    B, g = fields.structure(middle(y, z)), fields.mean_gradient(y, z)
    return step[0] * matvec(B[:, :3], g[:3])


FAMILY.rows(
    ("b-at-y0", "B is taken at y0 and not at the midpoint", _WRONG_B_LAWS + _WRONG_LIMIT, b_at_y0),
    ("b-at-y1", "B is taken at y1 and not at the midpoint", _WRONG_B_LAWS + _WRONG_LIMIT,
     with_structure(lambda fields, y, z: fields.structure(y + z))),
    ("linear-b-only", "B is the average of B(y0) and B(y1): right only where B is linear",
     ("casimir", "midpoint", "reference"),
     with_structure(lambda fields, y, z: 0.5 * (fields.structure(y) + fields.structure(y + z)))),
    ("constant-b-only", "B is taken at an explicitly predicted midpoint: right only where B is constant", _WRONG_B_LAWS,
     _constant_b_only),
    ("b-transposed", "B is transposed", ("midpoint", "reference", "reduction", *_WRONG_LIMIT),
     lambda fields, y, z, step: -formula(fields, y, z, step)),
    ("b-doubled", "B is doubled", ("midpoint", "reference", "reduction", *_WRONG_LIMIT),
     lambda fields, y, z, step: 2 * formula(fields, y, z, step)),
    ("one-point-quadrature", "∇H is taken at the midpoint and not averaged", (*_QUADRATURE_LAWS, "rounding"),
     one_point_quadrature),
    ("quadratic-h-only", "∇H is averaged over the two ends: right only where H is quadratic",
        (*_QUADRATURE_LAWS, "rounding"),
     with_average(lambda fields, y, z: 0.5 * (fields.gradient(y) + fields.gradient(y + z)))),
    ("degree-four-only", "two quadrature nodes for every polynomial: right only up to degree 4", _QUADRATURE_LAWS,
     quadrature(of_degree(lambda _: 2))),
    ("one-node-short", "the quadrature has one node less than the degree of H needs", _QUADRATURE_LAWS,
     quadrature(of_degree(lambda degree: -(-degree // 2) - 1))),
    ("six-nodes", "no more than six quadrature nodes: right only up to degree 12", ("energy",),
     quadrature(of_degree(lambda degree: min(6, -(-degree // 2))))),
    ("four-nodes", "four quadrature nodes for every H: right only up to degree 8", ("energy",),
     quadrature(lambda problem: 4 if problem.mean_gradient is None else None)),
    ("cubic-as-quadratic", "one quadrature node where H has degree three, and as many as it takes elsewhere",
     ("energy", "reference"),
     lambda fields, *more: (one_point_quadrature if fields.problem.degree == 3 else formula)(fields, *more)),
    ("gradient-at-y0", "∇H is taken at y0",
     (*_QUADRATURE_LAWS, "midpoint", "symmetry", "reversibility", "rounding", *_WRONG_LIMIT),
     with_average(lambda fields, y, _z: fields.gradient(y))),
    ("asymmetric-gradient", "coordinate increments in one order instead of the averaged gradient",
     ("midpoint", "symmetry", "reference", "reduction", "expansion", "equivariance"),
     with_average(coordinate_increments)),
    ("symmetrised-gradient", "symmetrised coordinate increments instead of the averaged gradient",
     ("reference", "reduction", "equivariance"), itoh_abe_formula),
    ("term-in-y", "a term 1e-9 Δ² y is added, which linear changes of coordinates keep and translations do not",
     ("energy", "casimir", "midpoint", "reference", "reduction", "equivariance"),
     lambda fields, y, z, step: formula(fields, y, z, step) + 1e-9 * step[0] ** 2 * middle(y, z)),
    ("two-dimensions-only", "B is taken at y0 unless d = 2", _WRONG_B_LAWS + _WRONG_LIMIT,
     lambda fields, *more: (formula if fields.problem.dimension == 2 else b_at_y0)(fields, *more)),
    ("sixteen-components-only", "components beyond the sixteenth do not move",
     ("midpoint", "reference", "reduction", "equivariance"),
     lambda fields, y, z, step: formula(fields, y, z, step) * _first(y, 16)),
    ("block-by-block", "rows of B after one of zeros count as zero", ("midpoint", "reference", "reduction"),
     _block_by_block),
    ("zero-of-energy", "the step depends on the constant in H by 1e-6 of it", ("midpoint", "reference", "reduction"),
     lambda fields, y, z, step: formula(fields, y, z, step) * (1 + 1e-6 * np.tanh(_constant(fields, y)))),
    ("three-components-only", "the product B∇̄H stops at the third component",
     ("energy", "midpoint", "reference", "expansion", "equivariance"), _three_components_only),
    by=implicit,
)  # fmt: skip


@FAMILY.around("every step is made as two half steps", ("midpoint", "reference", "reduction"))
def two_half_steps(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return step(problem, step(problem, y, h / 2, dW / 2), h / 2, dW / 2)


@FAMILY.made("Heun's explicit method with the random step", _EXPLICIT, explicit)
def explicit_heun(problem: Problem, y0: Array, step: Array) -> Array:
    f0 = vector_field(problem, y0)
    return y0 + 0.5 * step[0] * (f0 + vector_field(problem, y0 + step[0] * f0))


@FAMILY.made("the classical Runge-Kutta method with the random step", _EXPLICIT, explicit)
def runge_kutta(problem: Problem, y0: Array, step: Array) -> Array:
    delta = step[0]
    k1 = vector_field(problem, y0)
    k2 = vector_field(problem, y0 + 0.5 * delta * k1)
    k3 = vector_field(problem, y0 + 0.5 * delta * k2)
    k4 = vector_field(problem, y0 + delta * k3)
    return y0 + delta / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _projected(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Take a step, then project y1 along ∇H to the energy level of y by six iterations of Newton's
    method.
    """
    y1 = step(problem, y, h, dW)
    for _ in range(6):
        g, gap = problem.gradient(y1), problem.hamiltonian(y1) - problem.hamiltonian(y)
        size = np.sum(g * g, axis=0)
        y1 = y1 - g * np.where(size > 0, gap / np.where(size > 0, size, 1.0), 0.0)
    return y1


def _euler(problem: Problem, y0: Array, step: Array) -> Array:
    return y0 + step[0] * vector_field(problem, y0)


FAMILY.rows(
    ("heun-projected", "Heun's method, then a projection on H", (*_WRONG_B_LAWS, "equivariance"),
     lambda: claiming(partial(_projected, explicit_step(explicit_heun)))),
    ("midpoint-projected", "the midpoint rule, then a projection on H",
     ("casimir", "symmetry", "reference", "equivariance"),
     lambda: claiming(partial(_projected, schemes.implicit(one_point_quadrature)))),
    ("ito-limit", "Euler's method, which converges to the Itô solution, claims order ½",
     ("local-mean", "right-limit", "mean-square-order"),
     lambda: replace(explicit(_euler)(), claims=("contract",), mean_square_order=0.5, weak_order=None)),
    ("half-claimed-as-one", "the Euler-Maruyama scheme, of order ½, claims order 1",
     ("local-mean-square", "mean-square-order"),
     lambda: replace(schemes.euler_maruyama, mean_square_order=1.0)),
    ("one-claimed-as-two", "(2.1), of order 1, claims order 2",
     ("truncation", "local-mean", "local-mean-square", "mean-square-order"),
     lambda: replace(original, mean_square_order=2.0)),
    ("weak-one-claimed-as-two", "(2.1), of weak order 1, claims weak order 2", ("local-weak", "weak-order"),
     lambda: replace(original, weak_order=2.0)),
)  # fmt: skip
