"""Jacobi's identity for a structure B, and the derivative of a step Φ,
which shows whether Φ is a Poisson map.

B(y) is a Poisson structure if it is skew and satisfies Jacobi's identity. The flow φ of B∇H is then
a Poisson map,

    φ′(y) B(y) φ′(y)ᵀ = B(φ(y))                                                                  (P)

for every H (Hairer, Lubich and Wanner, *Geometric Numerical Integration*, VII.2, Theorem 4.3). So
is the flow of a stochastic system (1.1), because its noises are Hamiltonian vector fields too. For
canonical B, (P) is symplecticity.

**The derivative of a step** is computed by central differences of order six: with Δ and the
increments held fixed,

    D_j = Σ_k a_k (Φ(y + k w e_j) − Φ(y − k w e_j))/w,      a = (3/4, −3/20, 1/60).

If the step Φ is analytic for complex y_j in a disc of radius ρ and moves y by at most M in that
disc, Cauchy's estimate bounds its n-th derivative by n! M/ρⁿ. The first term of the error has n = 7
and the factor 2 Σ_k a_k k⁷ = 36, so that

    |D_j − ∂Φ/∂y_j| ≤ 37 (w/ρ)⁶ M/ρ + 11/6 δ/w,

where δ is the error of one step and 2 Σ|a_k| = 11/6. For w ≤ ρ/64 the factor 37 covers 36 and all
further terms.
"""

from __future__ import annotations

import numpy as np

from sepv.core.arrays import Array
from sepv.problem._problem import Problem

_WEIGHTS = (3 / 4, -3 / 20, 1 / 60)
# Weights of order four for the same points. The distance between the two results bounds the error
# of the sixth order.
_FOURTH = (2 / 3, -1 / 12, 0.0)
STENCIL_POINTS = len(_WEIGHTS)
STENCIL_TRUNCATION, STENCIL_ROUNDING = 37.0, 2 * sum(abs(a) for a in _WEIGHTS)
# The ratio w/ρ. The truncation error is then at most 37 · 2⁻⁴² M/ρ, below the error of rounding for
# most ρ.
STENCIL_WIDTH = 2.0**-7
# The width of differences relative to the scale of y, if no radius ρ is known.
BLIND_WIDTH = 2.0**-9


def shifted(y: Array, widths: Array) -> Array:
    """The states (d, 1 + 2·STENCIL_POINTS·d) at which `derivative` needs Φ: y,
    and y ± k·widths_j·e_j for k = 1 … STENCIL_POINTS.
    """
    states = [y]
    for j in range(y.size):
        for k in range(1, STENCIL_POINTS + 1):
            for sign in (1, -1):
                moved = y.copy()
                moved[j] += sign * k * widths[j]
                states.append(moved)
    return np.stack(states, axis=1)


def derivative(answers: Array, widths: Array) -> tuple[Array, Array]:
    """The derivative ∂Φ/∂y (n, d) by differences of order six,
    and its distance from differences of order four.

    `answers` (n, …) are the values of Φ at the states that `shifted` returns.
    """
    # The columns of direction j: shifts k = 1, 2, 3, each with both signs.
    sides = answers[:, 1:].reshape(-1, widths.size, STENCIL_POINTS, 2)
    rises = sides[..., 0] - sides[..., 1]
    sixth, fourth = (rises @ np.array(weights) / widths for weights in (_WEIGHTS, _FOURTH))
    return sixth, np.abs(sixth - fourth)


def derivative_of_structure(problem: Problem, y: Array) -> Array:
    """The derivatives ∂B_ij/∂y_k at [i, j, k], (d, d, d), at one state y (d,): as given,
    else by differences.
    """
    if problem.structure_derivative is not None:
        return np.asarray(problem.structure_derivative(y))
    d = problem.dimension
    widths = BLIND_WIDTH * scales(problem, y)
    values = problem.structure(shifted(y, widths)).reshape(d * d, -1)
    return derivative(values, widths)[0].reshape(d, d, d)


def scales(problem: Problem, y: Array) -> Array:
    """The lengths (d,) over which B and H change at y, for the widths of differences.

    They are max |y_i|. If the problem has a domain, they are |y_j| where y_j ≠ 0, so that
    differences do not leave it.
    """
    largest = max(float(np.max(np.abs(y))), 2.0**-40)
    if problem.domain is None:
        return np.full(y.size, largest)
    return np.where(y != 0, np.abs(y), largest)


def jacobi_defect(problem: Problem, y: Array) -> Array:
    """The defect of Jacobi's identity for B at a state y (d,),
    which is zero for a Poisson structure.

    Returns
    -------
    (d, d, d) array
        Σ_l (B_il ∂_lB_jk + B_jl ∂_lB_ki + B_kl ∂_lB_ij) at [i, j, k]. If the problem gives no
        `structure_derivative`, the error is about 1e-11 of the largest term.

    Examples
    --------
    >>> import numpy as np, sepv
    >>> from sepv.problem import jacobi_defect
    >>> float(np.max(np.abs(jacobi_defect(sepv.problems.rigid_body(), np.array([0.8, 0.6, 0.1])))))
    0.0
    """
    y = np.asarray(y, dtype=np.float64)
    cyclic = np.einsum("il,jkl->ijk", problem.structure(y), derivative_of_structure(problem, y))
    return np.asarray(cyclic + cyclic.transpose(1, 2, 0) + cyclic.transpose(2, 0, 1))
