"""blackjax yoshida: it has order 2 and three stages; its page describes an eleven-stage method.

The script solves V = q⁴/4 over [0, 1] in 4 and 16 steps. Errors of order 2 fall by a factor of 16, errors of order 4 by
256. The source is right; on the page each integrator has the description of the next one.

Exit code 1 while the order is 2, 0 where it is 4.
"""

import sys
from importlib.metadata import version

import jax
import jax.numpy as jnp
import numpy as np
from blackjax.mcmc import integrators
from blackjax.mcmc.metrics import default_metric

NOTES = [
    (
        "page of blackjax.mcmc.integrators at blackjax-devs.github.io, under yoshida",
        "2026-11-23",
        "Eleven-stage palindromic symplectic integrator derived in [OMF03].",
    ),
    (
        "source of blackjax.mcmc.integrators, 1.7.1, before yoshida_coefficients",
        "2026-11-23",
        "Three stages palindromic symplectic integrator derived in :cite:p:`mclachlan1995numerical`",
    ),
]

jax.config.update("jax_enable_x64", True)


def logdensity(q):
    return -jnp.sum(q**4) / 4


def end(name, steps):
    step = getattr(integrators, name)(logdensity, default_metric(jnp.ones(1)).kinetic_energy)
    state = integrators.new_integrator_state(logdensity, jnp.array([1.0]), jnp.array([0.5]))
    state = jax.lax.fori_loop(0, steps, lambda _, s: step(s, 1 / steps), state)
    return np.array([float(state.position[0]), float(state.momentum[0])])


exact, falls = end("omelyan", 512), {}
for name in ("yoshida", "omelyan"):
    errors = [np.abs(end(name, n) - exact).max() for n in (4, 16)]
    falls[name] = errors[0] / errors[1]
    print(
        f"blackjax {version('blackjax')} {name}: errors {errors[0]:.1e}, {errors[1]:.1e}: falls by {falls[name]:.0f}"
    )
sys.exit(falls["yoshida"] < 64)
