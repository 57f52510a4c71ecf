"""The energy-preserving scheme for several structures,
dy = B∇H dt + Σ_j c_j G_j∇H∘dW_j (paper, §1).

y1 = y0 + [h B(ȳ) + Σ_j c_j ΔŴ_j G_j(ȳ)] ∫₀¹ ∇H(y0 + τ(y1 − y0)) dτ,  ȳ = (y0 + y1)/2
(ΔŴ_j: truncated ΔW_j).

The scheme keeps the energy for all skew B and G_j, as in Proposition 3.1: H(y1)
− H(y0) = ∇̄Hᵀ[…]∇̄H = 0. It keeps quadratic Casimirs common to B and all G_j, as in
Proposition 3.2. Its mean-square order is 1 for one noise, and for noises whose fields
G_j∇H commute. Otherwise it is ½, because the scheme does not use the iterated
integrals ∫W_i∘dW_j, whose terms are then of the order of h. If all G_j = B, it is
(2.1). For Hamiltonians with {H_0, H_j} = 0, `sepv.problem.commuting_hamiltonians`
makes structures G_j = S_j with S_j∇H_0 = B∇H_j. At or next to a critical point of H_0,
S_j∇̄H_0 may not approximate B∇H_j. Such a step has the status UNDEFINED.
"""

from __future__ import annotations

import numpy as np

from sepv.core.formula import Fields, Values, derivative
from sepv.core.newton import Status
from sepv.core.step import Solution
from sepv.problem import (
    Array,
    Problem,
    Systems,
    average_gradient,
    combined,
    each_noise,
    undefined,
)
from sepv.schemes._one_step import ENERGY_PRESERVING, implicit, one_step
from sepv.schemes._order_claims import Orders


def formula(fields: Fields, y: Values, z: Values, step: Values) -> Values:
    """R of the step y1 = y + R: [h B(ȳ) + Σ c_j ΔW_j G_j(ȳ)] ∇̄H with z = y1 − y and ȳ = y + z/2.

    `step` holds h and the c_j ΔW_j. B and all G_j count as one evaluation.
    """
    return fields.apply_combined(y + 0.5 * z, step, fields.mean_gradient(y, z))


def mark_undefined(problem: Problem, y0: Array, step: Array, solution: Solution) -> None:
    """Set the status UNDEFINED for paths with a structure S_j, made for S_j∇H_0 = B∇H_j,
    that fails in the step.

    Either S_j is undefined at y0 and the step was not solved, or S_j∇̄H_0 is far from B∇H_j in the
    solved step.
    """
    if all(F.keeping is F.structure for F in problem.channels):
        return
    with np.errstate(all="ignore"):
        nowhere = ~np.isfinite(combined(problem, y0, step)).all(axis=(0, 1))
        nowhere &= np.isfinite(problem.structure(y0)).all(axis=(0, 1))
        mean = average_gradient(problem, y0, solution.value)
        away = undefined(problem, y0, solution.value, mean.value, step)
    solved = solution.status == Status.CONVERGED
    solution.gradient_evaluations[:] += mean.evaluations
    solution.structure_evaluations[:] += 1
    solution.status[(solved & away) | (~solved & nowhere)] = Status.UNDEFINED


step = implicit(formula, derivative(formula), parts=each_noise, examine=mark_undefined)
scheme = one_step(
    "several-structures",
    step,
    ENERGY_PRESERVING - {"midpoint", "random-step"},
    "Cohen and Dujardin (2014), §1",
    systems=Systems.SEVERAL,
    mean_square_order=Orders(0.5, commutative=1.0),
)
