"""openmm VerletIntegrator: velocities contain the rounding of positions, divided by the step.

No force acts on a free particle, so its velocity should not change. OpenMM's Reference platform,
in binary64, sets the velocity after a step to (x1 − x0)/h, because bonds of fixed length need that. So the rounding of
x1, divided by h, is an error of the velocity. This error is far too small to matter in a simulation, but a step is
symplectic only to about 1e-10.

Exit code 1 while this is so, 0 where the velocity stays.
"""

import sys

import openmm

NOTES = [
    (
        "issue 2208, a maintainer (github.com/openmm/openmm)",
        "2018-11-19",
        "you might be better off using a fixed step size Verlet.  It's symplectic, so it will have better energy "
        "conservation at the same average step size.",
    ),
    (
        "issue 2398, about single precision, by its author",
        "2019-09-20",
        "I suspect this is due to numerical underflow in constraint projection steps, which rely on precise "
        "subtraction of very similar vectors.",
    ),
    (
        "source of ReferenceVerletDynamics::update",
        "2026-11-23",
        "velocities[i][j] = velocityScale*(xPrime[i][j] - atomCoordinates[i][j]);",
    ),
]

off = {}
for x in (0.0, 3.0, 10.0):
    system = openmm.System()
    system.addParticle(1.0)
    context = openmm.Context(system, openmm.VerletIntegrator(0.001), openmm.Platform.getPlatform("Reference"))
    context.setPositions([[x, 0, 0]])
    context.setVelocities([[0.5, 0, 0]])
    context.getIntegrator().step(1)
    velocity = context.getState(getVelocities=True).getVelocities()[0][0]
    off[x] = abs(velocity.value_in_unit(openmm.unit.nanometer / openmm.unit.picosecond) - 0.5)
    version = openmm.version.version.partition(".dev")[0]
    print(f"openmm {version}, x = {x:4} nm, v = 0.5 nm/ps, h = 0.001 ps: v is off by {off[x]:.1e} nm/ps")
sys.exit(off[10.0] > 1e-15)
