"""A Poisson integrator for Lotka-Volterra structures: the midpoint rule in logarithms,
Darboux and Lie's coordinates.

If B_ij(y) = b_ij y_i y_j, the logarithms x_i = ln y_i have the constant structure b and
Hamiltonians K(x) = H(exp x). A symplectic method in x keeps the structure and every linear Casimir
Σ γ_i x_i of b, which is the Casimir Σ γ_i ln y_i of B. All components of y stay positive:

    x1 = x0 + f(ȳ)/ȳ,  ȳ = exp((x0 + x1)/2),  f = B(h∇H_0 + Σ c_j ΔŴ_j ∇H_j)
    (ΔŴ_j: truncated ΔW_j),

because b∇K(x) = B(y)∇H(y)/y, component by component. J. Hong, J. Ruan, L. Sun and L. Wang,
Structure-preserving numerical methods for stochastic Poisson systems (Commun. Comput. Phys. 29,
2021), construct such integrators, and so do Q. Liu and L. Wang (J. Univ. Chin. Acad. Sci. 41, 2024)
for stochastic Lotka-Volterra systems, with mean-square order 1. This scheme uses increments alone,
so that its order is 1 if the noises commute, and ½ otherwise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sepv.core.formula import Increment
from sepv.core.newton import Status
from sepv.core.step import Solution
from sepv.core.step import solve as solve_implicit
from sepv.errors import Skipped
from sepv.problem import Array, Problem, each_noise, hamiltonian_field, sample_states
from sepv.schemes._one_step import CLAIMS_OF_ALL, Solved, no_jacobian, one_step
from sepv.schemes._order_claims import Orders

DARBOUX_PROBLEMS = ("lotka-volterra", "random-lotka-volterra")


def increment(problem: Problem, x0: Array, x1: Array, step: Array) -> Increment:
    """R of the step x1 = x0 + R for x = ln y: f(ȳ)/ȳ with f = B(h∇H_0 + Σ c_j ΔŴ_j ∇H_j),
    counted as one evaluation.
    """
    middle = np.exp(x0 + 0.5 * (x1 - x0))
    return Increment(hamiltonian_field(problem, middle, step) / middle)


def require_products(problem: Problem) -> None:
    """Raise Skipped if B_ij(y)/(y_i y_j) is not constant over the sample states of a problem."""
    ratios = [problem.structure(y) / np.outer(y, y) for y in sample_states(problem) if np.all(y > 0)]
    if not ratios or np.ptp(ratios, axis=0).max() > 1e-12 * np.abs(ratios).max():
        raise Skipped(f"the structure of {problem.name} is not B_ij = b_ij y_i y_j")


def solve(problem: Problem, y: Array, h: float, dW: Array) -> Solution:
    """Solve one step of a batch y (d, M), dW (m, M); the solution's residual is that of the
    equation for x = ln y.
    """
    require_products(problem)
    free = replace(problem, domain=None, check=False)  # logarithms may have any sign
    solution = solve_implicit(free, np.log(y), each_noise(problem, h, dW), increment, no_jacobian)
    assert solution.change is not None
    # y1 is y0 times a factor, so that a step of length zero leaves y0 unchanged.
    value = y * np.exp(solution.change)
    status = np.where(np.all(np.isfinite(value), axis=0), solution.status, Status.OVERFLOW)
    return replace(solution, value=value, change=value - y, status=status)


scheme = one_step(
    "darboux-lie",
    Solved(solve),
    CLAIMS_OF_ALL | {"identity", "invariant:casimir", "poisson-map", "positivity", "symmetry"},
    "the midpoint rule in logarithms (Hong et al. 2021; Liu and Wang 2024)",
    weak_order=1.0,
    mean_square_order=Orders(0.5, commutative=1.0),
    problems=DARBOUX_PROBLEMS,
)
