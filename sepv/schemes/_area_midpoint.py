"""The stochastic midpoint rule with Lévy areas: mean-square order 1 for several Hamiltonians with
any brackets.

y1 = y0 + h f_0(ȳ) + Σ_j c_j ΔŴ_j f_j(ȳ) + Σ_{i<j} c_i c_j A_ij [f_i, f_j](ȳ),
ȳ = (y0 + y1)/2,  f_j = B∇H_j,

with A_ij = ½∫(W_i dW_j − W_j dW_i) over the step and [f_i, f_j] = f_j′f_i − f_i′f_j. The area terms
are the terms of the order of h that `sepv.schemes.stochastic_midpoint` lacks (P. Kloeden and E.
Platen, Numerical Solution of Stochastic Differential Equations, 1992, §10.3). If two fields keep C,
so does their bracket: quadratic and linear Casimirs are kept. If B is constant, the bracket is the
Hamiltonian field of ±{H_i, H_j}, and the rule is symplectic.
"""

from __future__ import annotations

from itertools import combinations

from sepv.core.formula import Increment
from sepv.errors import Skipped
from sepv.problem import Array, Problem, Systems, bracket, hamiltonian_field
from sepv.schemes._one_step import Implicit, noise_and_areas, one_step
from sepv.schemes._stochastic_midpoint import MIDPOINT_CLAIMS


def require_derivatives(problem: Problem) -> None:
    """Raise Skipped for a problem with several noises that lacks second derivatives of its
    Hamiltonians, or B′.

    The brackets [f_i, f_j] need both. Differences of fields would give brackets with only half of
    the digits.
    """
    if problem.noises > 1 and not all(F.hessian and F.structure_derivative for F in problem.channels[1:]):
        raise Skipped(
            f"{problem.name} gives no second derivatives of its Hamiltonians, or no derivatives of B, for brackets"
        )


def increment(problem: Problem, y0: Array, y1: Array, known: Array) -> Increment:
    """R of the step y1 = y0 + R. `known` (k, M) holds h, the c_j ΔW_j,
    and the c_i c_j A_ij with i < j.

    The gradients of all Hamiltonians together count as one evaluation.
    """
    middle, first = y0 + 0.5 * (y1 - y0), 1 + problem.noises
    value = hamiltonian_field(problem, middle, known[:first])
    for area, (i, j) in zip(known[first:], combinations(range(problem.noises), 2), strict=True):
        value = value + area * bracket(problem, 1 + i, 1 + j, middle)
    return Increment(value)


# Newton's matrix is made from differences.
step = Implicit(increment, parts=noise_and_areas, requires=require_derivatives)
scheme = one_step(
    "area-midpoint",
    step,
    MIDPOINT_CLAIMS - {"expansion"},
    "the midpoint rule with Lévy areas",
    systems=Systems.HAMILTONIANS,
    asks="areas",
    solve=None,
)
