"""jax_md simulate.nve: in 64-bit mode the time step is rounded to 32 bits.

The script compares a step of nve, for V = q²/2 in float64, with steps of velocity Verlet for dt and for dt
rounded to float32. The step of nve equals the second, so it is still symplectic and reversible.

Exit code 1 while this is so, 0 where the step is that of dt.
"""

import sys
from importlib.metadata import version

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

from jax_md import simulate, space  # noqa: E402

NOTES = [
    (
        "README, 64-bit precision (github.com/jax-md/jax-md)",
        "2026-08-18",
        "To enable 64-bit precision, set the respective JAX flag before importing jax_md",
    ),
    (
        "pull request 73, a maintainer",
        "2020-04-17",
        "we should probably advise people to use f64 mode",
    ),
    (
        "source of jax_md.simulate.velocity_verlet, 0.2.29; no note or issue that we found names it",
        "2026-08-18",
        "dt = f32(dt)",
    ),
]


def verlet(q, p, dt):
    half = p - dt / 2 * q
    return q + dt * half


q, p, dt = 0.3, 0.7, 0.1
init, step = simulate.nve(lambda R, **_: 0.5 * jnp.sum(R**2), space.free()[1], dt=dt)
state = init(jax.random.key(0), jnp.array([[q]]), kT=0.0, mass=1.0, momenta=jnp.array([[p]]))
q1 = float(step(state).position[0, 0])
off, rounded = abs(q1 - verlet(q, p, dt)), abs(q1 - verlet(q, p, float(np.float32(dt))))
print(f"jax_md {version('jax_md')}, dt = {dt}: off by {off:.1e}; by {rounded:.1e} from dt in float32")
sys.exit(off > 1e-12)
