"""The stochastic discrete gradient scheme, as printed in §4 of Cohen and Dujardin (2014).

y1 = y0 + h B(y0) ∇̄H(y0, y1) + B((y0 + y1)/2) ∇̄H(y0, y1) Σ_j c_j ΔŴ_j   (ΔŴ_j: truncated ΔW_j),

with B at y0 in the drift and at the midpoint in the noise. ∇̄H(y, ȳ) = ½(∇̄₁H(y, ȳ) + ∇̄₁H(ȳ, y))
symmetrises the discrete gradient ∇̄₁H, whose components are difference quotients of H along the
coordinate axes.
"""

from __future__ import annotations

import numpy as np

from sepv.core.formula import Fields, Values
from sepv.problem import matvec
from sepv.schemes._one_step import CLAIMS_OF_ALL, drift_and_noise, implicit, one_step
from sepv.schemes._picture_look import Look


def corners(y: Values, z: Values) -> Values:
    """The corners of the path along the axes from y to y + z, (d, d, ...).

    Column i is the state with the first i components of y + z, and the other components of y.
    """
    return np.stack([np.concatenate([y[:i] + z[:i], y[i:]]) for i in range(len(y))], axis=1)


def coordinate_increments(fields: Fields, y: Values, z: Values) -> Values:
    """The coordinate-increment discrete gradient ∇̄₁H(y, y + z):
    component i is (H(corner i+1) − H(corner i))/z_i.

    It is computed as the average of ∂_iH along the edge from corner i to corner i+1, so that no
    digits are lost if z_i is small.
    """
    return fields.edge_means(corners(y, z), z)


def symmetrised(fields: Fields, y: Values, z: Values) -> Values:
    """The symmetric ∇̄H = ½(∇̄₁H(y, y + z) + ∇̄₁H(y + z, y)), (d, ...),
    with ∇̄₁H of `coordinate_increments`.
    """
    return 0.5 * (coordinate_increments(fields, y, z) + coordinate_increments(fields, y + z, -z))


def formula(fields: Fields, y: Values, z: Values, step: Values) -> Values:
    """R of the step y1 = y + R: (h B(y) + S B(ȳ)) ∇̄H with ȳ = y + z/2, `step` = (h, S)
    and S = Σ c_j ΔŴ_j.
    """
    B = step[0] * fields.structure(y) + step[1] * fields.structure(y + 0.5 * z)
    return matvec(B, symmetrised(fields, y, z))


step = implicit(formula, parts=drift_and_noise)
scheme = one_step(
    "discrete-gradient",
    step,
    CLAIMS_OF_ALL | {"identity", "energy", "noise-sum", "rounding"},
    "Cohen and Dujardin (2014), §4",
    look=Look("#B0558A", "#E59AC4", "D", "2 2"),
)
