"""PyMC's leapfrog, which its samplers call with a compiled log density.
Needs the extra ``samplers``.

PyMC's leapfrog gets the log density through private attributes, as it gets PyMC's own compiled log
densities.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from pymc.blocking import RaveledVars
from pymc.step_methods.hmc.integration import CpuLeapfrogIntegrator
from pymc.step_methods.hmc.quadpotential import QuadPotentialDiag, QuadPotentialFull

from sepv.peers._integrator import REVERSIBLE, SYMPLECTIC, diagonal, integrator
from sepv.peers.peer import Peer
from sepv.problem import Array, Mechanics


def _advance(system: Mechanics, q: Array, p: Array, h: float) -> tuple[Array, Array]:
    W = system.inverse_mass
    potential = QuadPotentialDiag(np.diag(W).copy()) if diagonal(system) else QuadPotentialFull(W)
    logp = SimpleNamespace(
        _raveled_inputs=True, dtype="float64",
        _pytensor_function=lambda q: (-float(system.potential(q)), system.force(q)),
    )  # fmt: skip
    leapfrog = CpuLeapfrogIntegrator(potential, logp)
    state = leapfrog.step(h, leapfrog.compute_state(RaveledVars(q, ()), p))
    return state.q.data, state.p


leapfrog = integrator(
    "pymc CpuLeapfrogIntegrator", _advance, order=2, claims=SYMPLECTIC + REVERSIBLE,
    source='pymc.step_methods.hmc.integration: "Half a momentum update, full position update, half momentum update."',
)  # fmt: skip

PEER = Peer("pymc", integrators={"leapfrog": leapfrog})
