"""Damping by exponentials around a step Φ of (2.1) without damping:
y1 = e^{−γh/2} Φ_{h,ΔŴ}(e^{−γh/2} y0).

This is G. Strang's composition of the flow of −γy dt and the energy-preserving step, for dy = (B∇H
− γy)dt + Σ c_j B∇H ∘dW_j. C.-E. Bréhier, D. Cohen and Y. Komori, Stochastic conformal integrators
for linearly damped stochastic Poisson systems (arXiv 2503.01540), use this composition with
discrete gradients; only abstract and introduction were read.

Φ keeps H and quadratic and linear Casimirs, and F(e^{−γh/2}y) = e^{−pγh/2}F(y) for a homogeneous F
of degree p. So

    C(y1) = e^{−2γh}C(y0) for C = yᵀAy,   C(y1) = e^{−γh}C(y0) for C = bᵀy,
    H(y1) = e^{−pγh}H(y0) if H has degree p,

as along the exact solution. The scheme is symmetric. The first term that the composition lacks is a
bracket times ∫(s − h/2)dW(s), which has mean zero and is of the order of h^{3/2}, so that the
mean-square order is 1.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sepv.core.problem import System
from sepv.core.step import Solution
from sepv.errors import Skipped
from sepv.problem import Array, Problem, Systems, uniform_damping
from sepv.schemes._energy_preserving import formula, jacobian
from sepv.schemes._one_step import CLAIMS_OF_ALL, Solved, implicit, one_step


def undamped_step(problem: Problem, h: float, noise: Array) -> Array:
    """The random step Δ = h + Σ c_j ΔŴ_j, (1, M), of the step Φ;
    `Problem.random_step` would raise an error.
    """
    return System.random_step(problem, h, noise)[None]


undamped = implicit(formula, jacobian, parts=undamped_step)


def solve(problem: Problem, y: Array, h: float, dW: Array) -> Solution:
    """Solve one step of a batch y (d, M), dW (m, M). Raises Skipped for a problem without
    damping.
    """
    rate = uniform_damping(problem)
    if not rate:
        raise Skipped(f"{problem.name} has no damping −γy (sepv.problem.DampedProblem)")
    factor = np.exp(-0.5 * h * rate)
    solution = undamped.solve(problem, factor * y, h, dW)
    value = factor * solution.value
    return replace(solution, value=value, change=value - y)


scheme = one_step(
    "conformal",
    Solved(solve),
    CLAIMS_OF_ALL | {"invariant:casimir", "invariant:energy", "symmetry"},
    "(2.1) between exponentials; Bréhier, Cohen and Komori, arXiv 2503.01540",
    systems=Systems.DAMPED,
)
