"""JAX MD's simulation at constant energy. Needs the extra ``simulators``."""

from __future__ import annotations

from typing import Any

import jax
from jax_md import simulate, space

from sepv.errors import Skipped
from sepv.peers._integrator import REVERSIBLE, SYMPLECTIC, integrator
from sepv.peers._jax import advance_by
from sepv.peers.peer import Peer


def _step(V: Any, inverse_mass: Any, q: Any, p: Any, h: Any) -> tuple[Any, Any]:
    if inverse_mass.ndim > 1:
        raise Skipped("one mass for each particle: M is not diagonal")
    init, update = simulate.nve(lambda R, **_: V(R[:, 0]), space.free()[1], dt=h)
    start = init(jax.random.key(0), q[:, None], kT=0.0, mass=1 / inverse_mass, momenta=p[:, None])
    state = update(start)
    return state.position[:, 0], state.momentum[:, 0]


nve = integrator(
    "jax_md simulate.nve", advance_by(_step), order=2, claims=SYMPLECTIC + REVERSIBLE,
    source='jax_md.simulate.nve: "We use a standard velocity Verlet integration scheme."',
)  # fmt: skip

PEER = Peer("jax_md", integrators={"nve": nve})
