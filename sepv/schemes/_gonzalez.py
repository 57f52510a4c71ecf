"""The midpoint discrete gradient scheme of Gonzalez with the random step.

y1 = y0 + Δ B(ȳ) ∇̄H(y0, y1),  ȳ = (y0 + y1)/2,  Δ = h + Σ_j c_j ΔŴ_j   (ΔŴ_j: truncated ΔW_j),

∇̄H(y0, y1) = ∇H(ȳ) + [H(y1) − H(y0) − ∇H(ȳ)ᵀδ] δ/|δ|²,  δ = y1 − y0:

see O. Gonzalez, Time integration and discrete Hamiltonian systems (J. Nonlinear Sci. 6, 1996),
(3.5). Cohen and Dujardin (2014), §2, name this discrete gradient as another possibility.

Because ∇̄Hᵀδ = H(y1) − H(y0), H is kept for every skew B. Quadratic Casimirs are kept too, because
B is taken at the midpoint and ∇C(ȳ)ᵀB(ȳ) = 0. Other Casimirs are not kept. The scheme is symmetric
and uses the noise through Δ only. It commutes with rotations but not with scalings and shears,
which change |δ|.
"""

from __future__ import annotations

import numpy as np

from sepv.core.formula import Fields, Values
from sepv.problem import dot, matvec
from sepv.schemes._one_step import SYMMETRIC, implicit, one_step


def formula(fields: Fields, y: Values, z: Values, step: Values) -> Values:
    """R of the step y1 = y + R: Δ B(ȳ) ∇̄H with δ = z = y1 − y, ȳ = y + z/2 and Δ = step[0].

    ∇̄H is computed as ∇H(ȳ) + e eᵀ(g − ∇H(ȳ)) with the average g of ∇H along the segment and
    e = δ/|δ|, or 0 if δ = 0. Because H(y1) − H(y0) = gᵀδ, this formula has no difference of
    energies and no division by |δ|².
    """
    middle, largest = y + 0.5 * z, np.max(np.abs(z), axis=0)
    moves = largest > 0
    scaled = z / np.where(moves, largest, 1.0)
    e = scaled / np.sqrt(np.where(moves, dot(scaled, scaled), 1.0))
    g = fields.gradient(middle)
    return step[0] * matvec(fields.structure(middle), g + e * dot(e, fields.mean_gradient(y, z) - g))


step = implicit(formula)
scheme = one_step(
    "gonzalez",
    step,
    (SYMMETRIC | {"energy", "rounding"}) - {"random-step", "equivariance"},
    "Gonzalez (1996), with the random step of (2.1)",
)
