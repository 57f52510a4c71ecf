"""The Poisson vector field f = B∇H, its derivative, and the small dense algebra of batches.

Sums over components are added in a fixed order, by one vectorised operation for each component and never by BLAS. So
the bits of one path do not depend on the number of paths computed in the same batch.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sepv.problem._nambu import cross_entries
from sepv.problem._problem import Array, Problem
from sepv.record import EPS, TINY

_ROOT = float(np.sqrt(EPS))
# The largest number of states for one batch of differences. Larger batches need more memory and are not faster.
LANES = 256
# A function of states (d, M) and of the numbers (M,) of their paths in the batch.
OfLanes = Callable[[Array, NDArray[np.intp]], Any]
# The largest size of a term for which one NumPy call adds all terms. It was measured, and matters for speed alone.
FEW = 96


def _is_small(A: Array, products: int) -> bool:
    """True if A holds numbers (not symbols), and `products` are few: one NumPy call is then faster than a loop."""
    return products <= FEW * A.shape[1] and isinstance(A, np.ndarray) and A.dtype != object


def summed(terms: Array) -> Array:
    """The sum Σ_j terms[:, j], (n, ...), over the second axis of terms (n, d, ...), added in the order of j."""
    if _is_small(terms, terms.size):
        totals: Array = np.add.accumulate(terms, axis=1)
        return totals[:, -1]
    total: Array = terms[:, 0]
    for j in range(1, terms.shape[1]):
        total = total + terms[:, j]
    return total


def matvec(A: Array, v: Array) -> Array:
    """The product A v, a sum over the second axis of A (n, d, ...) and the first axis of v (d, ...).

    For A_ijk = ∂B_ij/∂y_k (d, d, d, ...) the product Σ_j A_ijk v_j is the derivative of B(y)v by y for fixed v.
    """
    if _is_small(A, A.size):
        return summed(A * v.reshape(len(v), *(1,) * (A.ndim - 1 - v.ndim), *v.shape[1:]))
    total = A[:, 0] * v[0]
    for j in range(1, A.shape[1]):
        total = total + A[:, j] * v[j]
    return total


def dot(u: Array, v: Array) -> Array:
    """The product uᵀv of vectors (d, ...), summed in the order of the components, for one state as for a batch.

    `np.sum` would add eight or more components of a single state in another order than those of a batch.
    """
    return matvec(u[None], v)[0]


def matmul(A: Array, B: Array) -> Array:
    """The product A B of matrices of shapes (n, d, ...) and (d, p, ...)."""
    if _is_small(A, A.size * B.shape[1]):
        return summed(A[:, :, None] * B)
    total = A[:, 0, None] * B[0]
    for j in range(1, A.shape[1]):
        total = total + A[:, j, None] * B[j]
    return total


def vector_field(problem: Problem, y: Array) -> Array:
    """The field f(y) = B(y)∇H(y) of a problem, of shape (d, ...)."""
    return matvec(problem.structure(y), problem.gradient(y))


def invariants(problem: Problem, y: Array) -> Array:
    """The invariants of a problem at y (d, ...), as rows (1 + n, ...): H, and its n quadratic and linear Casimirs.

    Sums are written out, so that the bits for one state do not depend on the other states of a batch.
    """
    none = np.zeros(y.shape[1:])
    rows = [problem.hamiltonian(y)]
    for A in problem.casimirs:
        rows.append(sum((A[i, j] * (y[i] * y[j]) for i, j in zip(*np.nonzero(A), strict=True)), start=none))
    for b in problem.linear_casimirs:
        rows.append(sum((b[i] * y[i] for i in range(len(b))), start=none))
    return np.stack(rows)


def casimir_gradients(quadratic: Sequence[Any], linear: Sequence[Any], ends: Array) -> list[Array]:
    """The gradients of Casimirs yᵀAy and bᵀy, averaged along the segment from y0 to y1: A·ends and b, ends = y0 + y1.

    Each average has the shape (d, ...). With ends = 2y the averages are the gradients at y.
    """
    extra = (1,) * (ends.ndim - 1)
    return [
        *(matvec(np.reshape(A, (*np.shape(A), *extra)), ends) for A in quadratic),
        *(np.broadcast_to(np.reshape(b, (-1, *extra)), ends.shape) for b in linear),
    ]


def turned_along(D: Array, w: Array) -> Array:
    """The derivative of B in the direction w, B′(y)w = Σ_k D[:, :, k] w_k, (d, d, ...), for D = ∂B_ij/∂y_k."""
    total = D[:, :, 0] * w[0]
    for k in range(1, len(w)):
        total = total + D[:, :, k] * w[k]
    return np.asarray(total)


def field_jacobian(problem: Problem, y: Array) -> Array | None:
    """The derivative f′(y) of the field f = B∇H, (d, d, ...); None unless the problem gives both B′ and H″."""
    if problem.hessian is None or problem.structure_derivative is None:
        return None
    g = problem.gradient(y)
    return matvec(problem.structure_derivative(y), g) + matmul(problem.structure(y), problem.hessian(y))


def structure_slope(problem: Problem, y: Array, v: Array) -> Array:
    """The derivative of B(y)v by y for fixed v, (d, d, ...): from B′ if it is given, else by forward differences."""
    if problem.structure_derivative is not None:
        return matvec(problem.structure_derivative(y), v)
    flat = v.reshape(len(v), -1)
    return differences(problem, lambda at, lanes: matvec(problem.structure(at), flat[:, lanes]), y)


def hessian(problem: Problem, y: Array) -> Array:
    """The second derivatives H″(y), (d, d, ...): as given, else by forward differences, enough for Newton's matrix."""
    if problem.hessian is not None:
        return problem.hessian(y)
    return differences(problem, lambda at, _: problem.gradient(at), y)


def differences(problem: Problem, function: OfLanes, y: Array) -> Array:
    """The derivative (n, d, ...) by y of a function of a problem's states, by forward differences at y (d, ...).

    `function` gets shifted states (d, M) and M integers: the number of each state's path in the flattened batch y.
    """
    flat, domain = y.reshape(len(y), -1), problem.domain
    inside = None if domain is None else lambda at, _: domain(at)
    base = function(flat, np.arange(flat.shape[1]))
    jacobian = forward_differences(function, inside, flat, base, np.abs(flat).max(axis=0))
    return jacobian.reshape(*jacobian.shape[:2], *y.shape[1:])


def forward_differences(R: OfLanes, inside: OfLanes | None, z: Array, base: Array, reach: Array) -> Array:
    """The derivative ∂R/∂z (n, d, M) by forward differences at z (d, M), at which R has the value `base` (n, M).

    Where `inside` is False at z + width, the difference is backward. The width is proportional to `reach` (M,), the
    size of z. One call has several shifted copies of a path, so R and `inside` also get the path number of each copy.
    """
    n, M = z.shape
    width = _ROOT * np.maximum(reach, TINY)
    jacobian = np.empty((len(base), n, M))
    together = max(1, LANES // max(M, 1))
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


# Exponents s of the widths ∝ |y|^s of differences: f may vary over lengths |y| or 1, and only its values show which.
_SCALES = (1.0, 2 / 3, 1 / 3, 0.0)


def derivative_along(problem: Problem, y: Array, v: Array) -> Array:
    """The derivative of the field f = B∇H in the direction v, f′(y)v, (d, ...): analytic, else by differences.

    The differences are central and of order six. Each state has the width with the smallest estimate of the error: the
    distance to a difference of order four, plus the rounding of f. If f returns long double for a y in long double, the
    differences are in long double; with 64 bits of mantissa their error is below a rounding of f. For any other f they
    are in binary64, with an error of about 1e-13 of the scale of f. This second error can show in y1, because the Itô
    correction and Milstein's term can be larger than f times the step.
    """
    jacobian = field_jacobian(problem, y)
    if jacobian is not None:
        return matvec(jacobian, v)
    size, reach = np.max(np.abs(v), axis=0), np.max(np.abs(y), axis=0)
    direction, wide = v / np.where(size > 0, size, 1.0), y.astype(np.longdouble)
    at: NDArray[Any] = y
    if vector_field(problem, wide).dtype == np.longdouble:  # type: ignore[arg-type]  # a wider float
        at = wide
    # The width h = 2⁻⁷ balances the errors h⁶ and eps/h in binary64, 2⁻⁹ in long double.
    share = 2.0**-7 if at is y else 2.0**-9
    rounding = np.finfo(at.dtype).eps
    best, error = np.zeros_like(at), np.full(reach.shape, np.inf)
    with np.errstate(all="ignore"):  # a width that overflows is not used
        for scale in _SCALES:
            power = np.power(np.atleast_1d(reach), scale).reshape(reach.shape)  # the bits of a batch
            step = share * np.where(reach > 0, power, 1.0)
            odd, largest = [], np.zeros_like(reach)
            for distance in (1, 2, 3):
                ahead = vector_field(problem, at + distance * step * direction)
                behind = vector_field(problem, at - distance * step * direction)
                odd.append(ahead - behind)
                largest = np.fmax(largest, np.max(np.abs(ahead) + np.abs(behind), axis=0))
            derivative = (45.0 * odd[0] - 9.0 * odd[1] + odd[2]) / (60 * step)
            fourth = (8.0 * odd[0] - odd[1]) / (12 * step)
            off = np.max(np.abs(derivative - fourth), axis=0) + rounding * largest / step
            better = off < error
            best, error = np.where(better, derivative, best), np.where(better, off, error)
    return np.asarray(best * size, dtype=np.float64)


def slope_along(function: Callable[[Array], Any], y: Array, direction: Array, width: Any) -> Array:
    """The derivative of a function at y in a direction, by central differences exact for polynomials of degree 6."""
    rises = [
        np.asarray(function(y + n * width * direction)) - function(y - n * width * direction)
        for n in (1, 2, 3)
    ]
    return np.asarray((45.0 * rises[0] - 9.0 * rises[1] + rises[2]) / (60 * width))


def linear_solve(A: Array, b: Array) -> Array:
    """The solutions x (d, M) of A x = b for M matrices A (d, d, M) and b (d, M); not finite where A is singular.

    For d ≤ 3 Cramer's rule is used elementwise, because it is several times faster than a LAPACK call for each matrix.
    It is not backward stable, which Newton's iteration does not need, because it computes each residual afresh.
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


def cramer(A: Any, b: Any) -> tuple[list[Any], Any]:
    """The numerators and the determinant of Cramer's rule for A x = b, d ≤ 3, with numbers, arrays or symbols."""
    if len(b) == 1:
        return [b[0]], A[0][0]
    if len(b) == 2:
        (p, q), (r, s) = A
        return [s * b[0] - q * b[1], p * b[1] - r * b[0]], p * s - q * r
    u, v, w = A
    columns = cross_entries(v, w), cross_entries(w, u), cross_entries(u, v)
    determinant = u[0] * columns[0][0] + u[1] * columns[0][1] + u[2] * columns[0][2]
    return [x * b[0] + y * b[1] + z * b[2] for x, y, z in zip(*columns, strict=True)], determinant


class Algebra(NamedTuple):
    """The linear algebra of Newton's iteration for z = R(z), for either dense or sparse matrices K = ∂R/∂z."""

    # The function (K, F) -> (1 − K)⁻¹F, (n, M), not finite where 1 − K is singular.
    correction: Callable[[Any, Array], Array]
    # The function K -> (M,): True for each path of the batch for which all entries of K are finite.
    finite: Callable[[Any], Any]
    # The function (K, size (n, M)) -> |K| size, (n, M).
    through: Callable[[Any, Array], Array]


@lru_cache(maxsize=64)
def _identity(n: int) -> Array:
    return np.eye(n)[..., None]


# The operations for K of shape (n, n, M).
DENSE = Algebra(
    lambda K, F: linear_solve(_identity(len(F)) - K, F),
    lambda K: np.isfinite(K).all(axis=(0, 1)),
    lambda K, size: matvec(np.abs(K), size),
)


def _solve_one(matrix: Array, side: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(matrix, side), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.full_like(side, np.nan)
