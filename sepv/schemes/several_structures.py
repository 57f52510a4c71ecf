"""The energy-preserving scheme for several structures (paper §1).

y1 = y0 + [h B(ȳ) + Σ_j c_j ΔŴ_j G_j(ȳ)] ∫₀¹ ∇H(y0 + τ(y1 − y0)) dτ,  ȳ = (y0 + y1)/2.

**Energy** for all skew B and G_j, as in Proposition 3.1: H(y1) − H(y0) = ∇̄Hᵀ[…]∇̄H = 0. **Quadratic Casimirs** common to
B and all G_j, as in Proposition 3.2. **Mean-square order** 1 for one noise, and for several whose fields G_j∇H commute;
½ otherwise: the scheme sees no iterated integrals ∫W_i∘dW_j, which are of the order of h where fields do not commute.
Where G_j = B it is (2.1). Several Hamiltonians with {H_0, H_j} = 0 are posed in this form by
`sepv.structures.commuting_hamiltonians`; a step at or next to a critical point of H_0, where S_j∇̄H_0 does not stand for
B∇H_j, has the status UNDEFINED.
"""

from __future__ import annotations

import numpy as np

from sepv.average import average_gradient, average_hessian
from sepv.fields import contract, matmul, matvec
from sepv.implicit import Increment, Solution, Status
from sepv.implicit import solve as solve_implicit
from sepv.problem import Array, Problem
from sepv.scheme import Scheme, as_lanes, step_by
from sepv.structures import (
    CommutingStructure,
    combined,
    combined_slope,
    noise_structures,
    undefined,
)


def parts(problem: Problem, h: float, noise: Array) -> Array:
    """h and the c_j ΔW_j, (1 + m, M)."""
    return np.concatenate([np.full((1, noise.shape[1]), float(h)), problem.c[:, None] * noise])


def increment(problem: Problem, y0: Array, y1: Array, step: Array) -> Increment:
    """[h B(ȳ) + Σ c_j ΔW_j G_j(ȳ)] ∇̄H; B and all G_j count as one evaluation."""
    mean = average_gradient(problem, y0, y1)
    value = matvec(combined(problem, y0 + 0.5 * (y1 - y0), step), mean.value)
    return Increment(value, mean.evaluations, np.ones_like(mean.evaluations), mean.reliable)


def jacobian(problem: Problem, y0: Array, y1: Array, step: Array) -> Array | None:
    """∂/∂y1 of `increment`; None where the problem does not give all derivatives."""
    middle = y0 + 0.5 * (y1 - y0)
    slope, curvature = combined_slope(problem, middle, step), average_hessian(problem, y0, y1)
    if slope is None or curvature is None:
        return None
    mean = average_gradient(problem, y0, y1)
    return 0.5 * contract(slope, mean.value) + matmul(combined(problem, middle, step), curvature)


def solve(problem: Problem, y: Array, h: float, dW: Array, start: Array | None = None) -> Solution:
    """One step of a batch with residual, counts and status of each lane; `start` (d, M) is a guess of y1 − y0."""
    state, noise = as_lanes(problem, y, h, dW)
    shares = parts(problem, h, noise)
    solution = solve_implicit(problem, state, shares, increment, jacobian, start)
    if any(isinstance(G, CommutingStructure) for G in noise_structures(problem)):
        _mark_undefined(problem, state, shares, solution)
    return solution


def _mark_undefined(problem: Problem, y0: Array, step: Array, solution: Solution) -> None:
    """The status UNDEFINED where a structure is none at y0, or does not stand for B∇H_j in the step that was found."""
    with np.errstate(all="ignore"):
        nowhere = ~np.isfinite(combined(problem, y0, step)).all(axis=(0, 1)) & np.isfinite(
            problem.structure(y0)
        ).all(axis=(0, 1))
        mean = average_gradient(problem, y0, solution.value)
        away = undefined(problem, y0, solution.value, mean.value, step)
    solved = solution.status == Status.CONVERGED
    solution.gradient_evaluations[:] += mean.evaluations
    solution.structure_evaluations[:] += 1
    solution.status[(solved & away) | (~solved & nowhere)] = Status.UNDEFINED


def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """One step, for y of shape (d,) or (d, M) and dW of shape (m,) or (m, M).

    Raises
    ------
    StepFailure
        Where the implicit equation was not solved.
    """
    return step_by(solve, problem, y, h, dW)


scheme = Scheme(
    name="several-structures",
    step=step,
    claims=(
        "contract",
        "reproducibility",
        "identity",
        "energy",
        "casimir",
        "reduction",
        "noise-sum",
        "expansion",
        "symmetry",
        "equivariance",
        "reference",
        "rounding",
        "truncation",
        "commutation",
    ),
    mean_square_order=1.0,
    weak_order=1.0,
    source="Cohen and Dujardin (2014), §1",
    solve=solve,
    batched=True,
    systems="several",
)
