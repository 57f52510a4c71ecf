"""The stochastic midpoint rule of §4: y1 = y0 + f((y0 + y1)/2)(h + Σ_j c_j ΔŴ_j), f = B∇H, equation (3.4)."""

from __future__ import annotations

from typing import Any

from sepv.fields import field_jacobian, matvec
from sepv.formula import Fields, counted
from sepv.implicit import Increment, Solution
from sepv.implicit import solve as solve_implicit
from sepv.problem import Array, Problem
from sepv.scheme import Scheme, as_lanes, step_by


def formula(fields: Fields, y: Any, z: Any, delta: Any) -> Any:
    """Δ f(ȳ), ȳ = y + z/2."""
    middle = y + 0.5 * z
    return delta * matvec(fields.structure(middle), fields.gradient(middle))


def increment(problem: Problem, y0: Array, y1: Array, step: Array) -> Increment:
    """The formula with its counts; `step` is (1, M), holding Δ."""
    return counted(formula, problem, y0, y1, step[0])


def jacobian(problem: Problem, y0: Array, y1: Array, step: Array) -> Array | None:
    """∂/∂y1 of `increment`: ½ Δ f′(ȳ)."""
    slope = field_jacobian(problem, y0 + 0.5 * (y1 - y0))
    return None if slope is None else 0.5 * step[0] * slope


def solve(problem: Problem, y: Array, h: float, dW: Array, start: Array | None = None) -> Solution:
    """One step of a batch with residual, counts and status of each lane; `start` (d, M) is a guess of y1 − y0."""
    state, noise = as_lanes(problem, y, h, dW)
    return solve_implicit(problem, state, problem.random_step(h, noise)[None], increment, jacobian, start)


def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """One step of (3.4), for y of shape (d,) or (d, M) and dW of shape (m,) or (m, M).

    Raises
    ------
    StepFailure
        Where the implicit equation was not solved.
    """
    return step_by(solve, problem, y, h, dW)


scheme = Scheme(
    name="midpoint",
    step=step,
    claims=(
        "contract",
        "reproducibility",
        "identity",
        "casimir",
        "symplecticity",
        "midpoint",
        "noise-sum",
        "random-step",
        "expansion",
        "symmetry",
        "equivariance",
        "truncation",
    ),
    mean_square_order=1.0,
    weak_order=1.0,
    source="Cohen and Dujardin (2014), equation (3.4)",
    solve=solve,
    batched=True,
)
