"""Collocation with s stages for several structures G_j: mean-square order s if all fields commute.

With the increments of a step fixed, dy = B∇H dt + Σ c_j G_j∇H ∘dW_j becomes y′ = P(y)∇H, P = h
B + Σ c_jΔW_j G_j, over one unit of time. If all fields commute, the flow of y′ = P(y)∇H is the
exact step. The s-stage method of Cohen and Hairer (2011) for this equation has a local error of
order 2s + 1 in √h, so that the mean-square order is s. The method keeps H, because P is skew,
and quadratic Casimirs common to all structures. If the fields do not commute, the order is that
of `sepv.schemes.several_structures`.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from sepv.problem import Array, Problem, combined, combined_slope, each_noise
from sepv.schemes import as_lanes, collocation


def step_with_stages(problem: Problem, stages: int, y: Array, h: float, dW: Array) -> Array:
    """The state y1 after one step with s = 1 … 6 stages, for y (d,) or (d, M) and dW (m,)
    or (m, M).

    Paths are solved in turn, because the increments of each path give it its own matrix P.

    Raises StepFailure if the implicit equation of a path is not solved.
    """
    state, noise = as_lanes(problem, y, h, dW)
    step = collocation(stages).step
    parts = each_noise(problem, h, noise)
    flows = [problem_of_step(problem, parts[:, k]) for k in range(state.shape[1])]
    ends = [step(flow, state[:, k], 1.0, np.empty(0)) for k, flow in enumerate(flows)]
    return np.stack(ends, axis=1).reshape(np.shape(y))


def problem_of_step(problem: Problem, parts: Array) -> Problem:
    """The problem y′ = P(y)∇H without noise, P = h B + Σ c_jΔW_j G_j,
    for `parts` = (h, c_1ΔW_1, …).

    A method's step with noise is the method's step over one unit of time on this problem.
    """
    slope: Any = partial(combined_slope, problem, parts=parts)
    given = combined_slope(problem, np.array(problem.initial)[:, None], parts[:, None]) is not None
    return Problem(
        problem.dimension,
        partial(combined, problem, parts=parts),
        problem.hamiltonian,
        problem.gradient,
        noise=(),
        hessian=problem.hessian,
        structure_derivative=slope if given else None,
        degree=problem.degree,
        name=f"a step of {problem.name}",
        check=False,
    )
