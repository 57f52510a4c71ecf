"""JAX MD's simulations at constant energy and of Langevin dynamics.
Needs the extra ``simulators``.

`jax_md.simulate.nvt_langevin` draws its noise from a key, as `jax_md.simulate.Normal`. Here this
name stands for given noise while a step is compiled. All other code is the library's.
"""

from __future__ import annotations

from typing import Any
from unittest.mock import patch

import jax
import jax.numpy as jnp
from jax_md import simulate, space

from sepv.errors import Skipped
from sepv.peers._integrator import BAOAB_CLAIMS, REVERSIBLE, SYMPLECTIC, integrator, thermostat
from sepv.peers._jax import advance_by
from sepv.peers.peer import Peer
from sepv.problem import Array, Mechanics


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


def _noisy(V: Any, inverse_mass: Any, q: Any, p: Any, h: Any, xi: Any, rate: Any, kT: Any) -> tuple[Any, Any]:
    class Given(simulate.Normal):
        def sample(self, key: Any) -> Any:  # noqa: ARG002
            return self.mean + jnp.sqrt(self.var) * xi[:, None]

    init, update = simulate.nvt_langevin(
        lambda R, **_: V(R[:, 0]), space.free()[1], dt=h, kT=kT, gamma=rate, center_velocity=False
    )
    start = init(jax.random.key(0), q[:, None], mass=1 / inverse_mass, momenta=p[:, None])
    with patch.object(simulate, "Normal", Given):
        state = update(start)
    return state.position[:, 0], state.momentum[:, 0]


_moved = advance_by(_noisy)


def _langevin(
    system: Mechanics, rate: float, kT: float, q: Array, p: Array, h: float, xi: Array
) -> tuple[Array, Array]:
    return _moved(system, q, p, h, xi, rate, kT)  # type: ignore[call-arg]


langevin = thermostat(
    "jax_md simulate.nvt_langevin", _langevin, claims=BAOAB_CLAIMS,
    source='jax_md.simulate.nvt_langevin: "Simulation in the NVT ensemble using the BAOAB Langevin thermostat."',
)  # fmt: skip

PEER = Peer("jax_md", integrators={"nve": nve}, thermostats={"langevin": langevin})
