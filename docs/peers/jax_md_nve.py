"""jax_md simulate.nve: in 64-bit mode the time step is rounded to 32 bits.

With positions, momenta, masses and dt in float64, one step for V = q²/2 is compared with velocity Verlet for dt and
for dt rounded to float32. It is the second to the last digit: `velocity_verlet` begins with `dt = f32(dt)`. A step
such as 1e-3 is 4.7e-8 too long, relative to itself, and so are all times. The step stays symplectic and reversible;
steps that float32 has, such as 2⁻¹⁰, are exact.

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
        "we should probably advise people to use f64 mode (even if they want to keep most of the simulation in f32",
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


q, p, off = 0.3, 0.7, {}
for dt in (2.0**-10, 1e-3, 0.1):
    init, step = simulate.nve(lambda R, **_: 0.5 * jnp.sum(R**2), space.free()[1], dt=dt)
    state = init(jax.random.key(0), jnp.array([[q]]), kT=0.0, mass=1.0, momenta=jnp.array([[p]]))
    q1 = float(step(state).position[0, 0])
    off[dt] = abs(q1 - verlet(q, p, dt))
    rounded = abs(q1 - verlet(q, p, float(np.float32(dt))))
    print(
        f"jax_md {version('jax_md')}, dt = {dt:.6g}: off by {off[dt]:.1e}; by {rounded:.1e} from dt in float32"
    )
sys.exit(off[0.1] > 1e-12)
