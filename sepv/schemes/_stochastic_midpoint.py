"""The stochastic midpoint rule for several Hamiltonians.

y1 = y0 + B(ȳ)(h∇H_0(ȳ) + Σ_j c_j ΔŴ_j ∇H_j(ȳ)), ȳ = (y0 + y1)/2   (ΔŴ_j: truncated ΔW_j).

With fixed increments a step is the midpoint rule for the Hamiltonian K = hH_0 + Σ c_j ΔŴ_j H_j.
So it is symmetric, keeps all quadratic and linear Casimirs of B, and is symplectic for constant B
(G. N. Milstein, Yu. M. Repin and M. V. Tretyakov, SIAM J. Numer. Anal. 40, 2002). For other B the
step is not a Poisson map.

A step agrees with the flow of B∇K up to second order in K, but has no Lévy areas, which multiply
brackets of the fields B∇H_j. The mean-square order is therefore ½ in general and 1 if these fields
commute. The weak order is 1.
"""

from __future__ import annotations

from sepv.core.formula import Fields, Values, derivative
from sepv.problem import Systems, each_noise
from sepv.schemes._one_step import RANDOM_STEP, implicit, one_step
from sepv.schemes._order_claims import Orders

MIDPOINT_CLAIMS = (RANDOM_STEP - {"random-step"}) | {"casimir", "poisson-map:constant", "symmetry"}


def formula(fields: Fields, y: Values, z: Values, step: Values) -> Values:
    """R of the step y1 = y + R: B(ȳ)(h∇H_0(ȳ) + Σ c_j ΔW_j ∇H_j(ȳ))
    with z = y1 − y and ȳ = y + z/2.

    `step` holds h and the c_j ΔW_j. The gradients of all Hamiltonians count as one evaluation.
    """
    middle = y + 0.5 * z
    return fields.apply(middle, fields.combined_gradient(middle, step))


step = implicit(formula, derivative(formula), parts=each_noise)
scheme = one_step(
    "stochastic-midpoint",
    step,
    MIDPOINT_CLAIMS,
    "Milstein, Repin and Tretyakov (2002), for any B",
    weak_order=1.0,
    mean_square_order=Orders(0.5, commutative=1.0),
    systems=Systems.HAMILTONIANS,
)
