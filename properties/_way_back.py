"""A step from y0 to y1 and a step back: the measurement of the laws "symmetry" and "reversibility", and its bound.

Let Φ be the step and Ψ the step back in exact arithmetic, Ψ∘Φ = id. A rounding at the end of the
first step or at the start of the way back reaches y0′ as Ψ′ times itself. One at the start of the
first step or at the end of the way back arrives unchanged, and one between them as it is between
both. So |y0′ − y0| ≤ (I + |Ψ′|) r, where r is the sum of the residuals that the roundings of two
steps may cause (`sepv.verification._tolerance`). Ψ′ comes from the scheme's own step back, from
states next to y1: a scheme may have another equation than (2.1), which moves far where (2.1) hardly
moves, and its rounding errors grow as that equation makes them grow. For (2.1), y1 = y0 + R(y0,
y1), a residual r moves y0′ by (I + ∂R/∂y0)⁻¹ r. Because Ψ′ = (I + ∂R/∂y0)⁻¹(I − ∂R/∂y1), and both
derivatives of R are equal up to O(Δ²), this is ½(I + Ψ′) r, half of the bound.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from sepv.errors import SchemeFault, StepFailure
from sepv.problem import Array
from sepv.schemes import Scheme, SchemeCrash, ask
from sepv.verification._cases.case import Case
from sepv.verification._law import Measurement
from sepv.verification._tolerance import state_ulp, step_residual


def measured(scheme: Scheme, case: Case, back: Callable[[Array], Array]) -> Measurement:
    """Measure |y0′ − y0| after the step of the case from y0 to y1 and the step back y0′ = back(y1).

    The derivative of the way back costs d further steps. They are made only if |y0′ − y0| exceeds
    r.
    """
    problem, y, h, dW = case.build()
    y1 = ask(scheme, problem, y, h, dW)
    returned = back(y1)
    residual = step_residual(problem, y, y1, h, dW, scheme)
    residual = residual + step_residual(problem, y1, returned, -h, -dW, scheme)
    error, bound = np.abs(returned - y), residual
    if not np.all(error <= bound):
        bound = bound + sum(_moved(back, y1, returned, k, residual[k]) for k in range(y.size))
    k = int(np.argmax(error / bound))
    unit = state_ulp(y, y1)
    detail = f"y1 = {y1.tolist()}, back at {returned.tolist()}"
    return Measurement(float(error[k]) / unit, float(bound[k]) / unit, detail)


def _moved(back: Callable[[Array], Array], y1: Array, returned: Array, k: int, width: float) -> Array | float:
    """The change |back(y1 ± w e_k) − back(y1)| (d,), w = `width`, with the first sign for which the step succeeds.

    NaN if it succeeds for no sign: then nothing tells how roundings grow, and the case has no
    bound.
    """
    for sign in (1.0, -1.0):
        near = y1.copy()
        near[k] += sign * width
        with suppress(StepFailure, SchemeFault, SchemeCrash):
            return np.abs(back(near) - returned)
    return math.nan
