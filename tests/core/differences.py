"""The derivative of a right side by forward differences, for tests of Newton's matrix."""

from collections.abc import Callable

import numpy as np

from sepv import Problem
from sepv.core.arrays import forward_differences


def difference_jacobian(
    problem: Problem, y0: np.ndarray, y1: np.ndarray, step: np.ndarray, increment: Callable, base: np.ndarray
) -> np.ndarray:
    """∂R/∂y1 (d, d, M) of y1 = y0 + R(y0, y1) at y1 (d, M), at which R is `base`."""
    reach = np.max([np.abs(y0), np.abs(y1), np.abs(base)], axis=0).max(axis=0)
    inside = None if problem.domain is None else lambda at, _: problem.domain(at)
    R = lambda at, lanes: increment(problem, y0[:, lanes], at, step[:, lanes]).value  # noqa: E731
    return forward_differences(R, inside, y1, base, reach)
