"""The midpoint discrete gradient scheme of Gonzalez with the random step.

y1 = y0 + Δ B(ȳ) ∇̄H(y0, y1),  ȳ = (y0 + y1)/2,  Δ = h + Σ_j c_j ΔŴ_j,

∇̄H(y0, y1) = ∇H(ȳ) + [H(y1) − H(y0) − ∇H(ȳ)ᵀδ] δ/|δ|²,  δ = y1 − y0:

O. Gonzalez, Time integration and discrete Hamiltonian systems (J. Nonlinear Sci. 6, 1996), (3.5), the discrete gradient
that Cohen and Dujardin (2014), §2, name as another possibility.

∇̄Hᵀδ = H(y1) − H(y0), so that H is kept for every skew B. Quadratic Casimirs are kept too, because B is taken at the
midpoint, where ∇C(ȳ)ᵀB(ȳ) = 0; others are not. The scheme is symmetric and sees the noise through Δ only. It commutes
with rotations but not with scalings and shears, which change |δ|.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sepv.average import average_hessian
from sepv.fields import contract, dot, matmul, matvec
from sepv.formula import Asked, Fields
from sepv.one_step import SYMMETRIC, implicit, one_step
from sepv.problem import Array, Problem

# Below this share of |y| the derivative of the correction, which is O(|δ|), is lost in the rounding of its terms.
SHORT = 2.0**-20


def correction(fields: Fields, y: Any, z: Any) -> tuple[Any, Any, Any]:
    """∇H(ȳ) (d, M), the averaged less that, w, and e = δ/|δ|, which is 0 where nothing moves.

    H(y1) − H(y0) is taken as ∇̄Hᵀδ with the averaged gradient of (2.1): the same number without cancellation. The
    discrete gradient is then ∇H(ȳ) + e eᵀw, without a division by |δ|².
    """
    largest = np.max(np.abs(z), axis=0)
    moves = largest > 0
    scaled = z / np.where(moves, largest, 1.0)
    g = fields.gradient(y + 0.5 * z)
    return g, fields.mean_gradient(y, z) - g, scaled / np.sqrt(np.where(moves, dot(scaled, scaled), 1.0))


def formula(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    """Δ B(ȳ) ∇̄H."""
    g, w, e = correction(fields, y, z)
    return step[0] * matvec(fields.structure(y + 0.5 * z), g + e * dot(e, w))


def jacobian(problem: Problem, y0: Array, y1: Array, step: Array, *_: Array) -> Array | None:
    """∂/∂y1: with w′ = ∫τH″dτ − ½H″(ȳ), that of e eᵀw is eᵀw (1 − 2eeᵀ)/|δ| + e wᵀ/|δ| + e eᵀw′."""
    if problem.structure_derivative is None or problem.hessian is None:
        return None
    middle, delta = y0 + 0.5 * (y1 - y0), y1 - y0
    g, w, e = correction(Asked(problem, y0, y1), y0, delta)
    curvature, mean_curvature = 0.5 * problem.hessian(middle), average_hessian(problem, y0, y1)
    assert mean_curvature is not None  # the problem has a Hessian
    size, reach = np.max(np.abs(delta), axis=0), np.max(np.abs(y0) + np.abs(y1), axis=0)
    length = np.sqrt(dot(delta, delta))
    moves = size > SHORT * reach
    share = np.where(moves, 1.0 / np.where(moves, length, 1.0), 0.0)
    along, outer = dot(e, w), e[:, None] * e[None]
    eye = np.eye(problem.dimension)[..., None]
    turned = share * (along * (eye - 2 * outer) + e[:, None] * w[None])
    slope = curvature + turned + matmul(outer, mean_curvature - curvature)
    bent = contract(problem.structure_derivative(middle), g + e * along)
    return step[0] * (0.5 * bent + matmul(problem.structure(middle), slope))


step = implicit(formula, jacobian)
scheme = one_step(
    "gonzalez",
    step,
    (SYMMETRIC | {"energy", "rounding"}) - {"random-step", "equivariance"},
    "Gonzalez (1996), with the random step of (2.1)",
)
