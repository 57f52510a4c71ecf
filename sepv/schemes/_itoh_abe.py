"""The symmetric discrete gradient of Itoh and Abe with the random step.

y1 = y0 + Δ B(ȳ) ½(∇̄₁H(y0, y1) + ∇̄₁H(y1, y0)),  ȳ = (y0 + y1)/2,
Δ = h + Σ_j c_j ΔŴ_j   (ΔŴ_j: truncated ΔW_j),

where ∇̄₁H has quotients of H along coordinate increments: T. Itoh and K. Abe,
Hamiltonian-conserving discrete canonical equations based on variational difference quotients (J.
Comput. Phys. 76, 1988). Cohen and Dujardin (2014) take B at y0 in the drift (`discrete_gradient`).
With B at ȳ the scheme depends on the noise through Δ alone, is symmetric and keeps quadratic
Casimirs. For quadratic H it is the midpoint rule. It does not commute with rotations: ∇̄₁H depends
on axes.
"""

from __future__ import annotations

from sepv.core.formula import Fields, Values
from sepv.problem import matvec
from sepv.schemes._discrete_gradient import symmetrised
from sepv.schemes._one_step import SYMMETRIC, implicit, one_step


def formula(fields: Fields, y: Values, z: Values, step: Values) -> Values:
    """R of the step y1 = y + R: Δ B(ȳ) ∇̄H with z = y1 − y, ȳ = y + z/2 and Δ = step[0].

    ∇̄H = ½(∇̄₁H(y, y1) + ∇̄₁H(y1, y)) symmetrises the discrete gradient ∇̄₁H along the coordinate
    axes.
    """
    return step[0] * matvec(fields.structure(y + 0.5 * z), symmetrised(fields, y, z))


scheme = one_step(
    "itoh-abe",
    implicit(formula),
    (SYMMETRIC | {"energy", "rounding"}) - {"equivariance"},
    "Itoh and Abe (1988), symmetrised, with the random step of (2.1)",
)
