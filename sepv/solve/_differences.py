"""Newton's matrix ∂R/∂z from differences of the right side R, if no analytic matrix is given or it is too inexact."""

from __future__ import annotations

import numpy as np

from sepv.problem import Array, Problem, forward_differences
from sepv.solve._solution import Equations, IncrementFunction, Lanes


def slopes(equations: Equations, z: Array, numbers: Lanes, base: Array) -> tuple[Array, int]:
    """The derivative ∂R/∂z (n, n, M) of z = R(z) by differences, and the number of evaluations of R for them.

    The derivative is that of the lanes (paths) `numbers` at z (n, M), at which R has the value `base`.
    """
    reach, domain = (equations.size[:, numbers] + np.abs(z)).max(axis=0), equations.inside
    inside = None if domain is None else lambda at, lanes: domain(at, numbers[lanes])
    R = lambda at, lanes: equations.evaluate(at, numbers[lanes]).right_side.value  # noqa: E731
    return forward_differences(R, inside, z, base, reach), z.shape[0]


def difference_jacobian(
    problem: Problem, y0: Array, y1: Array, step: Array, increment: IncrementFunction, base: Array
) -> Array:
    """The derivative ∂R/∂y1 (d, d, M) of y1 = y0 + R(y0, y1) by differences at y1 (d, M), at which R is `base`.

    The differences have an error of about √eps. It costs Newton's method one iteration, but no accuracy. Their width
    is relative to the largest of |y0|, |y1| and |R|, so that it is not zero for y0 = y1 = 0.
    """
    reach, domain = np.max([np.abs(y0), np.abs(y1), np.abs(base)], axis=0).max(axis=0), problem.domain
    inside = None if domain is None else lambda at, _: domain(at)
    R = lambda at, lanes: increment(problem, y0[:, lanes], at, step[:, lanes]).value  # noqa: E731
    return forward_differences(R, inside, y1, base, reach)
