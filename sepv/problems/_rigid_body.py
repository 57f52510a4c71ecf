"""The stochastic rigid body, a Lie-Poisson system on so(3)* (§4.2 of Cohen and Dujardin's
paper).
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from sepv._arguments import floats
from sepv.errors import ProblemError
from sepv.problem import Array, Nambu, Problem
from sepv.problems._common import HAT, flows, named, skew, total


def rigid_body(inertia: ArrayLike = (0.345, 0.653, 1.0), noise: ArrayLike = 1.0) -> Problem:
    """The rigid body with B(y)v = y × v, H = ½ Σ y_i²/I_i and the Casimir |y|²,
    from the state (0.8, 0.6, 0).

    The default I = (0.345, 0.653, 1) and the noise c = 1 are those of §4.2 of Cohen and Dujardin's
    paper.
    """
    moments = floats("inertia", inertia).copy()
    if moments.shape != (3,) or not np.all(np.isfinite(moments)) or np.any(moments <= 0):
        raise ProblemError(
            expected="three positive moments of inertia",
            received=f"{inertia!r}",
            remedy="give inertia=(I1, I2, I3)",
        )

    parts = tuple(partial(_about_axis, k, float(moments[k])) for k in range(3))
    return named(
        "rigid-body",
        noise,
        {"inertia": moments.tolist()},
        dimension=3,
        structure=_structure,
        hamiltonian=total(parts),
        casimirs=(np.eye(3),),
        initial=(0.8, 0.6, 0.0),
        flows=flows(3, _structure, parts),
        # Steps Δ of this size were solved from 10⁵ states near the initial one, and steps −Δ led
        # back to these states.
        longest_step=0.5,
        nambu=_NAMBU,
    )


def _about_axis(k: int, moment: float, y: Array) -> Array:
    """The part H_k = y_k²/(2I_k) of H, whose flow is a rotation about axis k by the angle t
    y_k/I_k.
    """
    energy: Array = 0.5 * y[k] * y[k] / moment
    return energy


# The structure as B(y)v = y × v = −(v × ∇C) with C = ½|y|².
_NAMBU = Nambu(
    factor=lambda y: np.full_like(y[0], -1.0),
    casimir=lambda y: 0.5 * (y[0] * y[0] + y[1] * y[1] + y[2] * y[2]),
)


def _structure(y: Array) -> Array:
    return skew(y, ((i, j, sign * y[k]) for i, j, k, sign in HAT))
