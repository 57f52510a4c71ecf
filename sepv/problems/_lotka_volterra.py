"""The stochastic Lotka-Volterra system in three species, §4.4."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sepv._arguments import is_number
from sepv.errors import ProblemError
from sepv.problem import Array, Nambu, Problem
from sepv.problems._sum_of_parts import flows, named, total


def lotka_volterra(
    a: float = -2.0,
    b: float = -1.0,
    d: float = -0.5,
    nu: float = 1.0,
    mu: float = 2.0,
    noise: ArrayLike = 0.5,
) -> Problem:
    """B_12 = d y1y2, B_13 = bd y1y3, B_23 = −y2y3; H = ab y1 + y2 − a y3 + ν ln y2 − μ ln y3.

    From y = (1, 1.9, 0.5), in the octant y > 0. Its Casimir ln y1 + bd ln y2 − d ln y3 is not
    quadratic, so that (2.1) does not keep it. The defaults are those of §4.4: c = 0.5.
    """
    if not all(is_number(v) for v in (a, b, d, nu, mu)):
        raise ProblemError(
            expected="finite parameters a, b, d, ν, μ",
            received=f"{(a, b, d, nu, mu)!r}",
            remedy="those of §4.4 are −2, −1, −0.5, 1, 2",
        )
    parts = (
        lambda y: a * b * y[0],
        lambda y: y[1] + nu * np.log(y[1]),
        lambda y: -a * y[2] - mu * np.log(y[2]),
    )
    pairs = (0, 1, d), (0, 2, b * d), (1, 2, -1.0)

    def structure(y: Array) -> Array:
        B = np.zeros((3, 3, *y.shape[1:]), dtype=y.dtype)
        for i, j, factor in pairs:
            B[i, j] = factor * y[i] * y[j]
            B[j, i] = -B[i, j]
        return B

    return named(
        "lotka-volterra",
        noise,
        {"a": (a,), "b": (b,), "d": (d,), "nu": (nu,), "mu": (mu,)},
        dimension=3,
        structure=structure,
        hamiltonian=total(parts),
        domain=_positive,
        initial=(1.0, 1.9, 0.5),
        flows=flows(3, structure, parts),
        # States near the initial one have no solution at 0.26: an eighth of that.
        longest_step=2.0**-5,
        # B(y)v = −y1y2y3 (v × ∇C).
        nambu=Nambu(
            factor=lambda y: -y[0] * y[1] * y[2],
            casimir=lambda y: np.log(y[0]) + b * d * np.log(y[1]) - d * np.log(y[2]),
        ),
    )


def _positive(y: Array) -> NDArray[np.bool_]:
    inside: NDArray[np.bool_] = np.all(y > 0, axis=0)
    return inside
