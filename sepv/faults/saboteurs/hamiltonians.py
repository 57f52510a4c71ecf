"""Faults of schemes for several Hamiltonians: each claims, but lacks,
one property of the scheme that it imitates.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sepv import schemes
from sepv.core.formula import Increment
from sepv.problem import Array, Problem, each_noise, hamiltonian_field
from sepv.problems import algebra_of
from sepv.schemes import Implicit, as_lanes, implicit, pushed_by_noise, quiet_step

from .record import Family, imitating

FAMILY = Family("hamiltonians")
NOISE_FACTOR = 1 + 2.0**-10
PUSH_SIZE = 2.0**-30


@FAMILY.like(
    schemes.stochastic_midpoint,
    "the last noise is 2⁻¹⁰ too large",
    ("local-weak", "local-mean", "local-mean-square", "noise-sum", "expansion"),
)
def second_noise_louder(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Make the increment of the last noise too large by a thousandth."""
    noise = np.array(dW)
    noise[-1] *= NOISE_FACTOR
    return schemes.stochastic_midpoint.step(problem, y, h, noise)


@FAMILY.like(
    schemes.stochastic_midpoint,
    "y1 is multiplied by 1 + 2⁻³⁰h",
    ("casimir", "symmetry", "poisson-map:constant"),
)
def away_from_the_origin(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Multiply y1 by 1 + 2⁻³⁰h."""
    return schemes.stochastic_midpoint.step(problem, y, h, dW) * (1 + PUSH_SIZE * h)


@FAMILY.like(
    schemes.area_midpoint, "the Lévy areas have the wrong sign", ("local-mean-square", "mean-square-order")
)
def areas_of_other_sign(problem: Problem, y: Array, h: float, dW: Array, areas: Array) -> Array:
    return schemes.area_midpoint.step(problem, y, h, dW, -areas)


@FAMILY.like(
    schemes.stochastic_splitting, "the flows are composed in turn, and not symmetrically", ("symmetry",)
)
def lie_and_trotter(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Compose the flows of all Hamiltonians once, in the order of a list (Lie and Trotter):
    this is not symmetric.
    """
    schemes.stochastic_splitting.step(problem, y, 0.0, 0 * dW)  # raises for problems that the scheme refuses
    state, noise = as_lanes(problem, y, h, dW)
    flows: tuple[Any, ...] = (*problem.flows, *problem.noise_flows)  # type: ignore[attr-defined]
    times = [state[0] * 0 + h] * len(problem.flows) + list(problem.c[:, None] * noise)
    for flow, t in zip(flows, times, strict=True):
        state = flow(state, t)
    return state.reshape(y.shape)


@FAMILY.like(
    schemes.isospectral_midpoint,
    "¼MXM is left out: quadratic Casimirs and orders are kept, others and the structure are not",
    ("poisson-map", "invariant:casimir"),
)
def midpoint_as_isospectral(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Take the midpoint rule, x = (y0 + y1)/2 and y1 − y0 = f(x),
    in place of the isospectral midpoint rule.
    """
    algebra_of(problem, as_lanes(problem, y, h, dW)[0])
    return schemes.stochastic_midpoint.step(problem, y, h, dW)


@FAMILY.made(
    "ȳ is the arithmetic mean, not that of logarithms: positive, of that order, no Poisson map",
    ("poisson-map",),
    lambda increment: imitating(schemes.darboux_lie, Implicit(increment, parts=each_noise)),
)
def arithmetic_middle(problem: Problem, y0: Array, y1: Array, step: Array) -> Increment:
    """The right side R = y0(exp(f(ȳ)/ȳ) − 1) of y1 = y0 + R,
    with the arithmetic mean ȳ = (y0 + y1)/2.
    """
    middle = y0 + 0.5 * (y1 - y0)
    return Increment(y0 * np.expm1(hamiltonian_field(problem, middle, step) / middle))


@FAMILY.like(
    schemes.drift_preserving,
    "each half of the step sees half of its increment",
    ("invariant:energy", "invariant:casimir"),
)
def halves_alike(problem: Problem, y: Array, h: float, dW: Array, first: Array) -> Array:
    """Take dW/2 in both halves of the step, where the right scheme takes independent increments."""
    return schemes.drift_preserving.step(problem, y, h, dW, 0 * first + 0.5 * dW)


@FAMILY.like(
    schemes.drift_preserving,
    "the additive noise is 2⁻²⁰ too large",
    ("invariant:energy", "invariant:casimir", "local-weak"),
)
def pushed_too_far(problem: Problem, y: Array, h: float, dW: Array, first: Array) -> Array:
    """Multiply all noise increments dW by 1 + 2⁻²⁰, so that the noise is too large by this
    factor.
    """
    schemes.drift_preserving.step(
        problem, y, 0.0, 0 * dW, 0 * first
    )  # raises for problems that the scheme refuses
    state, noise = as_lanes(problem, y, h, dW)
    before, far = np.reshape(first, noise.shape), 1 + 2.0**-20
    middle = quiet_step(problem, pushed_by_noise(problem, state, far * before), h, noise)
    return pushed_by_noise(problem, middle, far * (noise - before)).reshape(y.shape)


def _between_the_halves(
    no_noise: Implicit, problem: Problem, y: Array, h: float, dW: Array, first: Array
) -> Array:
    """Make a step without noise between the two halves of the noise, as drift-preserving does."""
    schemes.drift_preserving.step(problem, y, 0.0, 0 * dW, 0 * first)  # raises for a refused problem
    state, noise = as_lanes(problem, y, h, dW)
    before = np.reshape(first, noise.shape)
    moved = no_noise(problem, pushed_by_noise(problem, state, before), h, noise)
    return pushed_by_noise(problem, moved, noise - before).reshape(y.shape)


_explicit_structure = implicit(
    lambda fields, y, z, step: step[0] * fields.apply(y, fields.mean_gradient(y, z)), parts=quiet_step.parts
)


@FAMILY.like(
    schemes.drift_preserving,
    "B is taken where the step without noise begins: E[H] is right, E[C] is not",
    ("invariant:casimir", "symmetry"),
)
def structure_before_the_step(problem: Problem, y: Array, h: float, dW: Array, first: Array) -> Array:
    """Take B at Y, not at the midpoint: Y + hB(Y)∇̄H, where Y is the state after the first half of
    the noise.
    """
    return _between_the_halves(_explicit_structure, problem, y, h, dW, first)


_midpoint = implicit(lambda fields, y, z, step: step[0] * fields.field(y + 0.5 * z), parts=quiet_step.parts)


@FAMILY.like(
    schemes.drift_preserving,
    "the step without noise is the midpoint rule, which keeps quadratic H alone",
    ("invariant:energy",),
)
def midpoint_between_the_halves(problem: Problem, y: Array, h: float, dW: Array, first: Array) -> Array:
    """Make a midpoint step, in the place of an energy-preserving one,
    between the halves of the noise.
    """
    return _between_the_halves(_midpoint, problem, y, h, dW, first)
