"""Faults of schemes that claim to keep the Poisson structure or the domain.

Each saboteur has the claims of the scheme that it imitates: the midpoint rule, which is symplectic,
or the splitting, whose step is a Poisson map and stays in the positive octant. One saboteur is
(2.1) with two false claims.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from sepv.core.formula import Fields
from sepv.problem import Array, Problem
from sepv.schemes import Scheme, energy_preserving, implicit, midpoint, splitting

from .record import Family, Update, explicit_step, imitating

FAMILY = Family("structure")


@FAMILY.made(
    "the midpoint rule at y0 + (½ + 2⁻¹²)(y1 − y0)",
    ("poisson-map:constant", "casimir", "midpoint", "symmetry"),
    lambda R: imitating(midpoint, implicit(R)),
)
def off_the_middle(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return step[0] * fields.field(y + (0.5 + 2.0**-12) * z)


FAMILY.rows(
    ("averaged-and-symplectic",
     "(2.1) claims to be symplectic and a Poisson map besides: it keeps H and quadratic Casimirs, and no structure",
     ("poisson-map:constant", "poisson-map"),
     lambda: replace(energy_preserving, claims={*energy_preserving.claims, "poisson-map:constant", "poisson-map"})),
)  # fmt: skip


def _split(problem: Problem, y: Array, delta: Array) -> Array:
    """A step of the splitting scheme, which composes exact flows,
    over the random steps `delta` = Δ (M,).
    """
    # With h = 0 and one noise of size 1, the random step is the given increment.
    return splitting.step(replace(problem, noise=(1.0,), check=False), y, 0.0, delta[None])


def _like_splitting(update: Update) -> Callable[[], Scheme]:
    return imitating(splitting, explicit_step(update))


@FAMILY.made(
    "the splitting takes a time that depends on y: all Casimirs and the octant are kept, the structure is not",
    ("poisson-map", "symmetry"),
    _like_splitting,
)
def time_of_place(problem: Problem, y: Array, step: Array) -> Array:
    """Take the splitting over the time Δ(1 + Δ⁴ y_1/64), which depends on y,
    so that the step is no Poisson map.
    """
    delta = step[0]
    return _split(problem, y, delta * (1 + delta**4 * y[0] / 64))


@FAMILY.made(
    "the first flow of the splitting is replaced by a step along its tangent",
    ("poisson-map", "positivity", "casimir", "invariant:casimir", "symmetry"),
    _like_splitting,
)
def tangent_of_first(problem: Problem, y: Array, step: Array) -> Array:
    """Replace the first exact flow of the splitting by an Euler step,
    which keeps only the flow's linear invariants.
    """
    if not problem.flows:
        return _split(problem, y, step[0])
    first, *others = problem.flows

    def tangent(y: Array, t: Array) -> Array:
        small = 2.0**-20
        return y + t * (first(y, small + 0 * t) - first(y, -small + 0 * t)) / (2 * small)

    return _split(replace(problem, flows=(tangent, *others), check=False), y, step[0])


@FAMILY.made(
    "after the splitting y is scaled by 1 + 2⁻³⁰Δ",
    ("volume", "poisson-map", "poisson-map:constant", "casimir"),
    _like_splitting,
)
def scaled_a_little(problem: Problem, y: Array, step: Array) -> Array:
    return _split(problem, y, step[0]) * (1 + 2.0**-30 * step[0])
