"""The equation of an implicit scheme, solved to any number of digits, by Newton's method.

Newton's iteration runs in binary64 first, with a Jacobian from dual numbers x + εv (`jacobian`). It
gives the solution and the Jacobian to about 16 digits. With this Jacobian fixed, each further
evaluation of the residual in extended precision gains about 16 digits, so three evaluations give 50
digits. If floats overflow or underflow, or their Jacobian is singular, the whole iteration runs in
extended precision.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from operator import mul
from typing import Any, NamedTuple

from sepv.reference.arithmetic import Arithmetic, Matrix, Number, Vector, total

Residual = Callable[[Vector], Vector]

_NEWTON = 60
_CHORD = 40
_LEAST_DAMPING = 2.0**-40
# Exceptions of a float computation: overflow, division by zero, a logarithm out of its domain.
FLOAT_ERRORS = (ArithmeticError, ValueError)


class Failure(NamedTuple):
    """The result of an iteration that found no solution: the smallest residual, and the reason."""

    residual: float
    iterations: int
    reason: str


class CertifiedRoot(NamedTuple):
    """A root x with residual(x) = 0 to the requested digits, and (∂residual/∂x)⁻¹ there,
    to about 15 digits.
    """

    x: Vector
    inverse: Matrix
    iterations: int


def jacobian(residual: Residual, x: Vector, arithmetic: Arithmetic) -> Matrix:
    """The Jacobian ∂residual/∂x at x, computed one column at a time."""
    one, slope, nudged = arithmetic.number(1.0), arithmetic.slope, arithmetic.nudged
    columns = [residual([*x[:k], nudged(v, one), *x[k + 1 :]]) for k, v in enumerate(x)]
    return [[slope(v) for v in row] for row in zip(*columns, strict=True)]


def inverse(A: Matrix) -> Matrix:
    """The inverse A⁻¹ in the numbers of A: by cofactors for d = 3, which is faster,
    else by Gauss-Jordan elimination.

    Raises
    ------
    ZeroDivisionError
        If A is singular.
    """
    n = len(A)
    if n == 3:
        (a, b, c), (d, e, f), (g, h, i) = A
        p, q, r = e * i - f * h, f * g - d * i, d * h - e * g
        D = a * p + b * q + c * r
        return [
            [p / D, (c * h - b * i) / D, (b * f - c * e) / D],
            [q / D, (a * i - c * g) / D, (c * d - a * f) / D],
            [r / D, (b * g - a * h) / D, (a * e - b * d) / D],
        ]
    rows = [[*row, *(1 if i == j else 0 for j in range(n))] for i, row in enumerate(A)]
    for k in range(n):
        pivot = max(range(k, n), key=lambda i: abs(rows[i][k]))
        rows[k], rows[pivot] = rows[pivot], rows[k]
        factor = rows[k][k]
        top = rows[k] = [v / factor for v in rows[k]]
        for i in range(n):
            if i != k and rows[i][k]:
                factor = rows[i][k]
                rows[i] = [v - factor * w for v, w in zip(rows[i], top, strict=True)]
    return [row[n:] for row in rows]


def times(A: Matrix, v: Vector) -> Vector:
    """The product A v."""
    return [total(map(mul, row, v)) for row in A]


def largest(v: Vector) -> Number:
    """The largest component |v|_∞."""
    return max(map(abs, v))


def newton(
    residual: Residual,
    x: Vector,
    scale: Number,
    arithmetic: Arithmetic,
    tolerance: float,
    most: int = _NEWTON,
) -> CertifiedRoot | Failure:
    """The root that Newton's iteration finds from x, or a Failure.

    The iteration ends at a correction of at most tolerance · scale. A correction that leaves the
    domain is halved.
    """
    best, goal, n, damping = math.inf, tolerance * scale, 0, 1.0
    try:
        value = residual(x)
        for n in range(1, most + 1):
            best = min(best, float(largest(value)))
            inverted = inverse(jacobian(residual, x, arithmetic))
            correction = times(inverted, value)
            moved = largest(correction)
            if not moved < math.inf:
                return Failure(best, n, "overflow")
            if moved <= goal:
                return CertifiedRoot([v - c for v, c in zip(x, correction, strict=True)], inverted, n)
            damping = 1.0
            while True:
                tried = [v - damping * c for v, c in zip(x, correction, strict=True)]
                try:
                    value = residual(tried)
                    break
                except FLOAT_ERRORS:
                    damping /= 2
                    if damping < _LEAST_DAMPING:
                        return Failure(best, n, "the iteration leaves the domain of the problem")
            x = tried
    except ZeroDivisionError:
        return Failure(best, n, "singular Jacobian")
    except FLOAT_ERRORS as error:
        return Failure(best, n, str(error))
    return Failure(best, most, "no convergence")


def refine(
    residual: Residual, root: CertifiedRoot, scale: Number, ctx: Any, digits: int
) -> CertifiedRoot | Failure:
    """Refine a root to 10^−digits of the scale, by the chord iteration with the root's inverse
    Jacobian.

    Corrections c_1, c_2, … shrink by a constant factor, so c_n²/c_{n−1} estimates the next one; the
    iteration ends when this estimate is below the goal. Corrections are computed in floats. If
    these could underflow, with many digits or states of extreme size, the residual is first scaled
    to size 1.
    """
    x, inverted = [ctx.mpf(v) for v in root.x], root.inverse
    size = float(scale)
    plain = digits <= 100 and 1e-100 < size < 1e100
    goal = size * 10.0**-digits if plain else scale * ctx.mpf(10) ** -digits
    previous, moved = math.inf, math.inf
    for n in range(1, _CHORD + digits // 8):
        value = residual(x)
        if plain:
            correction = times(inverted, [float(v) for v in value])
        else:
            shift = -int(ctx.mag(largest(value))) if any(value) else 0
            scaled = times(inverted, [float(ctx.ldexp(v, shift)) for v in value])
            correction = [ctx.ldexp(ctx.mpf(c), -shift) for c in scaled]
        x = [v - c for v, c in zip(x, correction, strict=True)]
        previous, moved = moved, largest(correction)
        if not moved or (n > 1 and moved * moved <= goal * previous):
            return CertifiedRoot(x, inverted, n)
        if not moved < previous / 2:
            break
    return Failure(float(largest(value)), n, "no convergence in extended precision")
