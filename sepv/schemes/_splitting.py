"""Splitting with exact flows: H = ΣH_k, and the flow φᵏ of each B∇H_k has a closed form.

y1 = φ¹_{Δ/2} ∘ … ∘ φⁿ_{Δ} ∘ … ∘ φ¹_{Δ/2} (y0),  Δ = h + Σ_j c_j ΔŴ_j   (ΔŴ_j: truncated ΔW_j),

the symmetric composition of G. Strang (1968) with the random step of (2.1). For the rigid body the
flows are rotations about the axes (R. McLachlan, Phys. Rev. Lett. 71, 1993). For Lotka-Volterra
they are exponentials, which keep every component positive: this is the domain-keeping splitting in
Cohen and Dujardin (2014), §1, their reference [23].

Every φᵏ is a Poisson map and keeps all Casimirs of B, quadratic or not, and so does the
composition. H is not kept, but its error stays bounded if the step is small. The scheme is
explicit, symmetric, and of mean-square and weak order 1.
"""

from __future__ import annotations

from sepv.errors import Skipped
from sepv.problem import Array, Problem
from sepv.schemes._one_step import CLAIMS_OF_ALL, one_step
from sepv.schemes._picture_look import Look
from sepv.schemes._scheme import as_lanes


def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """y1 of one step for y of shape (d,) or (d, M) and dW of shape (m,) or (m, M).

    Raises Skipped for a problem without `Problem.flows`.
    """
    if not problem.flows:
        raise Skipped(f"{problem.name} gives no exact flows of parts of H (Problem.flows)")
    state, noise = as_lanes(problem, y, h, dW)
    delta = problem.random_step(h, noise)
    *outer, inner = problem.flows
    halves = [(flow, 0.5 * delta) for flow in outer]
    for flow, t in (*halves, (inner, delta), *halves[::-1]):
        state = flow(state, t)
    return state.reshape(y.shape)


SPLITTING_CLAIMS = CLAIMS_OF_ALL | {
    "identity", "casimir", "invariant:casimir", "poisson-map", "poisson-map:constant", "volume", "positivity",
    "symmetry",
}  # fmt: skip
scheme = one_step(
    "splitting",
    step,
    SPLITTING_CLAIMS,
    "Strang's composition of exact flows, with the random step of (2.1)",
    look=Look("#7A5230", "#D2A679", "x", "4 1"),
)
