"""The energy-preserving scheme (2.1); for constant B it is (2.2), the averaged vector field method.

y1 = y0 + B((y0 + y1)/2) ∫₀¹ ∇H(y0 + τ(y1 − y0)) dτ · Δ,  Δ = h + Σ_j c_j ΔŴ_j.
"""

from __future__ import annotations

from typing import Any

from sepv.average import average_gradient, average_hessian
from sepv.fields import contract, matmul, matvec
from sepv.formula import Fields, counted
from sepv.implicit import Increment, Solution
from sepv.implicit import solve as solve_implicit
from sepv.problem import Array, Problem
from sepv.scheme import Scheme, as_lanes, step_by


def formula(fields: Fields, y: Any, z: Any, delta: Any) -> Any:
    """Δ B(ȳ) ∇̄H, ȳ = y + z/2: the right side of (2.1) without y0, for z = y1 − y0."""
    return delta * matvec(fields.structure(y + 0.5 * z), fields.mean_gradient(y, z))


def increment(problem: Problem, y0: Array, y1: Array, step: Array) -> Increment:
    """The formula with its counts; `step` is (1, M), holding Δ."""
    return counted(formula, problem, y0, y1, step[0], parts=True)


def jacobian(
    problem: Problem,
    y0: Array,
    y1: Array,
    step: Array,
    mean: Array | None = None,
    B: Array | None = None,
) -> Array | None:
    """∂/∂y1 of `increment`: Δ(½ B′(ȳ)[·]∇̄H + B(ȳ) ∫τH″dτ), from ∇̄H and B(ȳ) where they are known."""
    if problem.structure_derivative is None or problem.hessian is None:
        return None
    middle = y0 + 0.5 * (y1 - y0)
    slope = average_hessian(problem, y0, y1)
    assert slope is not None  # the problem has a Hessian
    mean = average_gradient(problem, y0, y1).value if mean is None else mean
    B = problem.structure(middle) if B is None else B
    turned = contract(problem.structure_derivative(middle), mean)
    return step[0] * (0.5 * turned + matmul(B, slope))


def solve(problem: Problem, y: Array, h: float, dW: Array, start: Array | None = None) -> Solution:
    """One step of a batch with residual, counts and status of each lane; `start` (d, M) is a guess of y1 − y0."""
    state, noise = as_lanes(problem, y, h, dW)
    return solve_implicit(problem, state, problem.random_step(h, noise)[None], increment, jacobian, start)


def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """One step of (2.1).

    Parameters
    ----------
    y : (d,) or (d, M)
    h : float
        Of either sign: −h with −dW is the inverse step.
    dW : (m,) or (m, M)
        Wiener increments, truncated by the caller where he wants Remark 2.1.

    Raises
    ------
    StepFailure
        Where the implicit equation was not solved.
    """
    return step_by(solve, problem, y, h, dW)


scheme = Scheme(
    name="energy-preserving",
    step=step,
    claims=(
        "contract",
        "reproducibility",
        "identity",
        "energy",
        "casimir",
        "midpoint",
        "reduction",
        "noise-sum",
        "random-step",
        "expansion",
        "symmetry",
        "equivariance",
        "reference",
        "rounding",
        "truncation",
    ),
    mean_square_order=1.0,
    weak_order=1.0,
    source="Cohen and Dujardin (2014), equation (2.1)",
    solve=solve,
    batched=True,
)
