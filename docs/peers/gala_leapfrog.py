"""gala LeapfrogIntegrator: it conserves a linear system's energy only to a relative h²/4.

The docstring's example solves H = (p² + q²)/2 from (1, 0) with h = dt = 0.1. The leapfrog keeps q²(1 − h²/4) + p² to
rounding, so H oscillates by a relative h²/4, without a trend over long times.

Exit code 1 while this is so, 0 where the energy is constant to rounding.
"""

import sys
from importlib.metadata import version

import numpy as np
from gala.integrate import LeapfrogIntegrator

NOTES = [
    (
        "docstring of LeapfrogIntegrator, 1.11.0 (github.com/adrn/gala); no issue that we found names it",
        "2026-11-23",
        "It conserves energy exactly for linear systems and approximately for nonlinear systems",
    ),
]

for h in (0.1, 0.05):
    orbit = LeapfrogIntegrator(lambda _, w: np.array([w[1], -w[0]]))(np.array([1.0, 0.0]), dt=h, n_steps=1000)
    q, p = orbit.pos.xyz.value[0], orbit.vel.d_xyz.value[0]
    energy, kept = (q**2 + p**2) / 2, (q**2 * (1 - h**2 / 4) + p**2) / 2
    off = np.ptp(energy) / energy[0]
    print(
        f"gala {version('gala')}, dt = {h}: H sways by {off:.1e} of itself, h²/4 = {h**2 / 4:.1e}; "
        f"q²(1 − h²/4) + p² by {np.ptp(kept) / kept[0]:.0e}"
    )
sys.exit(bool(off > 1e-9))
