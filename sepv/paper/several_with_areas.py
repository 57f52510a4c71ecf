"""A scheme for several structures G_j with Lévy areas:
mean-square order 1 even if the noises do not commute.

y1 = y0 + [h B(ȳ) + Σ_j c_j ΔW_j G_j(ȳ) + Σ_{i<j} c_i c_j A_ij K_ij(ȳ)] ∫₀¹ ∇H(y0 + τ(y1 − y0)) dτ

with the Lévy areas A_ij = ½∫(W_i dW_j − W_j dW_i) over the step. A scheme without areas lacks the
term Σ_{i<j} A_ij (f_j′f_i − f_i′f_j), f_j = c_j G_j∇H, which is of the order of h in the
Stratonovich expansion of the solution (P. Kloeden and E. Platen, Numerical Solution of Stochastic
Differential Equations, 1992, §5.2). With g = ∇H and g′ = H″,

    f_j′f_i − f_i′f_j = c_i c_j K_ij g,   K_ij = G_j′(G_ig) − G_i′(G_jg) + G_jH″G_i − G_iH″G_j,

and K_ij is skew because H″ is symmetric. So H is kept as in Proposition 3.1, for all B, G_j,
increments and areas.

`step_with_areas(problem, y, h, dW, areas)` takes y (d,) or (d, M), dW (m,) or (m, M) and the areas
A_ij of the same increments, (m, m) or (m, m, M). This module does not draw the areas.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from sepv.core.formula import Increment
from sepv.errors import UsageError
from sepv.problem import (
    Array,
    Problem,
    average_gradient,
    combined,
    hessian,
    matmul,
    matvec,
    one_field,
    one_hamiltonian,
    turned_along,
)
from sepv.schemes import Implicit, noise_and_areas


def commutator(problem: Problem, i: int, j: int, y: Array, mean: Array) -> Array:
    """The skew matrix K_ij, (d, d, M), by the formula of the module's docstring with ∇H = `mean` at
    states y.
    """
    (Gi, Di), (Gj, Dj) = (
        (F.structure(y), F.structure_derivative(y)) for F in (problem.channels[1 + n] for n in (i, j))
    )
    curved = hessian(problem, y)
    curved = 0.5 * (curved + np.swapaxes(curved, 0, 1))  # differences are not symmetric
    crossed = matmul(matmul(Gj, curved), Gi)
    turned = turned_along(Dj, matvec(Gi, mean)) - turned_along(Di, matvec(Gj, mean))
    return turned + crossed - np.swapaxes(crossed, 0, 1)


def require_derivatives(problem: Problem) -> None:
    """Raise a UsageError unless the problem has structures G_j for the noises,
    with their derivatives.
    """
    if one_field(problem) or not one_hamiltonian(problem) or problem.structure_derivatives is None:
        raise UsageError(
            expected="a problem with several structures that gives their derivatives",
            received=problem.name,
            remedy="sepv.problem.StructuresProblem(…, noise_structure_derivatives=…)",
        )


def increment(problem: Problem, y0: Array, y1: Array, known: Array) -> Increment:
    """The increment R = y1 − y0 of the step; `known` (k, M) holds h, all c_j ΔW_j,
    and all c_i c_j A_ij with i < j.

    An evaluation of B with all G_j is counted as one.
    """
    mean, middle, first = average_gradient(problem, y0, y1), y0 + 0.5 * (y1 - y0), 1 + problem.noises
    structure = combined(problem, middle, known[:first])
    for area, (i, j) in zip(known[first:], combinations(range(problem.noises), 2), strict=True):
        structure = structure + area * commutator(problem, i, j, middle, mean.value)
    counts = np.ones_like(mean.evaluations)
    return Increment(matvec(structure, mean.value), mean.evaluations, counts, mean.reliable)


# Newton's matrix is made from differences, because K_ij′ would need third derivatives of H.
step_with_areas = Implicit(increment, parts=noise_and_areas, requires=require_derivatives)
