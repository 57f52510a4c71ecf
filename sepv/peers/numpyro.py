"""numpyro's velocity Verlet. Needs the extra ``samplers``."""

from __future__ import annotations

from typing import Any

from numpyro.infer.hmc_util import euclidean_kinetic_energy
from numpyro.infer.hmc_util import velocity_verlet as verlet

from sepv.peers._integrator import REVERSIBLE, SYMPLECTIC, integrator
from sepv.peers._jax import advance_by
from sepv.peers.peer import Peer


def _step(V: Any, inverse_mass: Any, q: Any, p: Any, h: Any) -> tuple[Any, Any]:
    init, update = verlet(V, euclidean_kinetic_energy)
    state = update(h, inverse_mass, init(q, p))
    return state.z, state.r


velocity_verlet = integrator(
    "numpyro velocity_verlet", advance_by(_step), order=2, claims=SYMPLECTIC + REVERSIBLE,
    source='numpyro.infer.hmc_util.velocity_verlet: "Second order symplectic integrator that uses the velocity verlet '
    'algorithm".',
)  # fmt: skip

PEER = Peer("numpyro", integrators={"velocity-verlet": velocity_verlet})
