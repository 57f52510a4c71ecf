"""The scheme of another library's integrator for mechanical problems, H = ½pᵀM⁻¹p + V(q)
(`sepv.problem.mechanics`).

Libraries of particles have one mass for each particle, and a particle moves in space: coordinate i
of a problem with a diagonal M is particle i at (q_i, 0, 0), with the mass M_ii and the force
(F_i(q), 0, 0).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from sepv.errors import Skipped, UsageError
from sepv.problem import Array, Mechanics, Problem, Systems, langevin, mechanics, temperature
from sepv.schemes import Scheme

# The laws that a library claims if it calls an integrator symplectic or reversible.
SYMPLECTIC = ("poisson-map:constant", "poisson-map", "volume")
REVERSIBLE = ("symmetry", "reversibility")

# A function (system, q, p, h) -> (q1, p1).
Advance = Callable[[Mechanics, Array, Array, float], tuple[Any, Any]]


def integrator(
    name: str, advance: Advance, *, order: float | None = None, source: str, **facts: Any
) -> Scheme:
    """The `sepv.Scheme` of a mechanical integrator, whose function `advance` takes one step of
    length h from (q, p).

    `facts` are further fields of the scheme.
    """

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        try:
            system = mechanics(problem)
        except UsageError:
            raise Skipped("no mechanical problem, H = ½pᵀM⁻¹p + V(q) with the canonical B") from None
        return system.join(*advance(system, *system.split(y.copy()), float(problem.random_step(h, dW))))

    return Scheme(
        name,
        step,
        order=order,
        source=source,
        noise=False,
        systems=Systems.MECHANICAL,
        truncation=None,
        **facts,
    )


# The laws that a library claims if it calls an integrator BAOAB_CLAIMS.
BAOAB_CLAIMS = ("equilibrium", "equilibrium:positions", "poisson-map:conformal")


def thermostat(
    name: str, advance: Callable[..., tuple[Any, Any]], *, source: str, asks: str = "", **facts: Any
) -> Scheme:
    """The `sepv.Scheme` of an integrator of Langevin dynamics, whose function
    `advance(system, rate, kT, q, p, h, xi)` takes one step with the normal numbers xi (n,), one
    for each momentum, that make the noise √(2 rate kT m_i h) xi_i; (2, n) with space-time areas.
    """

    def step(problem: Problem, y: Array, h: float, dW: Array, *more: Array) -> Array:
        try:
            own, kT = langevin(problem), temperature(problem)
        except UsageError:
            raise Skipped("no Langevin dynamics at one temperature, with friction −γp") from None
        if h <= 0:
            raise Skipped("a step with noise needs h > 0")
        q, p = own.mechanics.split(y.copy())
        # ΔW has the variance h, a space-time area h/12.
        rows = [
            own.pushed(part) * factor for part, factor in zip((dW, *more), (1.0, 12.0**0.5), strict=False)
        ]
        scale = np.sqrt(2 * own.rate * kT * masses(own.mechanics) * h)
        xi = np.stack(rows) / np.where(scale > 0, scale, 1.0)  # without noise the rows are 0
        return own.mechanics.join(
            *advance(own.mechanics, own.rate, kT, q, p, float(h), xi if more else xi[0])
        )

    return Scheme(
        name, step, source=source, systems=Systems.FRICTION, truncation=None, asks=asks, weak_order=2,
        order=None if asks else 2,
        **facts,
    )  # fmt: skip


def diagonal(system: Mechanics) -> bool:
    """True if the mass matrix M of the system is diagonal."""
    return not np.any(system.inverse_mass - np.diag(np.diag(system.inverse_mass)))


def masses(system: Mechanics) -> Array:
    """The masses of particles, (n,). Raises Skipped for a mass matrix that is not diagonal."""
    if not diagonal(system):
        raise Skipped("one mass for each particle: M is not diagonal")
    return np.diag(system.mass)


def on_axis(values: Any) -> Array:
    """The coordinates (n,) as n points (n, 3) in space, all on the x-axis."""
    return np.pad(np.asarray(values, dtype=np.float64)[:, None], ((0, 0), (0, 2)))
