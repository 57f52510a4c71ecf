"""Faults of schemes for Langevin dynamics: RIGHT_BAOAB with one wrong part,
which claims what RIGHT_BAOAB claims.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sepv.problem import Array, Langevin, Problem, langevin
from sepv.schemes import by_name

from .record import Family

FAMILY = Family("friction")
RIGHT_BAOAB = by_name("baoab")

# The O-step of RIGHT_BAOAB: p after the friction and the noise of a step.
Refresh = Callable[[Langevin, Array, float, Array], Array]


def _step(problem: Problem, y: Array, h: float, dW: Array, refresh: Refresh, last: float = 0.5) -> Array:
    """RIGHT_BAOAB with another O-step, and with `last` h in place of ½h for the last kick."""
    own = langevin(problem)
    q, p = own.mechanics.split(y)
    p = p + 0.5 * h * own.mechanics.force(q)
    q = q + 0.5 * h * own.mechanics.velocity(p)
    p = refresh(own, p, h, dW)
    q = q + 0.5 * h * own.mechanics.velocity(p)
    return own.mechanics.join(q, p + last * h * own.mechanics.force(q))


@FAMILY.like(
    RIGHT_BAOAB,
    "σ² = γkT M in place of 2γkT M: half of the temperature",
    ("equilibrium", "local-mean-square", "local-weak", "mean-square-order", "weak-order", "right-limit"),
)
def half_the_temperature(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return RIGHT_BAOAB.step(problem, y, h, np.sqrt(0.5) * dW)


@FAMILY.like(
    RIGHT_BAOAB,
    "the second half of the kick is left out",
    ("equilibrium", "deterministic-order", "local-mean", "local-weak", "mean-square-order", "weak-order"),
)
def half_a_kick(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return _step(problem, y, h, dW, Langevin.refreshed, last=0.0)


@FAMILY.like(
    RIGHT_BAOAB,
    "the noise e^(−γh/2)σΔW in place of √((1 − e^(−2γh))/(2γh))σΔW: too cold by (γh)²/6, of the right order of h",
    ("equilibrium:positions",),
)
def noise_damped_half(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    def refresh(own: Langevin, p: Array, h: float, dW: Array) -> Array:
        half = np.exp(-0.5 * own.rate * h)
        return half * half * p + half * own.pushed(dW)

    return _step(problem, y, h, dW, refresh)


@FAMILY.like(
    RIGHT_BAOAB,
    "the friction acts on q too",
    ("equilibrium", "poisson-map:conformal", "local-mean", "local-weak"),
)
def friction_of_positions(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    own = langevin(problem)
    q, p = own.mechanics.split(RIGHT_BAOAB.step(problem, y, h, dW))
    return own.mechanics.join(np.exp(-own.rate * h) * q, p)


@FAMILY.like(
    RIGHT_BAOAB,
    "the friction is left out, and the noise is not: no step forgets its start",
    ("equilibrium", "local-mean", "local-weak"),
)
def no_friction(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return _step(problem, y, h, dW, lambda own, p, h, dW: p + own.pushed(dW))  # noqa: ARG005 - a Refresh


@FAMILY.like(
    RIGHT_BAOAB, "noise of size h in place of √h", ("equilibrium", "local-mean-square", "local-weak")
)
def noise_of_size_h(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return RIGHT_BAOAB.step(problem, y, h, np.sqrt(abs(h)) * dW)


@FAMILY.like(
    RIGHT_BAOAB,
    "the friction of a midpoint rule, p ← (1 − γh/2)/(1 + γh/2) p + σΔW/(1 + γh/2)",
    ("poisson-map:conformal",),
)
def rational_friction(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    def refresh(own: Langevin, p: Array, h: float, dW: Array) -> Array:
        half = 0.5 * own.rate * h
        return (1 - half) / (1 + half) * p + own.pushed(dW) / (1 + half)

    return _step(problem, y, h, dW, refresh)


@FAMILY.like(
    RIGHT_BAOAB,
    "the friction 1.02γ beside the noise of γ",
    ("local-mean", "local-weak", "equilibrium", "poisson-map:conformal", "deterministic-order", "weak-order"),
)
def friction_too_strong(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    def refresh(own: Langevin, p: Array, h: float, dW: Array) -> Array:
        return np.exp(-1.02 * own.rate * h) * p + own.refreshed(0 * p, h, dW)

    return _step(problem, y, h, dW, refresh)


@FAMILY.like(
    RIGHT_BAOAB,
    "the noise 1.02σ",
    ("local-mean-square", "local-weak", "right-limit", "equilibrium", "weak-order"),
)
def louder_by_a_fiftieth(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return RIGHT_BAOAB.step(problem, y, h, 1.02 * dW)


@FAMILY.like(
    RIGHT_BAOAB,
    "the noise √((1 − e^(−γh))/(γh))σΔW in place of √((1 − e^(−2γh))/(2γh))σΔW: γ for 2γ, of weak order 1",
    ("local-weak", "weak-order", "equilibrium"),
)
def noise_of_half_the_exponent(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    def refresh(own: Langevin, p: Array, h: float, dW: Array) -> Array:
        return np.exp(-own.rate * h) * p + own.refreshed(0 * p, h / 2, dW)

    return _step(problem, y, h, dW, refresh)
