"""Faults of the formula: B or ∇H at the wrong place, another scheme, or the right one with a wrong claim."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from sepv import schemes
from sepv.faults._saboteurs.record import Saboteur, around, explicit, explicit_step, implicit, middle
from sepv.problem import Array, Problem, vector_field
from sepv.problem._fields import matvec
from sepv.record import gauss_legendre
from sepv.schemes import Scheme
from sepv.schemes import _one_step as one_step
from sepv.schemes import energy_preserving as original
from sepv.schemes._discrete_gradient import coordinate_increments, symmetrised
from sepv.schemes._energy_preserving import formula
from sepv.schemes._scheme import Step
from sepv.solve import Fields

_LOCAL = ("local-mean", "local-mean-square", "local-weak")
_WRONG_LIMIT = ("expansion", *_LOCAL, "mean-square-order", "right-limit", "weak-order")


def _b_at_y0(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return step[0] * matvec(fields.structure(y), fields.mean_gradient(y, z))


def _b_at_y1(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return step[0] * matvec(fields.structure(y + z), fields.mean_gradient(y, z))


def _b_averaged(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return step[0] * matvec(0.5 * (fields.structure(y) + fields.structure(y + z)), fields.mean_gradient(y, z))


def _b_predicted(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    predicted = y + 0.5 * step[0] * fields.field(y)
    return step[0] * matvec(fields.structure(predicted), fields.mean_gradient(y, z))


def _one_point(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return step[0] * fields.field(middle(y, z))


def _trapezoid(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    ends = 0.5 * (fields.gradient(y) + fields.gradient(y + z))
    return step[0] * matvec(fields.structure(middle(y, z)), ends)


def _gradient_at_y0(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return step[0] * matvec(fields.structure(middle(y, z)), fields.gradient(y))


def quadrature(fields: Fields, y: Any, z: Any, nodes: int, digits: int = 17) -> Any:
    """The averaged gradient by so many Gauss nodes, written with so many digits."""
    points, weights = gauss_legendre(nodes)
    terms = [
        w * fields.gradient(y + round(float(t), digits) * z) for t, w in zip(points, weights, strict=True)
    ]
    return np.sum(terms, axis=0)


def _one_node_short(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    if fields.problem.degree is None:
        return formula(fields, y, z, step)
    nodes = max(1, -(-fields.problem.degree // 2) - 1)
    return step[0] * matvec(fields.structure(middle(y, z)), quadrature(fields, y, z, nodes))


def _two_nodes(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    if fields.problem.degree is None:
        return formula(fields, y, z, step)
    return step[0] * matvec(fields.structure(middle(y, z)), quadrature(fields, y, z, 2))


def _four_nodes(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    if fields.problem.mean_gradient is not None:
        return formula(fields, y, z, step)
    return step[0] * matvec(fields.structure(middle(y, z)), quadrature(fields, y, z, 4))


def _cubic_as_quadratic(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return (_one_point if fields.problem.degree == 3 else formula)(fields, y, z, step)


def _asymmetric(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return step[0] * matvec(fields.structure(middle(y, z)), coordinate_increments(fields, y, z))


def _symmetrised(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return step[0] * matvec(fields.structure(middle(y, z)), symmetrised(fields, y, z))


def _term_in_y(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return formula(fields, y, z, step) + 1e-9 * step[0] ** 2 * middle(y, z)


def _two_dimensions_only(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return (formula if fields.problem.dimension == 2 else _b_at_y0)(fields, y, z, step)


def _three_components(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    B, g = fields.structure(middle(y, z)), fields.mean_gradient(y, z)
    return step[0] * matvec(B[:, :3], g[:3])


def _heun(problem: Problem, y0: Array, step: Array) -> Array:
    f0 = vector_field(problem, y0)
    return y0 + 0.5 * step[0] * (f0 + vector_field(problem, y0 + step[0] * f0))


def _runge_kutta(problem: Problem, y0: Array, step: Array) -> Array:
    delta = step[0]
    k1 = vector_field(problem, y0)
    k2 = vector_field(problem, y0 + 0.5 * delta * k1)
    k3 = vector_field(problem, y0 + 0.5 * delta * k2)
    k4 = vector_field(problem, y0 + delta * k3)
    return y0 + delta / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _projected(step: Step) -> Step:
    """Any step, then Newton's method along ∇H back to the energy it started from."""

    def projected(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y1 = step(problem, y, h, dW)
        for _ in range(6):
            g, gap = problem.gradient(y1), problem.hamiltonian(y1) - problem.hamiltonian(y)
            size = np.sum(g * g, axis=0)
            y1 = y1 - g * np.where(size > 0, gap / np.where(size > 0, size, 1.0), 0.0)
        return y1

    return projected


def _halved(step: Step) -> Step:
    return lambda problem, y, h, dW: step(problem, step(problem, y, h / 2, dW / 2), h / 2, dW / 2)


def _euler(problem: Problem, y0: Array, step: Array) -> Array:
    return y0 + step[0] * vector_field(problem, y0)


def _ito_limit() -> Scheme:
    return replace(explicit(_euler)(), claims=("contract",), mean_square_order=0.5, weak_order=None)


def _half_as_one() -> Scheme:
    return replace(schemes.euler_maruyama, mean_square_order=1.0)


def _one_as_two() -> Scheme:
    return replace(original, mean_square_order=2.0)


def _weak_one_as_two() -> Scheme:
    return replace(original, weak_order=2.0)


_TABLE = (
    (
        "b-at-y0",
        "B is taken at y0 and not at the midpoint",
        implicit(_b_at_y0),
        ("casimir", "midpoint", "symmetry", "reference", *_WRONG_LIMIT),
    ),
    (
        "b-at-y1",
        "B is taken at y1 and not at the midpoint",
        implicit(_b_at_y1),
        ("casimir", "midpoint", "symmetry", "reference", *_WRONG_LIMIT),
    ),
    (
        "linear-b-only",
        "B is the average of B(y0) and B(y1): right only where B is linear",
        implicit(_b_averaged),
        ("casimir", "midpoint", "reference"),
    ),
    (
        "constant-b-only",
        "B is taken at an explicitly predicted midpoint: right only where B is constant",
        implicit(_b_predicted),
        ("casimir", "midpoint", "symmetry", "reference"),
    ),
    (
        "b-transposed",
        "B is transposed",
        implicit(lambda fields, y, z, step: -formula(fields, y, z, step)),
        ("midpoint", "reference", "reduction", *_WRONG_LIMIT),
    ),
    (
        "b-doubled",
        "B is doubled",
        implicit(lambda fields, y, z, step: 2 * formula(fields, y, z, step)),
        ("midpoint", "reference", "reduction", *_WRONG_LIMIT),
    ),
    (
        "one-point-quadrature",
        "∇H is taken at the midpoint and not averaged",
        implicit(_one_point),
        ("energy", "reference", "reduction", "rounding"),
    ),
    (
        "quadratic-h-only",
        "∇H is averaged over the two ends: right only where H is quadratic",
        implicit(_trapezoid),
        ("energy", "reference", "reduction", "rounding"),
    ),
    (
        "degree-four-only",
        "two quadrature nodes for every polynomial: right only up to degree 4",
        implicit(_two_nodes),
        ("energy", "reference", "reduction"),
    ),
    (
        "one-node-short",
        "the quadrature has one node less than the degree of H needs",
        implicit(_one_node_short),
        ("energy", "reference", "reduction"),
    ),
    (
        "four-nodes",
        "four quadrature nodes for every H: right only up to degree 8",
        implicit(_four_nodes),
        ("energy",),
    ),
    (
        "cubic-as-quadratic",
        "one quadrature node where H has degree three, and as many as it takes elsewhere",
        implicit(_cubic_as_quadratic),
        ("energy", "reference"),
    ),
    (
        "gradient-at-y0",
        "∇H is taken at y0",
        implicit(_gradient_at_y0),
        ("energy", "midpoint", "symmetry", "reference", "reduction", "rounding", *_WRONG_LIMIT),
    ),
    (
        "asymmetric-gradient",
        "coordinate increments in one order instead of the averaged gradient",
        implicit(_asymmetric),
        ("midpoint", "symmetry", "reference", "reduction", "expansion", "equivariance"),
    ),
    (
        "symmetrised-gradient",
        "symmetrised coordinate increments instead of the averaged gradient",
        implicit(_symmetrised),
        ("reference", "reduction", "equivariance"),
    ),
    (
        "term-in-y",
        "a term 1e-9 Δ² y is added, which linear changes of coordinates keep and translations do not",
        implicit(_term_in_y),
        ("energy", "casimir", "midpoint", "reference", "reduction", "equivariance"),
    ),
    (
        "two-dimensions-only",
        "B is taken at y0 unless d = 2",
        implicit(_two_dimensions_only),
        ("casimir", "midpoint", "symmetry", "reference", *_WRONG_LIMIT),
    ),
    (
        "three-components-only",
        "the product B∇̄H stops at the third component",
        implicit(_three_components),
        ("energy", "midpoint", "reference", "expansion", "equivariance"),
    ),
    (
        "two-half-steps",
        "every step is made as two half steps",
        around(_halved),
        ("midpoint", "reference", "reduction"),
    ),
    (
        "explicit-heun",
        "Heun's explicit method with the random step",
        explicit(_heun),
        ("energy", "casimir", "midpoint", "symmetry", "reference", "reduction", "rounding"),
    ),
    (
        "runge-kutta",
        "the classical Runge-Kutta method with the random step",
        explicit(_runge_kutta),
        ("energy", "casimir", "midpoint", "symmetry", "reference", "reduction", "rounding"),
    ),
    (
        "heun-projected",
        "Heun's method, then a projection on H",
        around(lambda _: _projected(explicit_step(_heun))),
        ("casimir", "midpoint", "symmetry", "reference", "equivariance"),
    ),
    (
        "midpoint-projected",
        "the midpoint rule, then a projection on H",
        around(lambda _: _projected(one_step.implicit(_one_point))),
        ("casimir", "symmetry", "reference", "equivariance"),
    ),
    (
        "ito-limit",
        "Euler's method, which converges to the Itô solution, claims order ½",
        _ito_limit,
        ("local-mean", "right-limit", "mean-square-order"),
    ),
    (
        "half-claimed-as-one",
        "the Euler-Maruyama scheme, of order ½, claims order 1",
        _half_as_one,
        (
            "local-mean-square",
            "mean-square-order",
        ),
    ),
    (
        "one-claimed-as-two",
        "(2.1), of order 1, claims order 2",
        _one_as_two,
        ("truncation", "local-mean", "local-mean-square", "mean-square-order"),
    ),
    (
        "weak-one-claimed-as-two",
        "(2.1), of weak order 1, claims weak order 2",
        _weak_one_as_two,
        ("local-weak", "weak-order"),
    ),
)

SABOTEURS = tuple(Saboteur(name, "formula", broken, make, laws) for name, broken, make, laws in _TABLE)
