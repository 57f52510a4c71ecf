"""The bound of a step under damping, for the law *invariant*.

Let F be an invariant, homogeneous of degree p. With the damping −γy dt, F(y1) = e^{−pγh}F(y0) after
a step h. A scheme computes y1 = ρ(ρy0 + z) with ρ = e^{−γh/2}. Here z is the increment from ρy0 by
an undamped step that keeps F.

**Bound.** The residual r of the undamped step changes F by at most |∇F|ᵀr. Added to r is the
rounding of both products with ρ. For |γh| ≤ 1 it is at most 4 eps |y|_∞: ρ has a relative error of
1.5 eps, and each product is rounded once.
"""

from __future__ import annotations

import numpy as np

from sepv.errors import Skipped
from sepv.law.tolerance import step_residual
from sepv.problem import Array, Problem, damping_of
from sepv.record import EPS
from sepv.schemes import Scheme

# LARGEST_DECAY is the largest |γh| for which the error of ρ = e^{−γh/2}, and so the bound, is
# derived.
LARGEST_DECAY = 1.0


def residual(scheme: Scheme, problem: Problem, y: Array, y1: Array, h: float, dW: Array) -> Array:
    """Return a bound (d,) of the undamped step's residual plus rounding.
    Raise Skipped if |γh| > LARGEST_DECAY.
    """
    if abs(damping_of(problem) * h) > LARGEST_DECAY:
        raise Skipped(f"the law speaks of |γh| ≤ {LARGEST_DECAY:g}")
    rounding = 4 * EPS * max(float(np.max(np.abs(v))) for v in (y, y1))
    return step_residual(problem, y, y1, h, dW, scheme) + rounding
