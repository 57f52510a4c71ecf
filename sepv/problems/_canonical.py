"""Canonical structures, equations (1.2) and (1.3): B = ((0, −I), (I, 0)), constant."""

from __future__ import annotations

import numpy as np

from sepv.problem import Array


def structure(y: Array) -> Array:
    """B for y = (p, q) with as many of each, (d, d, ...)."""
    n = len(y) // 2
    B = np.zeros((2 * n, 2 * n, *y.shape[1:]), dtype=y.dtype)
    for i in range(n):
        B[i, n + i], B[n + i, i] = -1.0, 1.0
    return B
