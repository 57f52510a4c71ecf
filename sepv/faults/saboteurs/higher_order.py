"""Faults of schemes beyond the paper: several stages, quadrature, truncation,
more than one invariant.

Each saboteur claims what the scheme that it imitates claims.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sepv import schemes
from sepv.core.formula import Fields, Formula
from sepv.errors import Skipped, StepFailure
from sepv.problem import Array, Problem, cross, each_noise, matvec, mechanics, vector_field
from sepv.schemes import (
    Explicit,
    PointLaw,
    Scheme,
    Step,
    as_lanes,
    composed_leapfrogs,
    exact_nodes,
    gauss_tableau,
    implicit,
    leapfrog,
    moments,
    weakly,
)

from .record import Family, explicit_step, imitating, middle

FAMILY = Family("higher order")
# Inside the contraction radius each correction is at most a quarter of the one before; 26 of them
# give 16 digits.
_ITERATIONS = 100
Tables = Callable[[int, int], tuple[Array, Array]]


def staged(stages: int, tables: Tables) -> Step:
    """A collocation step with this number of stages, by fixed-point iteration;
    `tables` gives quadrature weights.
    """

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y0, noise = as_lanes(problem, y, h, dW)
        delta, tableau = problem.random_step(h, noise), gauss_tableau(stages)
        # If H is not a polynomial, 24 nodes resolve it for the steps that laws take.
        nodes = 24 if problem.degree is None else exact_nodes(stages, problem.degree)
        W, P = tables(stages, nodes)
        z = np.zeros((y0.shape[0], stages, y0.shape[1]))
        for _ in range(_ITERATIONS):
            u, Y = (y0[:, None] + np.einsum("nj,djm->dnm", M, z) for M in (P, tableau.A))
            g = np.einsum("in,dnm->dim", W, problem.gradient(u))
            before, z = z, delta * matvec(problem.structure(Y), g)
            if not np.all(np.isfinite(z)):
                break
            if np.max(np.abs(z - before)) <= 2.0**-53 * np.max(np.abs(y0)):
                return (y0 + np.einsum("j,djm->dm", tableau.b, z)).reshape(np.shape(y))
        size = float(np.max(np.abs(z - before)))
        raise StepFailure(
            "no convergence", problem=problem.name, y=y0[:, 0], delta=float(delta[0]), residual=size,
            iterations=_ITERATIONS,
        )  # fmt: skip

    return step


def _staged(tables: Tables) -> Callable[[], Scheme]:
    return imitating(schemes.collocation(2), staged(2, tables), batched=False)


def _lagrange_weight(stages: int, nodes: int) -> tuple[Array, Array]:
    W, P = moments(stages, nodes)
    return W * (1 + 1e-6 * np.eye(stages)[:, :1]), P


FAMILY.rows(
    ("lagrange-weight", "the first Lagrange weight of two stages is too large by 1e-6",
     ("midpoint", "reference", "expansion"), _lagrange_weight),
    ("stages-one-node-short", "the averages of two stages have one node less than the degree of H needs",
     ("energy", "reference"), lambda stages, nodes: moments(stages, max(1, nodes - 1))),
    by=_staged,
)  # fmt: skip
FAMILY.rows(
    ("three-stages-k-2", "increments of a scheme of order 3 are truncated with the paper's k = 2",
     ("truncation", "local-mean-square"),  # clipping is no error of the stages
     lambda: replace(schemes.collocation(3), truncation=2)),
)  # fmt: skip


def _as_both(step: Step) -> Step:
    """Make a step refuse problems without a known Casimir, as `both-invariants` does."""

    def restricted(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        if problem.nambu is None:
            raise Skipped(f"no Casimir of {problem.name} is known")
        return step(problem, y, h, dW)

    return restricted


FAMILY.rows(
    ("casimir-at-midpoint", "∇C is taken at the midpoint and not averaged: (2.1), which keeps quadratic Casimirs only",
     ("invariant:casimir", "reference"),
     imitating(schemes.both_invariants, _as_both(schemes.energy_preserving.step), batched=False)),
)  # fmt: skip


@FAMILY.made(
    "g is taken at y0: both invariants are kept, but the scheme is not symmetric",
    ("symmetry", "expansion", "reference", "midpoint"),
    lambda R: imitating(schemes.both_invariants, _as_both(implicit(R))),
)
def factor_at_start(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    """The right side Δ g(y0) (∇̄H × ∇̄C), where f = g ∇H × ∇C: as g is taken at y0,
    the step is not symmetric.
    """
    return step[0] * fields.factor(y) * cross(fields.mean_gradient(y, z), fields.mean_casimir_gradient(y, z))


def _of_structures(formula: Formula) -> Callable[[], Scheme]:
    return imitating(schemes.several_structures, implicit(formula, parts=each_noise))


@FAMILY.made(
    "the G_j are taken at y0: the energy is kept, and the limit is the Itô one",
    (
        *("casimir", "symmetry", "expansion", "reference", "local-mean", "local-mean-square", "local-weak"),
        *("mean-square-order", "right-limit"),
    ),
    _of_structures,
)
def structures_at_start(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    """The right side [h B(ȳ) + Σ c_j ΔW_j G_j(y0)] ∇̄H, whose noise structures G_j are taken at y0,
    not at ȳ.
    """
    drift = step[0] * fields.structure(middle(y, z))
    structures = fields.problem.structures[1:]
    noise = sum(part * G(y) for part, G in zip(step[1:], structures, strict=True))
    return matvec(drift + noise, fields.mean_gradient(y, z))


@FAMILY.made(
    "the first noise is given to the last G_j, and the last one to the first",
    ("noise-sum", "expansion", "reference"),
    _of_structures,
)
def structures_exchanged(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    rows = [0, len(step) - 1, *range(2, len(step) - 1), 1] if len(step) > 2 else range(len(step))
    return matvec(fields.combined(middle(y, z), step[list(rows)]), fields.mean_gradient(y, z))


@FAMILY.made(
    "with several Hamiltonians it rests where ∇H_0 = 0, though a noise moves the solution",
    ("reference",),
    _of_structures,
)
def rests_where_undefined(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    """Take 0 for a noise structure S_j that is undefined because ∇H_0 = 0: y1 = y0,
    although B∇H_j ≠ 0.
    """
    return matvec(np.nan_to_num(fields.combined(middle(y, z), step)), fields.mean_gradient(y, z))


_YOSHIDA_3_DIGITS = 1.351
FAMILY.rows(
    ("triple-jump-in-digits", "the triple jump's 1/(2 − 2^(1/3)) = 1.35120719… is written with four digits: order 2",
     ("deterministic-order",),
     imitating(schemes.by_name("yoshida-4"), Explicit(composed_leapfrogs((_YOSHIDA_3_DIGITS,
         1 - 2 * _YOSHIDA_3_DIGITS, _YOSHIDA_3_DIGITS))))),
)  # fmt: skip


def _classical(outer: float, inner: float, problem: Problem, y0: Array, delta: Array) -> Array:
    """The classical Runge-Kutta method with the weights `outer`, `inner`, `inner`,
    `outer` of its stages.
    """
    k1 = vector_field(problem, y0)
    k2 = vector_field(problem, y0 + 0.5 * delta * k1)
    k3 = vector_field(problem, y0 + 0.5 * delta * k2)
    k4 = vector_field(problem, y0 + delta * k3)
    return np.asarray(y0 + delta * (outer * (k1 + k4) + inner * (k2 + k3)))


def _weighted(outer: float, inner: float) -> Callable[[], Scheme]:
    step = explicit_step(partial(_classical, outer, inner))
    return lambda: Scheme("classical", step, order=4.0, batched=True)


FAMILY.rows(
    ("runge-kutta-in-digits", "the classical method's weights 1/6 and 1/3 are written with five digits: order 2",
     ("deterministic-order",), _weighted(0.16667, 0.33333)),
    ("weights-beyond-one", "the classical method's weights add to 1 + 1e-9: order 0",
     ("deterministic-order",), _weighted((1 + 1e-9) / 6, (1 + 1e-9) / 3)),
)  # fmt: skip


@FAMILY.like(
    leapfrog,
    "the second kick of the leapfrog has the force of the first: order 1, neither symmetric nor symplectic",
    ("deterministic-order", "symmetry", "poisson-map:constant", "long-time-energy"),
)
def force_of_first_kick(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """The leapfrog p + ½ΔF(q), q + ΔM⁻¹p, p + ½ΔF(q), with the force at the old q in the second
    kick too.
    """
    system, (state, noise) = mechanics(problem), as_lanes(problem, y, h, dW)
    delta = problem.random_step(h, noise)
    q, p = system.split(state)
    kick = 0.5 * delta * system.force(q)
    return system.join(q + delta * system.velocity(p + kick), p + kick + kick).reshape(np.shape(y))


def _with(increments: str | PointLaw) -> Callable[[], Scheme]:
    """Make a function that returns modified-weak-2, of weak order 2,
    with these increments and not three-point ones.
    """
    return lambda: weakly(schemes.modified_weak_two, increments)


def _three(probability: float, size: float) -> Callable[[], Scheme]:
    law = PointLaw("three-point", (-size, 0.0, size), (probability, 1 - 2 * probability, probability))
    return _with(law)


_WEAK = ("local-weak", "weak-order")
FAMILY.rows(
    ("two-points-for-three",
     "increments of two points are taken where weak order 2 needs three: E ΔW⁴ is h² and not 3h²",
     _WEAK, _with("two-point")),
    ("three-points-too-likely", "the outer points ±√(3h) have probability 1/5 and not 1/6: E ΔW² is 1.2 h",
     _WEAK, _three(1 / 5, math.sqrt(3.0))),
    ("three-points-second-moment-only", "±√(2h) with probability ¼: E ΔW² is h, E ΔW⁴ is 2h² and not 3h²",
     _WEAK, _three(1 / 4, math.sqrt(2.0))),
)  # fmt: skip
