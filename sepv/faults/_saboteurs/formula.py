"""Faults of the formula: B or ∇H at the wrong place, another scheme, or the right one with a wrong claim."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sepv import schemes
from sepv.faults._saboteurs.record import Family, claiming, explicit, explicit_step, middle
from sepv.problem import Array, Problem, vector_field
from sepv.problem._fields import matvec
from sepv.record import gauss_legendre
from sepv.schemes import _one_step as one_step
from sepv.schemes import energy_preserving as original
from sepv.schemes._discrete_gradient import coordinate_increments, symmetrised
from sepv.schemes._energy_preserving import formula
from sepv.schemes._scheme import Step
from sepv.solve import Fields

SABOTEURS = Family("formula")
_LOCAL = ("local-mean", "local-mean-square", "local-weak")
_WRONG_LIMIT = ("expansion", *_LOCAL, "mean-square-order", "right-limit", "weak-order")
_TURNED = ("casimir", "midpoint", "symmetry", "reference")
_NODES = ("energy", "reference", "reduction")
_EXPLICIT = ("energy", *_TURNED, "reduction", "rounding")


@SABOTEURS.formula("B is taken at y0 and not at the midpoint", _TURNED + _WRONG_LIMIT)
def b_at_y0(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return step[0] * matvec(fields.structure(y), fields.mean_gradient(y, z))


@SABOTEURS.formula("B is taken at y1 and not at the midpoint", _TURNED + _WRONG_LIMIT)
def b_at_y1(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return step[0] * matvec(fields.structure(y + z), fields.mean_gradient(y, z))


@SABOTEURS.formula(
    "B is the average of B(y0) and B(y1): right only where B is linear", ("casimir", "midpoint", "reference")
)
def linear_b_only(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return step[0] * matvec(0.5 * (fields.structure(y) + fields.structure(y + z)), fields.mean_gradient(y, z))


@SABOTEURS.formula("B is taken at an explicitly predicted midpoint: right only where B is constant", _TURNED)
def constant_b_only(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    predicted = y + 0.5 * step[0] * fields.field(y)
    return step[0] * matvec(fields.structure(predicted), fields.mean_gradient(y, z))


@SABOTEURS.formula("B is transposed", ("midpoint", "reference", "reduction", *_WRONG_LIMIT))
def b_transposed(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return -formula(fields, y, z, step)


@SABOTEURS.formula("B is doubled", ("midpoint", "reference", "reduction", *_WRONG_LIMIT))
def b_doubled(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return 2 * formula(fields, y, z, step)


@SABOTEURS.formula("∇H is taken at the midpoint and not averaged", (*_NODES, "rounding"))
def one_point_quadrature(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return step[0] * fields.field(middle(y, z))


@SABOTEURS.formula("∇H is averaged over the two ends: right only where H is quadratic", (*_NODES, "rounding"))
def quadratic_h_only(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return with_average(fields, y, z, step, 0.5 * (fields.gradient(y) + fields.gradient(y + z)))


def with_average(fields: Fields, y: Any, z: Any, step: Any, average: Any) -> Any:
    """Δ B(ȳ) times something in the place of the averaged gradient."""
    return step[0] * matvec(fields.structure(middle(y, z)), average)


def quadrature(fields: Fields, y: Any, z: Any, nodes: int, digits: int = 17) -> Any:
    """The averaged gradient by so many Gauss nodes, written with so many digits."""
    points, weights = gauss_legendre(nodes)
    terms = [
        w * fields.gradient(y + round(float(t), digits) * z) for t, w in zip(points, weights, strict=True)
    ]
    return np.sum(terms, axis=0)


@SABOTEURS.formula("two quadrature nodes for every polynomial: right only up to degree 4", _NODES)
def degree_four_only(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    if fields.problem.degree is None:
        return formula(fields, y, z, step)
    return with_average(fields, y, z, step, quadrature(fields, y, z, 2))


@SABOTEURS.formula("the quadrature has one node less than the degree of H needs", _NODES)
def one_node_short(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    if fields.problem.degree is None:
        return formula(fields, y, z, step)
    nodes = max(1, -(-fields.problem.degree // 2) - 1)
    return with_average(fields, y, z, step, quadrature(fields, y, z, nodes))


@SABOTEURS.formula("four quadrature nodes for every H: right only up to degree 8", ("energy",))
def four_nodes(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    if fields.problem.mean_gradient is not None:
        return formula(fields, y, z, step)
    return with_average(fields, y, z, step, quadrature(fields, y, z, 4))


@SABOTEURS.formula(
    "one quadrature node where H has degree three, and as many as it takes elsewhere", ("energy", "reference")
)
def cubic_as_quadratic(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return (one_point_quadrature if fields.problem.degree == 3 else formula)(fields, y, z, step)


@SABOTEURS.formula("∇H is taken at y0", (*_NODES, "midpoint", "symmetry", "rounding", *_WRONG_LIMIT))
def gradient_at_y0(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return with_average(fields, y, z, step, fields.gradient(y))


@SABOTEURS.formula(
    "coordinate increments in one order instead of the averaged gradient",
    ("midpoint", "symmetry", "reference", "reduction", "expansion", "equivariance"),
)
def asymmetric_gradient(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return with_average(fields, y, z, step, coordinate_increments(fields, y, z))


@SABOTEURS.formula(
    "symmetrised coordinate increments instead of the averaged gradient",
    ("reference", "reduction", "equivariance"),
)
def symmetrised_gradient(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return with_average(fields, y, z, step, symmetrised(fields, y, z))


@SABOTEURS.formula(
    "a term 1e-9 Δ² y is added, which linear changes of coordinates keep and translations do not",
    ("energy", "casimir", "midpoint", "reference", "reduction", "equivariance"),
)
def term_in_y(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return formula(fields, y, z, step) + 1e-9 * step[0] ** 2 * middle(y, z)


@SABOTEURS.formula("B is taken at y0 unless d = 2", _TURNED + _WRONG_LIMIT)
def two_dimensions_only(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return (formula if fields.problem.dimension == 2 else b_at_y0)(fields, y, z, step)


@SABOTEURS.formula(
    "the product B∇̄H stops at the third component",
    ("energy", "midpoint", "reference", "expansion", "equivariance"),
)
def three_components_only(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    B, g = fields.structure(middle(y, z)), fields.mean_gradient(y, z)
    return step[0] * matvec(B[:, :3], g[:3])


@SABOTEURS.around("every step is made as two half steps", ("midpoint", "reference", "reduction"))
def two_half_steps(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return step(problem, step(problem, y, h / 2, dW / 2), h / 2, dW / 2)


@SABOTEURS.made("Heun's explicit method with the random step", _EXPLICIT, explicit)
def explicit_heun(problem: Problem, y0: Array, step: Array) -> Array:
    f0 = vector_field(problem, y0)
    return y0 + 0.5 * step[0] * (f0 + vector_field(problem, y0 + step[0] * f0))


@SABOTEURS.made("the classical Runge-Kutta method with the random step", _EXPLICIT, explicit)
def runge_kutta(problem: Problem, y0: Array, step: Array) -> Array:
    delta = step[0]
    k1 = vector_field(problem, y0)
    k2 = vector_field(problem, y0 + 0.5 * delta * k1)
    k3 = vector_field(problem, y0 + 0.5 * delta * k2)
    k4 = vector_field(problem, y0 + delta * k3)
    return y0 + delta / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _projected(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Any step, then Newton's method along ∇H back to the energy it started from."""
    y1 = step(problem, y, h, dW)
    for _ in range(6):
        g, gap = problem.gradient(y1), problem.hamiltonian(y1) - problem.hamiltonian(y)
        size = np.sum(g * g, axis=0)
        y1 = y1 - g * np.where(size > 0, gap / np.where(size > 0, size, 1.0), 0.0)
    return y1


def _euler(problem: Problem, y0: Array, step: Array) -> Array:
    return y0 + step[0] * vector_field(problem, y0)


SABOTEURS.rows(
    ("heun-projected", "Heun's method, then a projection on H",
     lambda: claiming(partial(_projected, explicit_step(explicit_heun))), (*_TURNED, "equivariance")),
    ("midpoint-projected", "the midpoint rule, then a projection on H",
     lambda: claiming(partial(_projected, one_step.implicit(one_point_quadrature))),
     ("casimir", "symmetry", "reference", "equivariance")),
    ("ito-limit", "Euler's method, which converges to the Itô solution, claims order ½",
     lambda: replace(explicit(_euler)(), claims=("contract",), mean_square_order=0.5, weak_order=None),
     ("local-mean", "right-limit", "mean-square-order")),
    ("half-claimed-as-one", "the Euler-Maruyama scheme, of order ½, claims order 1",
     lambda: replace(schemes.euler_maruyama, mean_square_order=1.0), ("local-mean-square", "mean-square-order")),
    ("one-claimed-as-two", "(2.1), of order 1, claims order 2", lambda: replace(original, mean_square_order=2.0),
     ("truncation", "local-mean", "local-mean-square", "mean-square-order")),
    ("weak-one-claimed-as-two", "(2.1), of weak order 1, claims weak order 2",
     lambda: replace(original, weak_order=2.0), ("local-weak", "weak-order")),
)  # fmt: skip
