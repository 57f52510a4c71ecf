"""Splitting with the exact flows of B∇H_0 (or parts of it) and of each B∇H_j: a Poisson integrator.

y1 = φ⁰_{h/2} ∘ φ¹_{c_1ΔŴ_1/2} ∘ … ∘ φᵐ_{c_mΔŴ_m} ∘ … ∘ φ¹_{c_1ΔŴ_1/2} ∘ φ⁰_{h/2} (y0)
(ΔŴ_j: truncated ΔW_j)

C.-E. Bréhier, D. Cohen and T. Jahnke, Splitting integrators for stochastic Lie-Poisson systems
(Math. Comp. 92, 2023), use the composition of Lie and Trotter. This scheme uses G. Strang's, which
is symmetric. Each flow φʲ_t of B∇H_j over the time t is a Poisson map and keeps all Casimirs and
the domain, and so does the composition.

For fixed increments a step agrees with the flow of K = hH_0 + Σ c_j ΔŴ_j H_j up to second order in
K, but has no Lévy areas. The mean-square order is therefore ½ in general and 1 if the noises'
fields commute. The weak order is 1.
"""

from __future__ import annotations

from sepv.core.problem import require_undamped
from sepv.errors import Skipped
from sepv.problem import Array, Problem
from sepv.schemes._one_step import CLAIMS_OF_ALL, one_step
from sepv.schemes._order_claims import Orders
from sepv.schemes._scheme import as_lanes

SPLITTING_PROBLEMS = ("random-inertia", "random-maxwell-bloch", "noisy-henon-heiles", "random-lotka-volterra")


def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """y1 of one step for y of shape (d,) or (d, M) and dW of shape (m,) or (m, M).

    Raises Skipped for a problem without `flows` of parts of H_0, or without `noise_flows`.
    """
    require_undamped(problem)
    noise_flows = getattr(problem, "noise_flows", ())
    if not problem.flows or not noise_flows:
        raise Skipped(f"{problem.name} gives no exact flows of its Hamiltonians (flows, noise_flows)")
    state, noise = as_lanes(problem, y, h, dW)
    half = state[0] * 0 + 0.5 * h
    times = 0.5 * problem.c[:, None] * noise
    outer = [*((flow, half) for flow in problem.flows), *zip(noise_flows, times, strict=True)]
    for flow, t in (*outer, *outer[::-1]):
        state = flow(state, t)
    return state.reshape(y.shape)


scheme = one_step(
    "stochastic-splitting",
    step,
    CLAIMS_OF_ALL | {"identity", "casimir", "poisson-map", "poisson-map:constant", "positivity", "symmetry"},
    "Bréhier, Cohen and Jahnke (2023), composed as Strang's",
    weak_order=1.0,
    mean_square_order=Orders(0.5, commutative=1.0),
    problems=SPLITTING_PROBLEMS,
)
