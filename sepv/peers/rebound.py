"""REBOUND's integrators under forces of the problem's own. Needs the extra ``simulators``."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import rebound

from sepv.peers._integrator import REVERSIBLE, SYMPLECTIC, integrator, masses
from sepv.peers.peer import Peer
from sepv.problem import Array, Mechanics
from sepv.schemes import Scheme


def _advance(name: str, order: int, system: Mechanics, q: Array, p: Array, h: float) -> tuple[Array, Array]:
    simulation, mass = rebound.Simulation(), masses(system)
    simulation.gravity, simulation.integrator, simulation.dt = "none", name, h
    if order:
        simulation.integrator.order = order
    for i, m in enumerate(mass):
        simulation.add(m=m, x=q[i], vx=p[i] / m)
    particles = simulation.particles

    def forces(_simulation: Any) -> None:
        acceleration = system.force(np.array([a.x for a in particles])) / mass
        for particle, a in zip(particles, acceleration, strict=True):
            particle.ax += a

    simulation.additional_forces = forces
    simulation.steps(1) if name != "ias15" else simulation.integrate(h)
    return np.array([a.x for a in particles]), mass * np.array([a.vx for a in particles])


def _scheme(name: str, order: int, claims: tuple[str, ...], source: str, note: str = "") -> Scheme:
    advance = partial(_advance, name, order if name != "ias15" else 0)
    return integrator(
        f"rebound {name}{note}",
        advance,
        order=order if name != "ias15" else None,
        claims=claims,
        source=source,
    )


_LEAPFROG = 'REBOUND, LEAPFROG: "symplectic. By default it is second order … Higher orders of 4, 6, and 8".'
leapfrog = _scheme("leapfrog", 2, SYMPLECTIC + REVERSIBLE, _LEAPFROG)
leapfrog4 = _scheme("leapfrog", 4, SYMPLECTIC + REVERSIBLE, _LEAPFROG, ", order 4")
leapfrog6 = _scheme("leapfrog", 6, SYMPLECTIC + REVERSIBLE, _LEAPFROG, ", order 6")
leapfrog8 = _scheme("leapfrog", 8, SYMPLECTIC + REVERSIBLE, _LEAPFROG, ", order 8")
ias15 = _scheme(
    "ias15", 15, (), 'REBOUND, IAS15: "in most cases accurate down to machine precision", "non-symplectic".'
)
janus = _scheme(
    "janus",
    6,
    SYMPLECTIC + REVERSIBLE,
    'REBOUND, JANUS: "bit-wise time-reversible high-order symplectic". Order 6.',
)

PEER = Peer(
    "rebound",
    integrators={
        "leapfrog": leapfrog, "leapfrog4": leapfrog4, "leapfrog6": leapfrog6, "leapfrog8": leapfrog8, "ias15": ias15,
        "janus": janus,
    },
)  # fmt: skip
