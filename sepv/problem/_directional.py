"""Derivatives of B(y)v and of the field f = B∇H along a direction,
by differences where a problem gives no formula.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sepv.core.arrays import Array, matvec
from sepv.core.problem import System, differences_of_lanes, field_jacobian, vector_field

# Exponents s of the widths ∝ |y|^s of differences: f may vary over lengths |y| or 1, and only its
# values show which.
_SCALES = (1.0, 2 / 3, 1 / 3, 0.0)


def derivative_along(problem: System, y: Array, v: Array) -> Array:
    """The derivative of the field f = B∇H in the direction v, f′(y)v, (d, ...): analytic,
    else by differences.

    The differences are central and of order six. Each state has the width with the smallest
    estimate of the error: the distance to a difference of order four, plus the rounding of f. If f
    returns long double for a y in long double, the differences are in long double; with 64 bits of
    mantissa their error is below a rounding of f. For any other f they are in binary64, with an
    error of about 1e-13 of the scale of f. This second error can show in y1, because the Itô
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


def structure_slope(problem: System, y: Array, v: Array, channel: Any = None) -> Array:
    """The derivative of S(y)v by y for fixed v, (d, d, ...): from S′ if it is given,
    else by differences.

    S is the structure of a channel, by default of the drift.
    """
    own: Any = problem if channel is None else channel
    if own.structure_derivative is not None:
        return matvec(own.structure_derivative(y), v)
    flat = v.reshape(len(v), -1)
    return differences_of_lanes(problem, lambda at, lanes: matvec(own.structure(at), flat[:, lanes]), y)
