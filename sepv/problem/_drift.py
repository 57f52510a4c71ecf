"""The drift B∇H − Γy of a problem with linear damping, and its matrix Γ."""

from __future__ import annotations

import numpy as np

from sepv.core.arrays import Array, matvec
from sepv.core.problem import System, vector_field


def damping_matrix(problem: System) -> Array:
    """The matrix Γ (d, d) of the drift B∇H − Γy: γ times the unit matrix for −γy,
    zero without damping.
    """
    damping = np.asarray(problem.damping, dtype=np.float64)
    return damping if damping.ndim else damping * np.eye(problem.dimension)


def drift(problem: System, y: Array) -> Array:
    """The drift B(y)∇H − Γy of a problem, (d, ...), where Γy is γy for a number γ and 0 without
    damping.
    """
    flow = vector_field(problem, y)
    if np.ndim(problem.damping):
        Gamma = damping_matrix(problem)
        return flow - matvec(Gamma.reshape(*Gamma.shape, *(1,) * (y.ndim - 1)), y)
    return np.asarray(flow - problem.damping * y)
