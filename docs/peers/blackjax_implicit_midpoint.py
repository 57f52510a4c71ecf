"""blackjax implicit_midpoint: where its solver has not converged the state comes back unmarked.

V = q⁴/4 and a step of 1 from q = 2, p = 0. The fixed-point iteration does not converge; its word, `success =
False`, is dropped, and the numbers at which it stopped are returned as the next state, with an energy of 32 in the
place of 4. A sampler rejects such a proposal for its energy; whoever calls the integrator alone is told nothing.

Where it converges it stops at max|x − f(x)| ≤ 1e-6, `convergence_tol`, some eight units of rounding of float32,
which is JAX's default. In float64 the step keeps areas to that tolerance, and to rounding where the tolerance is 0.

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


def step(y, h, **options):
    state = new_integrator_state(logdensity, y[:1], y[1:])
    end = implicit_midpoint(logdensity, kinetic, **options)(state, h)
    return jnp.concatenate([end.position, end.momentum])


name = f"blackjax {version('blackjax')} implicit_midpoint"
y0, h = jnp.array([2.0, 0.0]), 1.0
y1 = step(y0, h)
q, p = (y0 + y1) / 2
off = float(jnp.max(jnp.abs(y1 - y0 - h * jnp.stack([p, -(q**3)]))))
print(f"{name}, h = 1 from (2, 0): ({y1[0]:.6g}, {y1[1]:.6g}), which its equation misses by {off:.3g}")
for options in ({}, {"convergence_tol": 0.0}):
    derivative = jax.jacfwd(lambda y, options=options: step(y, 0.1, **options))(jnp.array([0.3, 0.5]))
    print(
        f"{name}, h = 0.1 from (0.3, 0.5), {options or 'default'}: det - 1 = {jnp.linalg.det(derivative) - 1:.1e}"
    )
sys.exit(bool(jnp.all(jnp.isfinite(y1))) and off > 1)
