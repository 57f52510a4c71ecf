"""The drift-preserving scheme for additive noise: E[H_0] changes at the exact rate,
over steps of any length.

The systems are dy = B(y)∇H_0 dt + Σ_j c_j f_j dW_j with constant f_j, in the image of B or not. The
energy-preserving step (2.1) without noise is taken between two halves of the noise (D. Cohen and G.
Vilmart, Drift-preserving numerical integrators for stochastic Poisson systems, Int. J. Comput.
Math. 99, 2022; arXiv 2005.13991),

    Y = y0 + Σ_j c_j ΔŴ_j′ f_j,   Z = Y + h B((Y + Z)/2) ∫₀¹∇H_0(Y + τ(Z − Y))dτ,
    y1 = Z + Σ_j c_j ΔŴ_j″ f_j,

where ΔW_j′ and ΔW_j″ are the increments over the first and the second half of the step. If H_0
is quadratic along the f_j, E[H_0(y + Σ c_j ΔW_j f_j)] = H_0(y) + ½ Σ c_j² f_jᵀH_0″f_j
Var(ΔW_j) with constant f_jᵀH_0″f_j (trace formula). The step from Y to Z keeps H_0, so that
E[H_0(y_n)] = H_0(y_0) + nh · ½ Σ c_j² f_jᵀH_0″f_j, as for the exact solution. For quadratic
Casimirs C = yᵀAy of B, E[C(y_n)] = C(y_0) + nh Σ c_j² f_jᵀAf_j likewise. The composition is
Strang's, and the paper proves mean-square order 1 and weak order 2.
"""

from __future__ import annotations

import numpy as np

from sepv.core.problem import require_undamped
from sepv.errors import Skipped
from sepv.problem import Array, Problem, Systems, column, noise_field
from sepv.schemes._energy_preserving import formula, jacobian
from sepv.schemes._one_step import CLAIMS_OF_ALL, implicit, one_step
from sepv.schemes._scheme import as_lanes


def _time(problem: Problem, h: float, noise: Array) -> Array:  # noqa: ARG001  (the signature of `parts`)
    """The length h of the step without noise, for each of M paths: (1, M)."""
    return np.full((1, noise.shape[1]), float(h))


# Scheme (2.1) without its noise.
quiet_step = implicit(formula, jacobian, parts=_time)


def step(problem: Problem, y: Array, h: float, dW: Array, first: Array) -> Array:
    """y1 from y (d,) or (d, M). `dW` and `first`, (m,) or (m, M),
    are the increments of the step and its first half.

    Raises Skipped if the noise is not additive, and StepFailure if the equation was not solved.
    """
    if column(problem) != "additive":
        raise Skipped(f"the noise of {problem.name} is not additive")
    require_undamped(problem)
    state, noise = as_lanes(problem, y, h, dW)
    before = np.reshape(np.asarray(first, dtype=np.float64), noise.shape)
    moved = quiet_step(problem, pushed_by_noise(problem, state, before), h, noise)
    return pushed_by_noise(problem, moved, noise - before).reshape(y.shape)


def pushed_by_noise(problem: Problem, y: Array, dW: Array) -> Array:
    """The state y + Σ c_j ΔW_j f_j, moved by the constant noise fields f_j alone."""
    for j, (c, increment) in enumerate(zip(problem.c, dW, strict=True)):
        y = y + c * increment * noise_field(problem, j, y)
    return y


scheme = one_step(
    "drift-preserving",
    step,
    CLAIMS_OF_ALL | {"symmetry", "invariant:energy", "invariant:casimir"},
    "Cohen and Vilmart (2022)",
    weak_order=2.0,
    truncation=None,
    systems=Systems.ADDITIVE,
    asks="halves",
)
