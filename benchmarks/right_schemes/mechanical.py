"""Correct schemes for mechanical systems, H = ½ pᵀM⁻¹p + V(q), without noise."""

from __future__ import annotations

import numpy as np

from sepv.problem import Array, Problem, mechanics
from sepv.schemes import Explicit, KicksAndDrifts, Scheme, Step, Systems, composed_leapfrogs


def _velocity_verlet(problem: Problem, y: Array, h: float, _dW: Array) -> Array:
    """Velocity Verlet with step h: q1 = q + hv + ½h²a(q), v1 = v + ½h(a(q) + a(q1)), a = M⁻¹F."""
    m = mechanics(problem)
    q, p = m.split(y)
    v, a = m.velocity(p), m.velocity(m.force(q))
    q1 = q + h * v + 0.5 * h * h * a
    return m.join(q1, m.momentum(v + 0.5 * h * (a + m.velocity(m.force(q1)))))


def _unit_masses(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Kick, drift, kick with q1 = q + Δp whatever the masses: symmetric and reversible,
    and of order 0 else.

    See hamiltonian-generative-networks, issue 88: its flow is that of H = ½|p|² + V(q).
    """
    delta, (q, p) = problem.random_step(h, dW), np.split(np.asarray(y), 2)

    def force(q: Array) -> Array:
        return -problem.gradient(np.concatenate([q, 0 * q]))[: len(q)]

    p = p + 0.5 * delta * force(q)
    q = q + delta * p
    return np.concatenate([q, p + 0.5 * delta * force(q)])


def _mechanical(name: str, step: Step, order: float, source: str, *more: str) -> Scheme:
    claims = ("identity", "poisson-map:constant", "poisson-map", "long-time-energy", *more)
    return Scheme(
        name, step, claims, source, order=order, batched=True, systems=Systems.MECHANICAL, noise=False
    )


_SUZUKI = 1 / (4 - 4 ** (1 / 3))
MECHANICAL = (
    _mechanical("velocity-verlet", _velocity_verlet, 2, "Störmer-Verlet in velocities", "symmetry"),
    _mechanical(
        "position-verlet", Explicit(KicksAndDrifts((0.0, 1.0, 0.0), (0.5, 0.5))), 2, "drift, kick, drift", "symmetry"
    ),
    _mechanical(
        "ruth-3", Explicit(KicksAndDrifts((7 / 24, 3 / 4, -1 / 24, 0.0), (2 / 3, -2 / 3, 1.0))), 3,
        "R. Ruth, IEEE Trans. Nucl. Sci. 30 (1983): order 3, not symmetric",
    ),
    _mechanical(
        "suzuki-4", Explicit(composed_leapfrogs((_SUZUKI, _SUZUKI, 1 - 4 * _SUZUKI, _SUZUKI, _SUZUKI))), 4,
        "M. Suzuki, Phys. Lett. A 146 (1990): five leapfrogs", "symmetry",
    ),
    _mechanical(
        "mclachlan-atela-4",
        Explicit(KicksAndDrifts(
            (0.1344961992774310892, -0.2248198030794208058, 0.7563200005156682911, 0.3340036032863214255, 0.0),
            (0.5153528374311229364, -0.085782019412973646, 0.4415830236164665242, 0.1288461583653841854),
        )),
        4, "R. McLachlan and P. Atela, Nonlinearity 5 (1992): order 4, not symmetric",
    ),
)  # fmt: skip
UNIT_MASSES = Scheme(
    "unit-masses",
    _unit_masses,
    ("identity", "symmetry", "reversibility", "random-step", "noise-sum"),
    "Störmer-Verlet of another Hamiltonian",
    systems=Systems.MECHANICAL,
    batched=True,
)
