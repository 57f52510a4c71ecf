"""The stochastic midpoint rule for several Hamiltonians.

y1 = y0 + B(ȳ)(h∇H_0(ȳ) + Σ_j c_j ΔŴ_j ∇H_j(ȳ)), ȳ = (y0 + y1)/2.

With the increments held fixed it is the midpoint rule for the Hamiltonian hH_0 + Σ c_j ΔŴ_j H_j: it keeps every
quadratic and linear Casimir of B, is symplectic for constant B (G. N. Milstein, Yu. M. Repin and M. V. Tretyakov, SIAM
J. Numer. Anal. 40, 2002), and is symmetric. It is no Poisson map for other B.

It agrees with the flow of that Hamiltonian up to its second power, and lacks the Lévy areas, which multiply the
brackets of the noises: mean-square order ½ in general, 1 where the noises commute, weak order 1.
"""

from __future__ import annotations

import numpy as np

from sepv.hamiltonians import hamiltonian_field, hamiltonian_field_jacobian
from sepv.one_step import EVERY, Implicit, each_noise, one_step
from sepv.orders import Orders
from sepv.problem import Array, Problem
from sepv.solution import Increment

CLAIMS = EVERY | {
    "identity",
    "casimir",
    "symplecticity",
    "symmetry",
    "expansion",
    "noise-sum",
    "equivariance",
}


def increment(problem: Problem, y0: Array, y1: Array, step: Array) -> Increment:
    """B(ȳ)(h∇H_0 + Σ c_j ΔW_j ∇H_j) for h and the c_j ΔW_j; all gradients count as one evaluation."""
    ones = np.ones(y0.shape[1], dtype=np.int64)
    value = hamiltonian_field(problem, y0 + 0.5 * (y1 - y0), step)
    return Increment(value, ones, ones, ones.astype(bool))


def jacobian(problem: Problem, y0: Array, y1: Array, step: Array, *_: Array) -> Array:
    """∂/∂y1."""
    return 0.5 * hamiltonian_field_jacobian(problem, y0 + 0.5 * (y1 - y0), step)


step = Implicit(increment, jacobian, parts=each_noise)
scheme = one_step(
    "stochastic-midpoint",
    step,
    CLAIMS,
    "Milstein, Repin and Tretyakov (2002), for any B",
    weak_order=1.0,
    mean_square_order=Orders(0.5, commutative=1.0),
    systems="hamiltonians",
)
