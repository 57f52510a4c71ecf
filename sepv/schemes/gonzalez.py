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

import numpy as np

from sepv.average import average_gradient, average_hessian
from sepv.fields import contract, dot, matmul, matvec
from sepv.implicit import Increment, Solution
from sepv.implicit import solve as solve_implicit
from sepv.problem import Array, Problem
from sepv.scheme import Scheme, as_lanes, step_by

# Below this share of |y| the derivative of the correction, which is O(|δ|), is lost in the rounding of its terms.
SHORT = 2.0**-20


def correction(problem: Problem, y0: Array, y1: Array, mean: Array) -> tuple[Array, Array, Array]:
    """∇H(ȳ) (d, M), the averaged less that, w, and e = δ/|δ|, which is 0 where nothing moves.

    H(y1) − H(y0) is taken as ∇̄Hᵀδ with the averaged gradient `mean` of (2.1): the same number without cancellation. The
    discrete gradient is then ∇H(ȳ) + e eᵀw, without a division by |δ|².
    """
    delta = y1 - y0
    largest = np.max(np.abs(delta), axis=0)
    scaled = delta / np.where(largest > 0, largest, 1.0)
    length = np.sqrt(dot(scaled, scaled))
    g = problem.gradient(y0 + 0.5 * delta)
    return g, mean - g, scaled / np.where(length > 0, length, 1.0)


def increment(problem: Problem, y0: Array, y1: Array, step: Array) -> Increment:
    """Δ B(ȳ) ∇̄H; `step` is (1, M), holding Δ."""
    mean = average_gradient(problem, y0, y1)
    g, w, e = correction(problem, y0, y1, mean.value)
    value = step[0] * matvec(problem.structure(y0 + 0.5 * (y1 - y0)), g + e * dot(e, w))
    return Increment(value, mean.evaluations + 1, np.ones_like(mean.evaluations), mean.reliable)


def jacobian(problem: Problem, y0: Array, y1: Array, step: Array) -> Array | None:
    """∂/∂y1 of `increment`: with w′ = ∫τH″dτ − ½H″(ȳ), that of e eᵀw is eᵀw (1 − 2eeᵀ)/|δ| + e wᵀ/|δ| + e eᵀw′."""
    if problem.structure_derivative is None or problem.hessian is None:
        return None
    middle, delta = y0 + 0.5 * (y1 - y0), y1 - y0
    g, w, e = correction(problem, y0, y1, average_gradient(problem, y0, y1).value)
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


def solve(problem: Problem, y: Array, h: float, dW: Array, start: Array | None = None) -> Solution:
    """One step of a batch with residual, counts and status of each lane; `start` (d, M) is a guess of y1 − y0."""
    state, noise = as_lanes(problem, y, h, dW)
    return solve_implicit(problem, state, problem.random_step(h, noise)[None], increment, jacobian, start)


def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """One step, for y of shape (d,) or (d, M) and dW of shape (m,) or (m, M).

    Raises
    ------
    StepFailure
        Where the implicit equation was not solved.
    """
    return step_by(solve, problem, y, h, dW)


scheme = Scheme(
    name="gonzalez",
    step=step,
    claims=(
        "contract",
        "reproducibility",
        "identity",
        "energy",
        "casimir",
        "midpoint",
        "noise-sum",
        "expansion",
        "symmetry",
        "rounding",
        "truncation",
    ),
    mean_square_order=1.0,
    weak_order=1.0,
    source="Gonzalez (1996), with the random step of (2.1)",
    solve=solve,
    batched=True,
)
