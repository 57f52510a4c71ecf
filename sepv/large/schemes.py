"""Steps of (2.1) and of the midpoint rule (3.4) for one large state."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sepv.large.newton import LargeSolution, solve
from sepv.large.problem import LargeProblem, Sparse
from sepv.problem import Array
from sepv.quadrature import gauss_legendre

LargeStep = Callable[[LargeProblem, Array, float], LargeSolution]


def energy_preserving(problem: LargeProblem, y: Array, delta: float) -> LargeSolution:
    """y1 = y0 + Δ B((y0 + y1)/2) ∫₀¹ ∇H(y0 + τ(y1 − y0)) dτ, equation (2.1), for y of shape (d,)."""

    def equation(y0: Array, y1: Array) -> tuple[Array, Callable[[], Sparse]]:
        middle = y0 + 0.5 * (y1 - y0)
        mean, B = average_gradient(problem, y0, y1), problem.structure(middle)

        def slope() -> Sparse:
            K = delta * (B @ average_hessian(problem, y0, y1))
            if problem.structure_slope is not None:
                K = K + 0.5 * delta * problem.structure_slope(middle, mean)
            return K

        return delta * (B @ mean), slope

    return solve(problem, y, equation)


def midpoint(problem: LargeProblem, y: Array, delta: float) -> LargeSolution:
    """y1 = y0 + Δ f((y0 + y1)/2), f = B∇H, equation (3.4), for y of shape (d,)."""

    def equation(y0: Array, y1: Array) -> tuple[Array, Callable[[], Sparse]]:
        middle = y0 + 0.5 * (y1 - y0)
        gradient, B = problem.gradient(middle), problem.structure(middle)

        def slope() -> Sparse:
            K = 0.5 * delta * (B @ problem.hessian(middle))
            if problem.structure_slope is not None:
                K = K + 0.5 * delta * problem.structure_slope(middle, gradient)
            return K

        return delta * (B @ gradient), slope

    return solve(problem, y, equation)


def average_gradient(problem: LargeProblem, y0: Array, y1: Array) -> Array:
    """∫₀¹ ∇H(y0 + τ(y1 − y0)) dτ, exact to rounding."""
    if problem.mean_gradient is not None:
        return problem.mean_gradient(y0, y1)
    assert problem.degree is not None
    points, weights = gauss_legendre(max(1, -(-problem.degree // 2)))
    total = np.zeros_like(y0)
    for tau, weight in zip(points, weights, strict=True):
        total += weight * problem.gradient(y0 + tau * (y1 - y0))
    return total


def average_hessian(problem: LargeProblem, y0: Array, y1: Array) -> Sparse:
    """∫₀¹ τ H″(y0 + τ(y1 − y0)) dτ for Newton's matrix, whose error costs iterations and no accuracy."""
    nodes = 3 if problem.degree is None else max(1, -(-problem.degree // 2))
    points, weights = gauss_legendre(nodes)
    parts = [w * t * problem.hessian(y0 + t * (y1 - y0)) for t, w in zip(points, weights, strict=True)]
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total
