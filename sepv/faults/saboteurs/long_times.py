"""Faults that show in the energy over many periods. Each saboteur claims what the scheme that it
imitates claims.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sepv.problem import Array, Problem, matvec, mechanics
from sepv.schemes import Scheme, as_lanes, by_name, explicit, leapfrog, midpoint

from .record import Family

FAMILY = Family("long times")
_BLANES_MOAN = by_name("blanes-moan-4")


@FAMILY.like(
    leapfrog,
    "the kick of the leapfrog has the diagonal of the mass matrix, the drift the whole of it",
    ("long-time-energy", "poisson-map:constant", "deterministic-order"),
)
def kick_of_another_mass(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Take ½Δ D⁻¹F in place of ½ΔM⁻¹F in the leapfrog's kicks of the velocity,
    where D is the diagonal of M.
    """
    system, (state, noise) = mechanics(problem), as_lanes(problem, y, h, dW)
    delta, inverse = problem.random_step(h, noise), 1 / np.diag(system.mass)[:, None]
    q, p = system.split(state)
    v = system.velocity(p) + 0.5 * delta * inverse * system.force(q)
    q = q + delta * v
    v = v + 0.5 * delta * inverse * system.force(q)
    return system.join(q, system.momentum(v)).reshape(np.shape(y))


@FAMILY.like(
    leapfrog,
    "the drift of the leapfrog has the step in two digits, the kicks all of it: symplectic, for another energy",
    ("long-time-energy", "deterministic-order", "random-step"),
)
def drift_of_a_rounded_step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """In the leapfrog, drift by q + Δ′M⁻¹p, where Δ′ is Δ rounded to two digits, and kick with
    Δ.
    """
    system, (state, noise) = mechanics(problem), as_lanes(problem, y, h, dW)
    delta = problem.random_step(h, noise)
    rounded = np.array([float(f"{step:.1e}") for step in np.atleast_1d(delta)])
    q, p = system.split(state)
    p = p + 0.5 * delta * system.force(q)
    q = q + rounded * system.velocity(p)
    return system.join(q, p + 0.5 * delta * system.force(q)).reshape(np.shape(y))


@FAMILY.like(
    leapfrog,
    "the step size is rounded to 32 bits, and all else is computed in 64: symplectic and symmetric for every h",
    ("deterministic-order", "random-step"),
)
def single_precision_step_size(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """The leapfrog with h rounded to 24 binary digits."""
    return leapfrog.step(problem, y, float(np.float32(h)), dW)


@FAMILY.like(
    leapfrog,
    "each step of the leapfrog ends with the momenta times 0.9999",
    ("long-time-energy", "poisson-map:constant", "volume", "identity"),
)
def a_little_friction(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Multiply the momenta p by 0.9999 after each leapfrog step."""
    system = mechanics(problem)
    q, p = system.split(leapfrog.step(problem, y, h, dW))
    return system.join(q, 0.9999 * p)


@FAMILY.like(
    _BLANES_MOAN,
    "the state is stored in single precision after each step, towards zero",
    ("long-time-energy", "poisson-map:constant", "symmetry", "identity"),
)
def stored_in_single_precision(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Round the result of each step to 24 bits, toward zero."""
    result = _BLANES_MOAN.step(problem, y, h, dW)
    near = result.astype(np.float32)
    beyond = np.abs(near) > np.abs(result)
    return np.where(beyond, np.nextafter(near, np.float32(0)), near).astype(np.float64)


@FAMILY.like(
    midpoint,
    "three sweeps of a fixed-point iteration stand for the solution of the midpoint rule",
    ("long-time-energy", "symmetry", "poisson-map:constant"),
)
def three_sweeps(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Iterate the midpoint rule, y1 ← y0 + Δ f((y0 + y1)/2), three times from y1 = y0,
    and stop unsolved.
    """
    y0, noise = as_lanes(problem, y, h, dW)
    delta, y1 = problem.random_step(h, noise), y0
    for _ in range(3):
        middle = 0.5 * (y0 + y1)
        y1 = y0 + delta * matvec(problem.structure(middle), problem.gradient(middle))
    return y1.reshape(np.shape(y))


def _sold_as_symplectic() -> Scheme:
    fourth = explicit(4)
    return replace(
        fourth, claims=frozenset(fourth.claims) | {"poisson-map:constant", "long-time-energy"}, solve=None
    )


FAMILY.rows(
    ("fourth-order-sold-as-symplectic", "the classical Runge-Kutta method claims to be symplectic",
     ("long-time-energy", "poisson-map:constant"), _sold_as_symplectic),
)  # fmt: skip
