"""blackjax's integrators of Hamiltonian trajectories. Needs the extra ``samplers``.

blackjax's isokinetic integrators are left out: their equations keep a momentum of length one.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from blackjax.mcmc import integrators
from blackjax.mcmc.metrics import default_metric

from sepv.peers._integrator import REVERSIBLE, SYMPLECTIC, integrator
from sepv.peers._jax import advance_by
from sepv.peers.peer import Peer
from sepv.schemes import Scheme

_MODULE = (
    'blackjax.mcmc.integrators: "Symplectic, time-reversible, integrators for Hamiltonian trajectories."'
)


def _step(make: Any, V: Any, inverse_mass: Any, q: Any, p: Any, h: Any) -> tuple[Any, Any]:
    def logdensity(q: Any) -> Any:
        return -V(q)

    one_step = make(logdensity, default_metric(inverse_mass).kinetic_energy)
    state = one_step(integrators.new_integrator_state(logdensity, q, p), h)
    return state.position, state.momentum


def _scheme(name: str, order: int, note: str = "", **options: Any) -> Scheme:
    advance = advance_by(partial(_step, partial(getattr(integrators, name), **options)))
    claims = SYMPLECTIC + REVERSIBLE
    return integrator(f"blackjax {name}{note}", advance, order=order, claims=claims, source=_MODULE)


# The page names no orders; the orders here are those of the methods that the source describes.
velocity_verlet = _scheme("velocity_verlet", 2)
mclachlan = _scheme("mclachlan", 2)
yoshida = _scheme("yoshida", 2)
omelyan = _scheme("omelyan", 4)
# The implicit solver stops at max|x − f(x)| ≤ convergence_tol, by default 1e-6, or after 100
# iterations.
implicit_midpoint = _scheme("implicit_midpoint", 2)
implicit_midpoint_to_rounding = _scheme("implicit_midpoint", 2, ", convergence_tol=0", convergence_tol=0.0)

PEER = Peer(
    "blackjax",
    integrators={
        "velocity-verlet": velocity_verlet, "mclachlan": mclachlan, "yoshida": yoshida, "omelyan": omelyan,
        "implicit-midpoint": implicit_midpoint, "implicit-midpoint-to-rounding": implicit_midpoint_to_rounding,
    },
)  # fmt: skip
