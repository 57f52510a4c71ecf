"""sdeint stratKP2iS: strong order ½, not the documented 1.0.

Its documentation says "two-step implicit order 1.0 strong algorithm". For dy = √(1 + y²) ∘dW from 0 the exact
solution is y = sinh W. When the step is quartered the error should fall by 4, and comes to fall by 2; so does its
mean. The difference (G(y + fh + g√h) − G(y))/√h · J with J = ½ΔW² contains ½ g″(g, g) √h J, whose mean is of order
h^1.5 in each step, since J has the mean h/2. (The Itô integral I has mean zero.)

Exit code 1 while this is so, 0 where the error falls as documented.
"""

import sys
from importlib.metadata import version

import numpy as np
import sdeint


def drift(y, _t):
    return np.zeros_like(y)


def noise(y, _t):
    return np.sqrt(1 + y * y).reshape(1, 1)


fine = np.random.default_rng(1).normal(0, np.sqrt(1 / 256), (300, 256, 1))
errors = {}
for solver in (sdeint.stratHeun, sdeint.stratKP2iS):
    for steps in (4, 16, 64, 256):
        dW = fine.reshape(300, steps, -1, 1).sum(axis=2)
        times = np.linspace(0, 1, steps + 1)
        # Its equation solved to rounding, so that the solver's tolerance has no part in the error.
        more = {"rtol": 1e-12} if solver is sdeint.stratKP2iS else {}
        ends = np.array([solver(drift, noise, np.zeros(1), times, dW=path, **more)[-1, 0] for path in dW])
        error = ends - np.sinh(fine.sum(axis=1)[:, 0])
        name = solver.__name__
        errors[name, steps] = np.sqrt(np.mean(error**2))
        print(
            f"sdeint {version('sdeint')} {name:10} {steps:3} steps: "
            f"rms error {errors[name, steps]:.4f}, mean error {error.mean():+.4f}"
        )
sys.exit(bool(errors["stratKP2iS", 256] > errors["stratKP2iS", 64] / 3))
