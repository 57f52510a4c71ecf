"""Legendre's polynomials."""

from __future__ import annotations

import numpy as np

from sepv.core.arrays import Array


def legendre_values(x: Array, degree: int) -> list[Array]:
    """The values of Legendre's polynomials P_0(x), …, P_degree(x), by the three-term recurrence."""
    values = [np.ones_like(x), x]
    for k in range(1, degree):
        values.append(((2 * k + 1) * x * values[k] - k * values[k - 1]) / (k + 1))
    return values[: degree + 1]
