"""The Euler-Maruyama scheme for friction: y1 = y0 + h (B∇H − Γy0) + Σ_j c_j g_j ΔW_j,
for any matrix Γ.

For additive noise its mean-square and weak order is 1 (P. Kloeden and E. Platen, 1992, §10.2).
"""

from __future__ import annotations

import numpy as np

from sepv.errors import Skipped
from sepv.problem import Array, Problem, drift, noise_vectors
from sepv.schemes._drift_preserving import pushed_by_noise
from sepv.schemes._langevin import of_friction
from sepv.schemes._one_step import CLAIMS_OF_ALL


def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """y1 from y (d,) or (d, M) with increments dW (m,) or (m, M).
    Raises Skipped unless vectors give the noise.
    """
    if len(noise_vectors(problem)) != problem.noises:
        raise Skipped(f"the noise of {problem.name} is not given by constant vectors")
    return np.asarray(pushed_by_noise(problem, y + h * drift(problem, y), dW))


scheme = of_friction(
    "friction-euler-maruyama", step, CLAIMS_OF_ALL | {"equilibrium"}, "Kloeden and Platen (1992), §10.2", 1.0
)
