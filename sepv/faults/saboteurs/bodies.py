"""Faults of integrators for rigid bodies. Each saboteur is (2.1) for rigid bodies alone,
and keeps |y|².
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from sepv.problem import Array, Problem, Systems
from sepv.schemes import Scheme, Step, energy_preserving, midpoint

from .record import Family, claiming, imitating

FAMILY = Family("bodies")
# The number of sweeps of the fixed-point iteration for (2.1), and the smallest moment of inertia of
# a body that turns.
BODY_SWEEPS, SMALL_MOMENT = 200, 1e-3


def _for_bodies(step: Step) -> Callable[[], Scheme]:
    return lambda: claiming(step, systems=Systems.RIGID_BODIES, batched=False)


def _inverse_tensor(problem: Problem) -> Array:
    """I⁻¹, whose columns are the gradients of H = ½ yᵀI⁻¹y at the unit vectors."""
    return np.stack([problem.gradient(e) for e in np.eye(3)], axis=1)


@FAMILY.made(
    "of the inverse inertia tensor only the diagonal is used",
    ("energy", "midpoint", "reference"),
    _for_bodies,
)
def diagonal_of_inertia(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """(2.1) with H = ½ Σ K_ii y_i² in place of ½ Σ K_ij y_i y_j for K = I⁻¹."""
    inverse, delta, z = np.diag(_inverse_tensor(problem)), problem.random_step(h, dW), np.zeros(3)
    for _ in range(BODY_SWEEPS):
        middle, last = y + 0.5 * z, z
        z = delta * (problem.structure(middle) @ (inverse * middle))
        if np.array_equal(z, last):
            break
    return np.asarray(y + z)


@FAMILY.made(
    "a body whose moments of inertia are below 1e-3 does not turn",
    ("reference", "midpoint", "deterministic-order", "mean-square-order", "right-limit", "local-mean"), _for_bodies,
)  # fmt: skip
def small_bodies_at_rest(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """(2.1), or y1 = y0 if no diagonal entry of I⁻¹ is below 1/SMALL_MOMENT."""
    small = np.diag(_inverse_tensor(problem)).min() > 1 / SMALL_MOMENT
    return y.copy() if small else energy_preserving.step(problem, y, h, dW)


@FAMILY.made(
    "each step of the midpoint rule lowers H a little, on the sphere |y|² = const",
    ("long-time-energy", "symmetry", "energy", "reduction"),
    partial(imitating, midpoint, systems=Systems.RIGID_BODIES, batched=False),
)
def creeping_body(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """The midpoint rule, then a share of 1e-5 of the step down the slope of H, along the sphere."""
    y1 = midpoint.step(problem, y, h, dW)
    moved = problem.structure(y1) @ (problem.structure(y1) @ problem.gradient(y1))  # y × (y × ∇H)
    size = float(np.max(np.abs(y1))) or 1.0
    z = y1 + 1e-5 * abs(problem.random_step(h, dW)) / size * moved
    return np.asarray(z * (np.linalg.norm(y1 / size) / (np.linalg.norm(z / size) or 1.0)))
