"""blackjax implicit_midpoint: if its solver does not converge, it returns a state without warning.

The script makes one step with h = 1 for H = p²/2 + q⁴/4 from q = 2, p = 0. The fixed-point iteration does not converge,
and its last iterate is returned as the next state. This state has the energy 32 instead of 4, so a sampler rejects it;
the integrator alone gives no warning.

Exit code 1 while the numbers are returned as a state, 0 where they are marked (an error, or not finite).
"""

import sys
from importlib.metadata import version

import jax
import jax.numpy as jnp
from blackjax.mcmc.integrators import implicit_midpoint, new_integrator_state
from blackjax.mcmc.metrics import default_metric

NOTES = [
    (
        "source of blackjax.mcmc.integrators.implicit_midpoint, 1.7.1 (github.com/blackjax-devs/blackjax)",
        "2026-11-23",
        "del info  # TODO: Track the returned info",
    ),
    (
        "docstring of the module, 1.7.1",
        "2026-11-23",
        "Symplectic, time-reversible, integrators for Hamiltonian trajectories.",
    ),
    (
        "issue 925, about another solver of the library",
        "2026-05-24",
        "The caller receives no warning.",
    ),
]

jax.config.update("jax_enable_x64", True)


def logdensity(q):
    return -jnp.sum(q**4) / 4


kinetic = default_metric(jnp.ones(1)).kinetic_energy


def step(y, h):
    state = new_integrator_state(logdensity, y[:1], y[1:])
    end = implicit_midpoint(logdensity, kinetic)(state, h)
    return jnp.concatenate([end.position, end.momentum])


name = f"blackjax {version('blackjax')} implicit_midpoint"
y0, h = jnp.array([2.0, 0.0]), 1.0
y1 = step(y0, h)
q, p = (y0 + y1) / 2
off = float(jnp.max(jnp.abs(y1 - y0 - h * jnp.stack([p, -(q**3)]))))
print(f"{name}, h = 1 from (2, 0): ({y1[0]:.6g}, {y1[1]:.6g}), which its equation misses by {off:.3g}")
sys.exit(bool(jnp.all(jnp.isfinite(y1))) and off > 1)
