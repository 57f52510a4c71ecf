"""Division of steps that have no solution: a step is replaced by two halves (h/2, ΔW/2),
and each half likewise.

For large Δ the implicit equation may have no solution near y. The exact solution of (1.1) after a
step is the flow of B∇H at the time Δ, so that two halves lead to the state after the whole step.
For several structures this state depends on the path of W inside the step, and two halves assume a
straight line. Halves keep the invariants that the scheme keeps. A step with a solution is not
changed. Divisions are counted for each path. Laws never divide steps.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sepv._arguments import require_whole
from sepv.core.newton import Status
from sepv.core.step import Solution
from sepv.errors import UsageError
from sepv.problem import Array, Problem
from sepv.schemes._one_step import merge, resolved
from sepv.schemes._scheme import Scheme

MAX_DEPTH = 20


def divided(scheme: Scheme, depth: int = 8) -> Scheme:
    """A copy of an implicit scheme that halves a step that fails, and then halves failing parts,
    up to `depth` times.

    Parameters
    ----------
    scheme : Scheme
        An implicit scheme, with `solve`.
    depth : int, 1 to 20
        The largest number of times that a part is halved, so that one step has at most 2^depth
        parts.

    Returns
    -------
    Scheme
        A scheme without claims. Its solutions have `divisions`, the number of steps and parts that
        were divided.

    Raises
    ------
    UsageError
        For a scheme without a solver, or a depth out of range.
    """
    if scheme.solve is None:
        raise UsageError(
            expected="an implicit scheme, whose solver says when a step has no solution",
            received=f"the scheme {scheme.name!r} without solve",
            remedy="take a smaller h",
        )
    most = require_whole("depth", depth, "8 are 256 parts", 1, MAX_DEPTH)

    def solve(problem: Problem, y: Array, h: float, dW: Array) -> Solution:
        return _solve(scheme, problem, y, h, dW, most)

    return resolved(scheme, "divided", solve, f"failed steps in up to 2^{depth} parts")


def _solve(scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array, depth: int) -> Solution:
    """Solve one step of a batch y (d, M), and divide the steps that fail, at most `depth` times."""
    assert scheme.solve is not None
    divisions = np.zeros(y.shape[1], dtype=np.int64)
    whole = replace(scheme.solve(problem, y, h, dW), divisions=divisions)
    failed = np.flatnonzero(whole.status != Status.CONVERGED)
    if not failed.size or not depth:
        return whole
    divisions[failed] += 1
    change = np.full_like(y, np.nan) if whole.change is None else whole.change.copy()
    # The second half starts from the end of the first half, for the paths whose first half was
    # solved.
    first = _solve(scheme, problem, y[:, failed], h / 2, dW[:, failed] / 2, depth - 1)
    merge(whole, first, failed)
    arrived = failed[first.status == Status.CONVERGED]
    if arrived.size:
        second = _solve(scheme, problem, whole.value[:, arrived], h / 2, dW[:, arrived] / 2, depth - 1)
        merge(whole, second, arrived)
    change[:, failed] = whole.value[:, failed] - y[:, failed]
    return replace(whole, change=change)
