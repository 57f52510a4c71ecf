"""Dense algebra of batches: a state is (d,), a batch of M states (d, M), B(y) (d, d) or (d, d, M).

Sums over components are added in a fixed order, by one vectorised operation for each component and
never by BLAS. So the bits of a path do not depend on the number of paths in its batch.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# Arrays (M,) with a value for each lane, a path of a batch: its number in the batch, a flag (True
# or False), a count.
Lanes = NDArray[np.intp]
Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]
# A function of states (d, M) and of the numbers (M,) of their paths in the batch.
OfLanes = Callable[[Array, Lanes], Any]

# The spacing of binary64 at 1, and its smallest normal number.
EPS, TINY = 2.0**-52, 2.0**-1022
# The largest size of a term for which one NumPy call adds all terms: measured, for speed alone.
ONE_SUM_MAX_SIZE = 96
# The width of forward differences, relative to the state, and the most states in one batch of them.
# Larger batches need more memory and are not faster.
DIFFERENCE_WIDTH, DIFFERENCE_MAX_STATES = 2.0**-26, 256


def _is_small(A: Array, products: int) -> bool:
    """True if A holds numbers, not symbols, and one NumPy call is faster than a loop."""
    return products <= ONE_SUM_MAX_SIZE * A.shape[1] and isinstance(A, np.ndarray) and A.dtype != object


def summed(terms: Array) -> Array:
    """The sum Σ_j terms[:, j], (n, ...), of terms (n, d, ...), added in the order of j."""
    if _is_small(terms, terms.size):
        totals: Array = np.add.accumulate(terms, axis=1)
        return totals[:, -1]
    total: Array = terms[:, 0]
    for j in range(1, terms.shape[1]):
        total = total + terms[:, j]
    return total


def matvec(A: Array, v: Array) -> Array:
    """The product A v over the second axis of A (n, d, ...) and the first axis of v (d, ...).

    For A_ijk = ∂B_ij/∂y_k (d, d, d, ...) the product Σ_j A_ijk v_j is ∂(B(y)v)/∂y for fixed v.
    """
    if _is_small(A, A.size):
        return summed(A * v.reshape(len(v), *(1,) * (A.ndim - 1 - v.ndim), *v.shape[1:]))
    total: Array = A[:, 0] * v[0]
    for j in range(1, A.shape[1]):
        total = total + A[:, j] * v[j]
    return total


def matmul(A: Array, B: Array) -> Array:
    """The product A B of matrices of shapes (n, d, ...) and (d, p, ...)."""
    if _is_small(A, A.size * B.shape[1]):
        return summed(A[:, :, None] * B)
    total: Array = A[:, 0, None] * B[0]
    for j in range(1, A.shape[1]):
        total = total + A[:, j, None] * B[j]
    return total


def linear_solve(A: Array, b: Array) -> Array:
    """The solutions x (d, M) of A x = b, A (d, d, M) and b (d, M); not finite if A is singular.

    For d ≤ 3 Cramer's rule is used elementwise, because it is several times faster than a LAPACK
    call for each matrix. It is not backward stable, which Newton's iteration does not need, because
    it computes each residual afresh.
    """
    if len(b) <= 3:
        if b.shape[1] == 1:  # Python's numbers: NumPy would take ten times as long for a few elements
            numerators, determinant = cramer(A[..., 0].tolist(), b[:, 0].tolist())
            return np.array([[v / determinant if determinant else math.nan] for v in numerators])
        numerators, determinant = cramer(A, b)
        return np.asarray(np.stack(numerators) / determinant)
    matrices, sides = A.transpose(2, 0, 1), b.T[..., None]
    try:
        return np.asarray(np.linalg.solve(matrices, sides)[..., 0].T, dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.stack([_solve_one(m, s) for m, s in zip(matrices, sides[..., 0], strict=True)], axis=1)


def _solve_one(matrix: Array, side: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(matrix, side), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.full_like(side, np.nan)


def cramer(A: Any, b: Any) -> tuple[list[Any], Any]:
    """Numerators and determinant of Cramer's rule, A x = b, d ≤ 3, also with symbols."""
    if len(b) == 1:
        return [b[0]], A[0][0]
    if len(b) == 2:
        (p, q), (r, s) = A
        return [s * b[0] - q * b[1], p * b[1] - r * b[0]], p * s - q * r
    u, v, w = A
    columns = cross_entries(v, w), cross_entries(w, u), cross_entries(u, v)
    determinant = u[0] * columns[0][0] + u[1] * columns[0][1] + u[2] * columns[0][2]
    return [x * b[0] + y * b[1] + z * b[2] for x, y, z in zip(*columns, strict=True)], determinant


def cross_entries(u: Any, v: Any) -> tuple[Any, Any, Any]:
    """The three components of u × v, for numbers, arrays or symbols."""
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


def forward_differences(R: OfLanes, inside: OfLanes | None, z: Array, base: Array, reach: Array) -> Array:
    """The derivative ∂R/∂z (n, d, M) by forward differences at z (d, M); `base` (n, M) is R(z).

    Where `inside` is False at z + width, the difference is backward. The width is proportional to
    `reach` (M,), the size of z. One call has several shifted copies of a path, so R and `inside`
    also get the path number of each copy.
    """
    n, M = z.shape
    width = DIFFERENCE_WIDTH * np.maximum(reach, TINY)
    jacobian = np.empty((len(base), n, M))
    together = max(1, DIFFERENCE_MAX_STATES // max(M, 1))
    for first in range(0, n, together):
        columns = np.arange(first, min(first + together, n))
        count = len(columns)
        own_lanes, lanes = (columns, np.arange(count)), np.tile(np.arange(M), count)
        shifted = np.repeat(z[:, None], count, axis=1)
        shifted[own_lanes] += width
        if inside is not None:
            within = np.reshape(inside(shifted.reshape(n, count * M), lanes), (count, M))
            shifted[own_lanes] = np.where(within, shifted[own_lanes], z[columns] - width)
        values = R(shifted.reshape(n, count * M), lanes).reshape(len(base), count, M)
        jacobian[:, columns] = (values - base[:, None]) / (shifted[own_lanes] - z[columns])
    return jacobian


def majorant(function: Any, y: Array) -> Array:
    """The scale of the rounding of function(y): its majorant(y) if it has one, else its size."""
    stated = getattr(function, "majorant", None)
    return np.asarray(np.abs(function(y)) if stated is None else stated(y))
