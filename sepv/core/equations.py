"""The equations z = R(z) of a batch, from R and its derivative, and their solution by Newton.

Newton's matrix comes from a formula where there is one, else from differences of R, whose error of
about √eps costs the iteration one more correction, and no accuracy. A lane (a path of the batch)
that fails by full steps is tried again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from sepv.core.arrays import EPS, Array, Lanes, forward_differences, linear_solve, matvec
from sepv.core.damped import approach
from sepv.core.newton import RESIDUAL_ROUNDING, STAGNATION, Flagged, Inside, Root, Status, newton

# The rounding of a sum of a dozen terms, relative to the sum of their absolute values: far below
# the constant K of `sepv.law.tolerance`.
SUM_ROUNDING = 16 * EPS


class Evaluation(NamedTuple):
    """R(z) (n, M), True where quadratures reached rounding, and a function for ∂R/∂z (n, n, M).

    The function returns None if there is no formula for ∂R/∂z.
    """

    value: Array
    reliable: Any
    slope: Callable[[], Array | None]


@dataclass(frozen=True)
class Equations:
    """The equations z = R(z) of M lanes, each with n unknowns; a call is for the lanes `lanes`.

    Attributes
    ----------
    size : (n, M)
        The size |y_i| of the component to which each unknown is added.
    evaluate : (z, lanes) -> Evaluation
    inside : (z, lanes) -> (M,) of bool, optional
        True for each lane for which the states that belong to z lie in the domain of the problem.
    exact : bool
        True if the formula of ∂R/∂z is exact; False if H″ is averaged by a few nodes only.
    magnitude : (z, lanes) -> (M,), optional
        The sum of the absolute values of the terms of R, the scale of its rounding if R cancels.
    """

    size: Array
    evaluate: Callable[[Array, Lanes], Evaluation]
    inside: Inside | None = None
    exact: bool = False
    magnitude: Callable[[Array, Lanes], Array] | None = None

    def advance(self, differences: bool, values: Any, lanes: Lanes) -> tuple[Array, Array, Flagged]:
        """F = z − R, Newton's correction and flags; `differences` is as for `slope`."""
        z = np.reshape(values, (len(values), -1))
        R = self.evaluate(z, lanes)
        F, K = z - R.value, self.slope(z, lanes, R, differences)
        correction = linear_solve(identity(len(z)) - K, F)
        singular: Any = False
        if not np.isfinite(correction).all():
            singular = np.isfinite(K).all(axis=(0, 1))
        left: Any = False
        if self.inside is not None:
            left = ~self.inside(z - correction, lanes)
        return F, correction, Flagged(np.logical_not(R.reliable), singular, left)

    def slope(self, z: Array, lanes: Lanes, R: Evaluation, differences: bool) -> Array:
        """The derivative ∂R/∂z (n, n, M), by its formula or by differences."""
        K = None if differences else R.slope()
        if K is not None:
            return K
        reach, domain = (self.size[:, lanes] + np.abs(z)).max(axis=0), self.inside
        reach = np.where(reach > 0, reach, np.abs(R.value).max(axis=0))  # for y0 = z = 0
        inside = None if domain is None else lambda at, copies: domain(at, lanes[copies])
        value = lambda at, copies: self.evaluate(at, lanes[copies]).value  # noqa: E731
        return forward_differences(value, inside, z, R.value, reach)

    def rounding(self, z: Array, lanes: Lanes) -> Array:
        """The largest residual (M,) that rounding explains: of y, of R by it, and of R's terms.

        A rounding of y moves R by |K||y0|, K = ∂R/∂z, which matters for stiff equations, in which
        terms of R cancel. K is taken at z = 0, and a factor 16 allows for its change along the
        step. K at z would allow any residual next to a singularity of ∇H.
        """
        start, size = np.zeros_like(z), self.size[:, lanes]
        K = self.slope(start, lanes, self.evaluate(start, lanes), differences=False)
        scale = (size + np.abs(z)).max(axis=0)
        allowed: Array = RESIDUAL_ROUNDING * (scale + 16 * matvec(np.abs(K), size).max(axis=0))
        if self.magnitude is not None:
            allowed = np.fmax(allowed, SUM_ROUNDING * self.magnitude(z, lanes))
        return allowed


def identity(n: int) -> Array:
    """The identity matrix for M lanes, (n, n, 1)."""
    return np.eye(n)[..., None]


def iterate(equations: Equations, start: Array, lanes: Lanes | None = None) -> Root:
    """Solve z = R(z) by Newton's method to stagnation, from `start` (n, M); try failed lanes again.

    `lanes` are the numbers of the M lanes (paths) in `equations`, by default 0 … M − 1.

    A lane may end close to a solution, but not at rounding: a formula of ∂R/∂z may average H″ with
    too few nodes for a long step. Such a lane goes on with ∂R/∂z from differences of R. A lane that
    still fails starts again from z = 0 by damped steps (`sepv.core.damped`), and goes on likewise.
    """
    numbers = np.arange(start.shape[1]) if lanes is None else lanes
    size = equations.size[:, numbers]
    rounding = equations.rounding if equations.exact else None
    root = newton(partial(equations.advance, False), size, start, numbers, equations.inside, rounding)
    if not root.status.any():
        return root
    failed = np.flatnonzero((root.status != Status.CONVERGED) & (root.status != Status.QUADRATURE))
    if failed.size:
        scale = (size[:, failed] + np.abs(root.value[:, failed])).max(axis=0)
        near = root.residual[failed] <= STAGNATION * scale
        finish(equations, root, numbers, failed[near])
        failed = failed[root.status[failed] != Status.CONVERGED]
        F = lambda z, at: z - equations.evaluate(z, at).value  # noqa: E731
        matrix = partial(derivative_of_residual, equations)
        merge(root, approach(F, matrix, equations.inside, len(start), numbers[failed]), failed)
        finish(equations, root, numbers, failed[root.status[failed] == Status.CONVERGED])
    return root


def derivative_of_residual(equations: Equations, z: Array, lanes: Lanes, F: Array) -> Array:
    """The derivative of F = z − R(z), which has the value F at z, from differences of R."""
    R = Evaluation(z - F, True, lambda: None)
    return identity(len(z)) - equations.slope(z, lanes, R, differences=True)


def finish(equations: Equations, root: Root, numbers: Lanes, lanes: Lanes) -> None:
    """Iterate `lanes` from their current z with ∂R/∂z from differences; merge the results."""
    if lanes.size:
        size, advance = equations.size[:, numbers[lanes]], partial(equations.advance, True)
        start = root.value[:, lanes]
        merge(root, newton(advance, size, start, numbers[lanes], equations.inside, equations.rounding), lanes)


def merge(whole: Root, part: Root, lanes: Lanes) -> None:
    """Write the roots of some lanes into those of all lanes, and add up the iterations."""
    whole.value[:, lanes], whole.residual[lanes] = part.value, part.residual
    whole.iterations[lanes] += part.iterations
    whole.status[lanes] = part.status
