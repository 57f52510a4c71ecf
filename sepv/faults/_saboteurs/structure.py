"""Faults of schemes that keep the Poisson structure or the domain, and schemes that claim to and do not.

They claim what the schemes claim that they imitate: the midpoint rule, which is symplectic, and the splitting, whose
step is a Poisson map and stays in the positive octant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from sepv.faults._saboteurs.record import Saboteur, explicit_step
from sepv.problem import Array, Problem
from sepv.problem._problem import Flow
from sepv.schemes import Scheme, energy_preserving, implicit, midpoint, splitting
from sepv.schemes._scheme import Step
from sepv.solve import Fields


def _off_the_middle(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return step[0] * fields.field(y + (0.5 + 2.0**-12) * z)


def _imitating(original: Scheme, step: Step) -> Callable[[], Scheme]:
    return lambda: replace(original, step=step, solve=None)


def _split(change: Callable[[Problem], Problem], time: Callable[[Problem, Array, Array], Array]) -> Step:
    """The splitting with other flows, or another time."""

    def update(problem: Problem, y0: Array, step: Array) -> Array:
        delta = time(problem, y0, step[0])
        # With h = 0 and one noise of size 1 the random step is what is given for the increment.
        alone = replace(change(problem), noise=(1.0,), check=False)
        return splitting.step(alone, y0, 0.0, delta[None])

    return explicit_step(update)


def _own_time(_problem: Problem, _y: Array, delta: Array) -> Array:
    return delta


def _time_of_place(_problem: Problem, y: Array, delta: Array) -> Array:
    """Δ(1 + Δ⁴ y_1/64): an error beyond every order that is claimed, in time alone."""
    return delta * (1 + delta**4 * y[0] / 64)


def _as_it_is(problem: Problem) -> Problem:
    return problem


def _tangent_of_first(problem: Problem) -> Problem:
    """The first flow as a step of Euler's, which keeps what the exact flow keeps of linear functions and no more."""
    if not problem.flows:
        return problem
    first, *others = problem.flows

    def tangent(y: Array, t: Array) -> Array:
        small = 2.0**-20
        return y + t * (first(y, small + 0 * t) - first(y, -small + 0 * t)) / (2 * small)

    flow: Flow = tangent
    return replace(problem, flows=(flow, *others), check=False)


def _claims_structure(*laws: str) -> Callable[[], Scheme]:
    return lambda: replace(energy_preserving, claims={*energy_preserving.claims, *laws})


_TABLE = (
    (
        "off-the-middle",
        "the midpoint rule at y0 + (½ + 2⁻¹²)(y1 − y0)",
        _imitating(midpoint, implicit(_off_the_middle)),
        ("symplecticity", "casimir", "midpoint", "symmetry"),
    ),
    (
        "averaged-and-symplectic",
        "(2.1) claims to be symplectic and a Poisson map besides: it keeps H and quadratic Casimirs, and no structure",
        _claims_structure("symplecticity", "poisson-map"),
        ("symplecticity", "poisson-map"),
    ),
    (
        "time-of-place",
        "the splitting takes a time that depends on y: all Casimirs and the octant are kept, the structure is not",
        _imitating(splitting, _split(_as_it_is, _time_of_place)),
        ("poisson-map", "symmetry"),
    ),
    (
        "tangent-of-first",
        "the first flow of the splitting is replaced by a step along its tangent",
        _imitating(splitting, _split(_tangent_of_first, _own_time)),
        ("poisson-map", "positivity", "casimir", "any-casimir", "symmetry"),
    ),
)

SABOTEURS = tuple(Saboteur(name, "structure", broken, make, laws) for name, broken, make, laws in _TABLE)
