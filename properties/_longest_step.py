"""Step sizes of paths for a scheme that states its longest step (`sepv.Scheme.longest_step`)."""

from __future__ import annotations

import numpy as np

from sepv.problem import Problem
from sepv.schemes import Scheme, takes

# Increments longer than this many standard deviations are rare. A scheme may refuse some of them.
LIKELY_DEVIATIONS = 4.0
# Step sizes are divided by 2^STEP_MAX_HALVINGS at most.
STEP_MAX_HALVINGS = 12


def divisor(scheme: Scheme, problem: Problem, h: float) -> int:
    """Return the least power of two q with which the scheme takes a step k = h/q,
    all ΔW_j = LIKELY_DEVIATIONS √k.
    """
    for n in range(STEP_MAX_HALVINGS):
        size = h / 2**n
        if takes(
            scheme,
            problem,
            np.asarray(problem.initial, dtype=float),
            size,
            np.full(problem.noises, LIKELY_DEVIATIONS * size**0.5),
        ):
            return int(2**n)
    return int(2**STEP_MAX_HALVINGS)
