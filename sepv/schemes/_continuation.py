"""Continuation for steps that Newton's iteration does not solve: scaled steps (s·h, s·ΔW)
are solved for growing s ≤ 1.

The solutions of the scaled steps form a curve that starts at y for s = 0. If the iteration for
the whole step, s = 1, fails, this curve is followed from a small s on. Each solution is predicted
by the secant through the two before it. The curve reaches s = 1, or ends earlier at a fold or at
the edge of the domain. A result solves the equation of the whole step to rounding and is
connected to y. The solved scaled steps of each path are counted. Laws never use continuation.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sepv.core.newton import Status
from sepv.core.step import Solution
from sepv.errors import UsageError
from sepv.problem import Array, Problem
from sepv.schemes._one_step import SOLUTION_COUNTS, merge, resolved
from sepv.schemes._scheme import Scheme

# The first value of s, so small that the iteration from y converges if it does for any s; and the
# least increment of s.
FIRST_S, S_MIN_INCREMENT = 2.0**-8, 2.0**-14
# The number of values of s that are tried before a curve is given up.
CONTINUATION_MAXITER = 200


def continued(scheme: Scheme) -> Scheme:
    """A copy of an implicit scheme that tries continuation for each step that has not converged.

    Parameters
    ----------
    scheme : Scheme
        An implicit scheme, such as (2.1), whose `solve(problem, y, h, dW, start)` takes a guess
        (d, M) of y1 − y0.

    Returns
    -------
    Scheme
        A scheme without claims. Its solutions have `continuations`, the number of scaled steps that
        were solved.

    Raises
    ------
    UsageError
        For a scheme whose `solve` has no argument `start`.
    """
    if scheme.solve is None or "start" not in inspect.signature(scheme.solve).parameters:
        raise UsageError(
            expected="an implicit scheme whose solve takes a start",
            received=f"the scheme {scheme.name!r}",
            remedy="take a smaller h, or divide steps that fail (sepv.schemes.divided)",
        )
    inner: Callable[..., Solution] = scheme.solve

    def solve(problem: Problem, y: Array, h: float, dW: Array) -> Solution:
        none = np.zeros(y.shape[1], dtype=np.int64)
        whole = replace(inner(problem, y, h, dW), continuations=none)
        for lane in np.flatnonzero(whole.status != Status.CONVERGED):
            one = np.array([lane])
            merge(whole, _follow(inner, problem, y[:, one], float(h), dW[:, one]), one)
        return whole

    return resolved(scheme, "continued", solve, "failed steps by continuation")


def _follow(inner: Callable[..., Solution], problem: Problem, y: Array, h: float, dW: Array) -> Solution:
    """Solve the scaled steps (s·h, s·ΔW) of one path for growing s; return the last,
    marked as failed unless s = 1.
    """
    share, growth, solved = 0.0, FIRST_S, 0
    z, slope = np.zeros_like(y), np.zeros_like(y)
    work = np.zeros(3, dtype=np.int64)
    for _ in range(CONTINUATION_MAXITER):
        trial = min(share + growth, 1.0)
        guess = z + (trial - share) * slope
        solution = inner(problem, y, trial * h, trial * dW, start=guess)
        work += [int(getattr(solution, key)[0]) for key in SOLUTION_COUNTS]
        assert solution.change is not None  # a scheme whose solver takes a start gives the change
        moved = np.abs(solution.change - z).max()
        # A solution too far from the prediction lies on another curve. For the first s there is no
        # prediction.
        near = share == 0.0 or np.abs(solution.change - guess).max() <= 0.5 * moved
        if solution.status[0] == Status.CONVERGED and near:
            slope = (solution.change - z) / (trial - share)
            z, share, solved, growth = solution.change, trial, solved + 1, 2 * growth
            if share == 1.0:
                break
        else:
            growth = (trial - share) / 2
            if growth < S_MIN_INCREMENT:
                if solution.status[0] == Status.CONVERGED:  # a solution on another curve
                    solution = replace(solution, status=np.array([int(Status.NO_CONVERGENCE)]))
                break
    else:
        solution = replace(solution, status=np.array([int(Status.NO_CONVERGENCE)]))
    counts = {key: np.array([n]) for key, n in zip(SOLUTION_COUNTS, work, strict=True)}
    return replace(solution, **counts, continuations=np.array([solved]))
