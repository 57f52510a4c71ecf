"""The stochastic rigid body, a Lie-Poisson system on so(3)*, §4.2."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sepv.errors import ProblemError
from sepv.nambu import Nambu
from sepv.problem import Array, Flow, NamedProblem, Problem

_HAT = ((0, 1, 2, -1.0), (0, 2, 1, 1.0), (1, 2, 0, -1.0))  # B[i, j] = sign · y[k]


def rigid_body(inertia: ArrayLike = (0.345, 0.653, 1.0), noise: ArrayLike = 1.0) -> Problem:
    """B(y) = hat(y), H = ½ Σ y_i²/I_i, Casimir |y|², from y = (0.8, 0.6, 0).

    The defaults are those of §4.2: I = (0.345, 0.653, 1), c = 1.
    """
    c = np.atleast_1d(np.asarray(noise, dtype=np.float64))
    moments = np.array(inertia, dtype=np.float64)
    if moments.shape != (3,) or not np.all(np.isfinite(moments)) or np.any(moments <= 0):
        raise ProblemError(
            expected="three positive moments of inertia",
            received=f"{inertia!r}",
            remedy="give inertia=(I1, I2, I3)",
        )

    def column(y: Array) -> Array:
        return moments.reshape(3, *(1,) * (y.ndim - 1))

    def hessian(y: Array) -> Array:
        H = np.zeros((3, 3, *y.shape[1:]), dtype=y.dtype)
        for i in range(3):
            H[i, i] = 1 / moments[i]
        return H

    return Problem(
        dimension=3,
        structure=_structure,
        hamiltonian=lambda y: (
            0.5 * (y[0] * y[0] / moments[0] + y[1] * y[1] / moments[1] + y[2] * y[2] / moments[2])
        ),
        gradient=lambda y: y / column(y),
        noise=c,
        casimirs=(np.eye(3),),
        hessian=hessian,
        structure_derivative=_structure_derivative,
        mean_gradient=lambda y0, y1: (y0 + 0.5 * (y1 - y0)) / column(y0),
        degree=2,
        initial=(0.8, 0.6, 0.0),
        flows=tuple(_rotation(k, float(moments[k])) for k in range(3)),
        name="rigid-body",
        data=NamedProblem("rigid-body", (("inertia", tuple(moments.tolist())), ("noise", tuple(c.tolist())))),
        nambu=_NAMBU,
        check=False,
    )


def _rotation(k: int, moment: float) -> Flow:
    """The flow of H_k = y_k²/(2I_k): a rotation about axis k by the angle t y_k/I_k."""
    i, j = (k + 1) % 3, (k + 2) % 3

    def flow(y: Array, t: Array) -> Array:
        cos, sin = np.cos(t * y[k] / moment), np.sin(t * y[k] / moment)
        turned: dict[int, Array] = {k: y[k], i: cos * y[i] + sin * y[j], j: cos * y[j] - sin * y[i]}
        return np.stack([turned[n] for n in range(3)])

    return flow


# hat(y)v = y × v = −(v × ∇C) with C = ½|y|².
_NAMBU = Nambu(
    factor=lambda y: np.full_like(y[0], -1.0),
    casimir=lambda y: 0.5 * (y[0] * y[0] + y[1] * y[1] + y[2] * y[2]),
    gradient=lambda y: np.stack([y[0], y[1], y[2]]),
    hessian=lambda y: (
        np.zeros((3, 3, *y.shape[1:]), dtype=y.dtype) + np.eye(3).reshape(3, 3, *(1,) * (y.ndim - 1))
    ),
    mean_gradient=lambda y0, y1: y0 + 0.5 * (y1 - y0),
    degree=2,
)


def _structure(y: Array) -> Array:
    B = np.zeros((3, 3, *y.shape[1:]), dtype=y.dtype)
    for i, j, k, sign in _HAT:
        B[i, j] = sign * y[k]
        B[j, i] = -sign * y[k]
    return B


def _structure_derivative(y: Array) -> Array:
    D = np.zeros((3, 3, 3, *y.shape[1:]), dtype=y.dtype)
    for i, j, k, sign in _HAT:
        D[i, j, k] = sign
        D[j, i, k] = -sign
    return D
