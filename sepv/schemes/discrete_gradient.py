"""The stochastic discrete gradient scheme of §4, as printed there:

y1 = y0 + h B(y0) ∇̄H(y0, y1) + B((y0 + y1)/2) ∇̄H(y0, y1) Σ_j c_j ΔŴ_j,

with B at y0 in the drift and at the midpoint in the noise, and the symmetrised coordinate-increment
discrete gradient ∇̄H(y, ȳ) = ½(∇̄₁H(y, ȳ) + ∇̄₁H(ȳ, y)).
"""

from __future__ import annotations

import numpy as np

from sepv.average import average_gradient, average_hessian
from sepv.fields import contract, matmul, matvec
from sepv.implicit import Increment, Solution
from sepv.implicit import solve as solve_implicit
from sepv.problem import Array, Problem
from sepv.scheme import Scheme, as_lanes, step_by


def corners(y0: Array, y1: Array) -> Array:
    """The path of coordinate increments: (d, d + 1, M), corner i has its first i components from y1."""
    d = y0.shape[0]
    path = np.repeat(y0[:, None], d + 1, axis=1)
    for i in range(d):
        path[i, i + 1 :] = y1[i]
    return path


def coordinate_increments(problem: Problem, y0: Array, y1: Array) -> tuple[Array, np.ndarray, np.ndarray]:
    """∇̄₁H(y0, y1): component i is (H(corner i+1) − H(corner i))/(y1_i − y0_i).

    The quotient is the average of ∂_iH along that edge, and is computed as that average: where a
    component does not move it is ∂_iH there, and where it hardly moves no digits are lost.
    """
    d = y0.shape[0]
    path = corners(y0, y1)
    mean = average_gradient(problem, path[:, :-1], path[:, 1:])
    value = np.stack([mean.value[i, i] for i in range(d)])
    return value, np.sum(mean.evaluations, axis=0), np.all(mean.reliable, axis=0)


def increment(problem: Problem, y0: Array, y1: Array, step: Array) -> Increment:
    """(h B(y0) + S B(ȳ)) ∇̄H; `step` is (2, M), holding h and S = Σ c_j ΔŴ_j."""
    forward, cost_forward, reliable_forward = coordinate_increments(problem, y0, y1)
    backward, cost_backward, reliable_backward = coordinate_increments(problem, y1, y0)
    value = matvec(_weighted_structure(problem, y0, y1, step), 0.5 * (forward + backward))
    cost = cost_forward + cost_backward
    return Increment(value, cost, np.full_like(cost, 2), reliable_forward & reliable_backward)


def jacobian(problem: Problem, y0: Array, y1: Array, step: Array) -> Array | None:
    """∂/∂y1 of `increment`."""
    if problem.structure_derivative is None or problem.hessian is None:
        return None
    d = problem.dimension
    slope = np.zeros((d, *y0.shape))
    for start, end, moves_first in ((y0, y1, True), (y1, y0, False)):
        path = corners(start, end)
        plain = average_hessian(problem, path[:, :-1], path[:, 1:], weighted=False)
        tilted = average_hessian(problem, path[:, :-1], path[:, 1:])
        assert plain is not None
        assert tilted is not None  # the problem has a Hessian
        for i in range(d):
            # On edge i the components before i are those of `end`, those after i those of `start`.
            moved = range(i) if moves_first else range(i + 1, d)
            for k in moved:
                slope[i, k] += 0.5 * plain[i, k, i]
            slope[i, i] += 0.5 * (tilted[i, i, i] if moves_first else plain[i, i, i] - tilted[i, i, i])
    mean = 0.5 * (coordinate_increments(problem, y0, y1)[0] + coordinate_increments(problem, y1, y0)[0])
    turned = contract(problem.structure_derivative(y0 + 0.5 * (y1 - y0)), mean)
    return 0.5 * step[1] * turned + matmul(_weighted_structure(problem, y0, y1, step), slope)


def _weighted_structure(problem: Problem, y0: Array, y1: Array, step: Array) -> Array:
    return step[0] * problem.structure(y0) + step[1] * problem.structure(y0 + 0.5 * (y1 - y0))


def _parts(problem: Problem, h: float, noise: Array) -> Array:
    return np.stack([np.full(noise.shape[1], float(h)), problem.random_step(0.0, noise)])


def solve(problem: Problem, y: Array, h: float, dW: Array, start: Array | None = None) -> Solution:
    """One step of a batch with residual, counts and status of each lane; `start` (d, M) is a guess of y1 − y0."""
    state, noise = as_lanes(problem, y, h, dW)
    return solve_implicit(problem, state, _parts(problem, h, noise), increment, jacobian, start)


def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """One step, for y of shape (d,) or (d, M) and dW of shape (m,) or (m, M).

    Raises
    ------
    StepFailure
        Where the implicit equation was not solved.
    """
    return step_by(solve, problem, y, h, dW)


scheme = Scheme(
    name="discrete-gradient",
    step=step,
    claims=(
        "contract",
        "reproducibility",
        "identity",
        "energy",
        "noise-sum",
        "rounding",
        "truncation",
    ),
    mean_square_order=1.0,
    weak_order=1.0,
    source="Cohen and Dujardin (2014), §4",
    solve=solve,
    batched=True,
)
