"""The stochastic discrete gradient scheme of §4, as printed there:

y1 = y0 + h B(y0) ∇̄H(y0, y1) + B((y0 + y1)/2) ∇̄H(y0, y1) Σ_j c_j ΔŴ_j,

with B at y0 in the drift and at the midpoint in the noise, and the symmetrised coordinate-increment
discrete gradient ∇̄H(y, ȳ) = ½(∇̄₁H(y, ȳ) + ∇̄₁H(ȳ, y)).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sepv.average import average_hessian
from sepv.fields import contract, matmul, matvec
from sepv.formula import Asked, Fields
from sepv.one_step import EVERY, drift_and_noise, implicit, one_step
from sepv.problem import Array, Problem


def corners(y: Any, z: Any) -> Any:
    """The path of coordinate increments: (d, d, ...), corner i has its first i components moved by z."""
    return np.stack([np.concatenate([y[:i] + z[:i], y[i:]]) for i in range(len(y))], axis=1)


def coordinate_increments(fields: Fields, y: Any, z: Any) -> Any:
    """∇̄₁H(y, y + z): component i is (H(corner i+1) − H(corner i))/z_i.

    The quotient is the average of ∂_iH along that edge, and is computed as that average: where a
    component does not move it is ∂_iH there, and where it hardly moves no digits are lost.
    """
    return fields.edge_means(corners(y, z), z)


def symmetrised(fields: Fields, y: Any, z: Any) -> Any:
    """∇̄H, from y to y + z and back."""
    return 0.5 * (coordinate_increments(fields, y, z) + coordinate_increments(fields, y + z, -z))


def formula(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    """(h B(y0) + S B(ȳ)) ∇̄H for h and S = Σ c_j ΔŴ_j."""
    B = step[0] * fields.structure(y) + step[1] * fields.structure(y + 0.5 * z)
    return matvec(B, symmetrised(fields, y, z))


def jacobian(problem: Problem, y0: Array, y1: Array, step: Array, *_: Array) -> Array | None:
    """∂/∂y1."""
    if problem.structure_derivative is None or problem.hessian is None:
        return None
    d, z = problem.dimension, y1 - y0
    slope = np.zeros((d, *y0.shape))
    for start, way, moves_first in ((y0, z, True), (y1, -z, False)):
        first = corners(start, way)
        last = first.copy()
        last[range(d), range(d)] += way
        plain = average_hessian(problem, first, last, weighted=False)
        tilted = average_hessian(problem, first, last)
        assert plain is not None
        assert tilted is not None  # the problem has a Hessian
        for i in range(d):
            # On edge i the components before i are those of the end, those after i those of the start.
            moved = range(i) if moves_first else range(i + 1, d)
            for k in moved:
                slope[i, k] += 0.5 * plain[i, k, i]
            slope[i, i] += 0.5 * (tilted[i, i, i] if moves_first else plain[i, i, i] - tilted[i, i, i])
    middle = y0 + 0.5 * z
    B = step[0] * problem.structure(y0) + step[1] * problem.structure(middle)
    mean = symmetrised(Asked(problem, y0, y1), y0, z)
    return 0.5 * step[1] * contract(problem.structure_derivative(middle), mean) + matmul(B, slope)


step = implicit(formula, jacobian, parts=drift_and_noise)
scheme = one_step(
    "discrete-gradient",
    step,
    EVERY | {"identity", "energy", "noise-sum", "rounding"},
    "Cohen and Dujardin (2014), §4",
)
