"""The implicit schemes (2.1) and (3.4) solved in arbitrary precision, by Newton with a proof of smallness.

The Jacobian comes from differences at the working precision, whose error of 10^(−digits/2) leaves
Newton's iteration converging by half the digits a step. Nothing of the core's solve is used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import mpmath
from sepv.reference.problem import ExactProblem, Vector, exact_problem

from sepv.errors import StepFailure
from sepv.problem import NamedProblem, PolynomialSystem

Residual = Callable[[Vector], Vector]


class ReferenceStep(NamedTuple):
    """y1 (mpf list), and |(I − ∂R/∂y1)⁻¹| entrywise in floats: how residuals become errors of y1."""

    y1: Vector
    condition: list[list[float]]


def energy_preserving(
    data: PolynomialSystem | NamedProblem, y: Sequence[float], h: float, dW: Sequence[float], digits: int = 50
) -> ReferenceStep:
    """Equation (2.1): y1 = y0 + B((y0 + y1)/2) ∫₀¹∇H(y0 + τ(y1 − y0))dτ Δ."""
    problem = exact_problem(data, digits + 15)
    y0, delta = problem.state(y), problem.random_step(h, dW)

    def right_side(y1: Vector) -> Vector:
        middle = [(a + b) / 2 for a, b in zip(y0, y1, strict=True)]
        return [delta * v for v in problem.apply(problem.structure(middle), problem.mean_gradient(y0, y1))]

    return _solve(problem, y0, right_side, digits, delta)


def averaged_vector_field(
    data: PolynomialSystem | NamedProblem, y: Sequence[float], h: float, dW: Sequence[float], digits: int = 50
) -> ReferenceStep:
    """Equation (2.2), for constant B: y1 = y0 + B ∫₀¹∇H(y0 + τ(y1 − y0))dτ Δ, B taken once, at y0."""
    problem = exact_problem(data, digits + 15)
    y0, delta = problem.state(y), problem.random_step(h, dW)
    B = problem.structure(y0)

    def right_side(y1: Vector) -> Vector:
        return [delta * v for v in problem.apply(B, problem.mean_gradient(y0, y1))]

    return _solve(problem, y0, right_side, digits, delta)


def midpoint(
    data: PolynomialSystem | NamedProblem, y: Sequence[float], h: float, dW: Sequence[float], digits: int = 50
) -> ReferenceStep:
    """Equation (3.4): y1 = y0 + f((y0 + y1)/2) Δ."""
    problem = exact_problem(data, digits + 15)
    y0, delta = problem.state(y), problem.random_step(h, dW)

    def right_side(y1: Vector) -> Vector:
        return [delta * v for v in problem.field([(a + b) / 2 for a, b in zip(y0, y1, strict=True)])]

    return _solve(problem, y0, right_side, digits, delta)


def _solve(problem: ExactProblem, y0: Vector, right_side: Residual, digits: int, delta: Any) -> ReferenceStep:
    """y1 = y0 + R(y1), continued from y0, to 10^−digits of the scale of y.

    Raises
    ------
    StepFailure
        Where 60 iterations do not get there.
    """
    ctx, d = problem.ctx, problem.dimension
    y1, iterations = list(y0), 0
    scale = max(abs(v) for v in y0) or ctx.one
    goal = scale * ctx.mpf(10) ** (-digits - 5)
    width = scale * ctx.mpf(10) ** (-(digits + 15) // 2)
    for _ in range(60):
        value = right_side(y1)
        residual = [b - a - r for a, b, r in zip(y0, y1, value, strict=True)]
        # Early iterates are far off: their Jacobian serves Newton, the last one is the condition.
        jacobian = ctx.eye(d)
        for k in range(d):
            shifted = list(y1)
            shifted[k] += width
            for i, (r, base) in enumerate(zip(right_side(shifted), value, strict=True)):
                jacobian[i, k] -= (r - base) / width
        try:
            correction = list(ctx.lu_solve(jacobian, ctx.matrix(residual)))
        except ZeroDivisionError:
            correction = [ctx.mpf("nan")] * d
        size = max((abs(c) for c in correction), default=ctx.zero)
        # A logarithm of a negative number makes the iterate complex: it left the domain.
        if not mpmath.isfinite(size) or any(isinstance(c, ctx.mpc) for c in correction):
            break
        iterations += 1
        y1 = [b - c for b, c in zip(y1, correction, strict=True)]
        if size <= goal:
            inverse = jacobian**-1
            return ReferenceStep(y1, [[abs(float(inverse[i, j])) for j in range(d)] for i in range(d)])
    raise StepFailure(
        problem=f"{problem.data!r:.80} (reference)",
        y=[float(v) for v in y0],  # type: ignore[arg-type]  # printed only
        delta=float(delta),
        residual=float(max(abs(r) for r in residual)),
        status="no convergence in extended precision",
        iterations=iterations,
    )
