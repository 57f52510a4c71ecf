"""OpenMM's Verlet integrator on its Reference platform, which computes in binary64.
Needs the extra ``simulators``.

OpenMM keeps the velocity half a step before the position (leapfrog). So a step here first sets the
velocity to v − (h/2)M⁻¹F(q), and at the end moves it on by half a step, as OpenMM does for its
kinetic energies.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import openmm
from openmm.unit import nanometer, picosecond

from sepv.errors import Skipped
from sepv.peers._integrator import REVERSIBLE, SYMPLECTIC, integrator, masses, on_axis
from sepv.peers.peer import Peer
from sepv.problem import Array, Mechanics


@lru_cache(maxsize=8)
def _context(system: Mechanics) -> Any:
    posed = openmm.System()
    for mass in masses(system):
        posed.addParticle(float(mass))

    def forces(state: Any) -> tuple[float, Array]:
        q = state.getPositions(asNumpy=True).value_in_unit(nanometer)[:, 0]
        return float(system.potential(q)), on_axis(system.force(q))

    posed.addForce(openmm.PythonForce(forces))
    return openmm.Context(posed, openmm.VerletIntegrator(1.0), openmm.Platform.getPlatform("Reference"))


def _advance(system: Mechanics, q: Array, p: Array, h: float) -> tuple[Array, Array]:
    if h < 0:
        raise Skipped("OpenMM takes no negative step sizes")
    context, mass = _context(system), masses(system)
    context.getIntegrator().setStepSize(h)
    context.setPositions(on_axis(q))
    context.setVelocities(on_axis((p - h / 2 * system.force(q)) / mass))
    context.getIntegrator().step(1)
    state = context.getState(getPositions=True, getVelocities=True)
    q1 = state.getPositions(asNumpy=True).value_in_unit(nanometer)[:, 0].copy()
    v1 = state.getVelocities(asNumpy=True).value_in_unit(nanometer / picosecond)[:, 0]
    return q1, mass * v1 + h / 2 * system.force(q1)


verlet = integrator(
    "openmm VerletIntegrator", _advance, order=2, claims=SYMPLECTIC + REVERSIBLE,
    source='openmm.VerletIntegrator: "simulates a System using the leap-frog Verlet algorithm".',
)  # fmt: skip

PEER = Peer("openmm", integrators={"verlet": verlet})
