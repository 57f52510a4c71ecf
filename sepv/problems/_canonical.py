"""Structures that many systems have: the canonical ones, equations (1.2) and (1.3), and those of so(3)*."""

from __future__ import annotations

import numpy as np

from sepv.problem import Array
from sepv.problem._problem import Structure
from sepv.record import Polynomial
from sepv.record import _polynomial as poly

# (i, j, k, sign) with B_ij = sign · y_k: B(y)v = y × v.
HAT = ((0, 1, 2, -1.0), (0, 2, 1, 1.0), (1, 2, 0, -1.0))


def structure(y: Array) -> Array:
    """B = ((0, −I), (I, 0)) for y = (p, q) with as many of each, (d, d, ...)."""
    n = len(y) // 2
    B = np.zeros((2 * n, 2 * n, *y.shape[1:]), dtype=y.dtype)
    for i in range(n):
        B[i, n + i], B[n + i, i] = -1.0, 1.0
    return B


def canonical(dimension: int) -> Structure:
    """The same as data."""
    n = dimension // 2
    return tuple((k, n + k, poly.constant(dimension, -1.0)) for k in range(n))


def planes(dimension: int) -> Structure:
    """The constant B of (1.3), block by block; an odd last component does not move."""
    return tuple((2 * k, 2 * k + 1, poly.constant(dimension, -1.0)) for k in range(dimension // 2))


def hat(factor: Polynomial | None = None, spins: int = 1) -> Structure:
    """B(y)v = y × v in each of n blocks of three, times a factor: |y|² of each block is a Casimir."""
    d = 3 * spins
    entries = [(n + i, n + j, n + k, s) for n in range(0, d, 3) for i, j, k, s in HAT]
    g = poly.constant(d, 1.0) if factor is None else factor
    return tuple((i, j, poly.multiply(g, poly.scale(s, poly.variable(d, k)))) for i, j, k, s in entries)
