"""REBOUND's integrators under forces of the problem's own. Needs the extra ``simulators``.

JANUS computes on integers of 64 bits, x/scale and v/scale: its documentation asks for the scale of the problem.
Here it is 2⁻⁵⁶ times a power of two above the state and its change in a step, below the rounding of binary64.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import rebound

from sepv.peers._integrator import REVERSIBLE, SYMPLECTIC, integrator, masses
from sepv.peers.peer import Peer
from sepv.problem import Array, Mechanics
from sepv.schemes import Scheme


def _advance(
    name: str, order: int | None, system: Mechanics, q: Array, p: Array, h: float
) -> tuple[Array, Array]:
    simulation, mass = rebound.Simulation(), masses(system)
    simulation.gravity, simulation.integrator, simulation.dt = "none", name, h
    if order is not None:
        simulation.integrator.order = order
    if name == "janus":
        simulation.integrator.scale_pos = _scale(q, h * p / mass)
        simulation.integrator.scale_vel = _scale(p / mass, h * system.force(q) / mass)
    for m, x, v in zip(mass, q, p / mass, strict=True):
        simulation.add(m=m, x=x, vx=v)
    particles = simulation.particles

    def forces(_simulation: Any) -> None:
        with np.errstate(over="ignore", invalid="ignore"):
            acceleration = system.force(np.array([a.x for a in particles])) / mass
        for particle, a in zip(particles, acceleration, strict=True):
            particle.ax += a

    simulation.additional_forces = forces
    if order is None:  # it chooses its steps, which may not become ever smaller where a solution ends
        simulation.integrator.min_dt = abs(h) / 1000
        simulation.integrate(h)
    else:
        simulation.steps(1)
    q1, p1 = np.array([a.x for a in particles]), mass * np.array([a.vx for a in particles])
    if not np.all(np.isfinite([q1, p1])):
        raise ArithmeticError(f"{name} came to values that are not finite")
    return q1, p1


def _scale(values: Array, changes: Array) -> float:
    return float(2.0 ** (np.frexp(max(np.abs(values).max(), np.abs(changes).max()))[1] - 56))


def _scheme(name: str, order: int | None, source: str, note: str = "") -> Scheme:
    claims = () if order is None else SYMPLECTIC + REVERSIBLE
    advance = partial(_advance, name, order)
    return integrator(
        f"rebound {name}{note}", advance, order=order, claims=claims, source=f"REBOUND, {source}"
    )


_LEAPFROG = 'LEAPFROG: "It is symplectic. By default it is second order … Higher orders of 4, 6, and 8".'
leapfrog = _scheme("leapfrog", 2, _LEAPFROG)
leapfrog4, leapfrog6, leapfrog8 = (_scheme("leapfrog", k, _LEAPFROG, f", order {k}") for k in (4, 6, 8))
ias15 = _scheme("ias15", None, 'IAS15: "non-symplectic", "in most cases accurate down to machine precision".')
janus = _scheme(
    "janus",
    6,
    'JANUS: "a bit-wise time-reversible high-order symplectic integrator"; its default order is 6.',
)

PEER = Peer(
    "rebound",
    integrators={
        "leapfrog": leapfrog, "leapfrog4": leapfrog4, "leapfrog6": leapfrog6, "leapfrog8": leapfrog8, "ias15": ias15,
        "janus": janus,
    },
)  # fmt: skip
