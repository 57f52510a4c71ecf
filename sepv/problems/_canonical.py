"""Canonical problems in the plane, equation (1.3): B = ((0, −1), (1, 0)), constant."""

from __future__ import annotations

import numpy as np

from sepv.problem import Array


def structure(y: Array) -> Array:
    """B, of shape (2, 2, ...)."""
    zero, one = np.zeros_like(y[0]), np.ones_like(y[0])
    return np.stack([np.stack([zero, -one]), np.stack([one, zero])])


def structure_derivative(y: Array) -> Array:
    """∂B_ij/∂y_k = 0, of shape (2, 2, 2, ...)."""
    return np.zeros((2, 2, 2, *y.shape[1:]), dtype=y.dtype)


def kinetic_flow(y: Array, t: Array) -> Array:
    """The flow of H_1 = p²/2 at t: q moves by pt."""
    return np.stack([y[0], y[1] + t * y[0]])


def canonical(n: int, y: Array) -> Array:
    """B = ((0, −I), (I, 0)) for y = (p, q) with n of each, (2n, 2n, ...)."""
    B = np.zeros((2 * n, 2 * n, *y.shape[1:]), dtype=y.dtype)
    for i in range(n):
        B[i, n + i], B[n + i, i] = -1.0, 1.0
    return B


def canonical_derivative(n: int, y: Array) -> Array:
    """∂B_ij/∂y_k = 0, (2n, 2n, 2n, ...)."""
    return np.zeros((2 * n, 2 * n, 2 * n, *y.shape[1:]), dtype=y.dtype)
