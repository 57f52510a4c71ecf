"""Newton's matrix from differences of R, where there is no analytic one or it does not suffice."""

from __future__ import annotations

import numpy as np

from sepv.problem import Array, Problem, forward_differences
from sepv.solve._solution import Equations, IncrementFunction, Lanes


def slopes(equations: Equations, z: Array, numbers: Lanes, base: Array) -> tuple[Array, int]:
    """∂R/∂z by differences, and their n evaluations."""
    reach, domain = (equations.size[:, numbers] + np.abs(z)).max(axis=0), equations.inside
    inside = None if domain is None else lambda at, lanes: domain(at, numbers[lanes])
    R = lambda at, lanes: equations.evaluate(at, numbers[lanes]).right_side.value  # noqa: E731
    return forward_differences(R, inside, z, base, reach), z.shape[0]


def difference_jacobian(
    problem: Problem, y0: Array, y1: Array, step: Array, increment: IncrementFunction, base: Array
) -> Array:
    """∂R/∂y1 by differences. Their error of about √eps costs Newton one iteration, not accuracy.

    Their width follows the larger of y and the step: from y0 = 0 a width of zero would divide roundings of R by it.
    """
    reach, domain = np.max([np.abs(y0), np.abs(y1), np.abs(base)], axis=0).max(axis=0), problem.domain
    inside = None if domain is None else lambda at, _: domain(at)
    R = lambda at, lanes: increment(problem, y0[:, lanes], at, step[:, lanes]).value  # noqa: E731
    return forward_differences(R, inside, y1, base, reach)
