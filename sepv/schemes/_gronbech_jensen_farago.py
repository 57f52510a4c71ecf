"""The method of Grønbech-Jensen and Farago for Langevin dynamics (Mol. Phys. 111, 2013),
equations (21) and (22).

With a = (1 − γh/2)/(1 + γh/2), b = 1/(1 + γh/2), f = −∇V and the noise σΔW of the step,

    q1 = q0 + bh M⁻¹(p0 + ½h f(q0) + ½σΔW),    p1 = a p0 + ½h (a f(q0) + f(q1)) + b σΔW.

For V = ½ω²q² it has the exact ⟨q²⟩ for every stable h. In one degree of freedom det Φ′ = a, which
is not e^{−γh}: .600 for .607 at γh = ½. So the method is not conformal symplectic.
"""

from __future__ import annotations

from sepv.problem import Array, Problem
from sepv.schemes._langevin import of_friction, parts_of
from sepv.schemes._one_step import CLAIMS_OF_ALL


def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """y1 from y (d,) or (d, M) with increments dW (m,) or (m, M).
    Raises Skipped for a problem without γp and σdW.
    """
    own = parts_of(problem)
    q, p = own.mechanics.split(y)
    half, noise, force = 0.5 * own.rate * h, own.pushed(dW), own.mechanics.force(q)
    a, b = (1 - half) / (1 + half), 1 / (1 + half)
    q1 = q + b * h * own.mechanics.velocity(p + 0.5 * h * force + 0.5 * noise)
    return own.mechanics.join(q1, a * p + 0.5 * h * (a * force + own.mechanics.force(q1)) + b * noise)


scheme = of_friction(
    "gronbech-jensen-farago",
    step,
    CLAIMS_OF_ALL | {"equilibrium", "equilibrium:positions"},
    "Grønbech-Jensen and Farago (2013)",
)
