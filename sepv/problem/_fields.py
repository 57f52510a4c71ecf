"""Invariants of a problem and gradients of Casimirs for batches, and derivatives along a
direction.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sepv.core.arrays import Array, matvec
from sepv.core.average import average_gradient
from sepv.errors import UsageError
from sepv.problem._problem import Problem


def invariants(problem: Problem, y: Array) -> Array:
    """The invariants of a problem at y (d, ...), as rows (1 + n, ...): H,
    and its n quadratic and linear Casimirs.

    Sums are written out, so that the bits for one state do not depend on the other states of a
    batch.
    """
    none = np.zeros(y.shape[1:])
    rows = [problem.hamiltonian(y)]
    for A in problem.casimirs:
        rows.append(sum((A[i, j] * (y[i] * y[j]) for i, j in zip(*np.nonzero(A), strict=True)), start=none))
    for b in problem.linear_casimirs:
        rows.append(sum((b[i] * y[i] for i in range(len(b))), start=none))
    return np.stack(rows)


def known_invariants(problem: Problem | None, y: Array) -> Array:
    """The rows H and the Casimirs at y (d, ...). UsageError without a problem."""
    if problem is None:
        raise UsageError(
            expected="paths that know their problem",
            received="ones that were made by hand or with reduce= alone",
            remedy="take them from sepv.integrate or sepv.ensemble, or evaluate problem.hamiltonian(states) yourself",
        )
    return invariants(problem, y)


def changes_of_invariants(problem: Problem, y: Array) -> dict[str, Array]:
    """The changes of H and of the Casimirs C1, C2, … along one path y (d, N + 1)
    from its first state, by name.
    """
    with np.errstate(all="ignore"):
        rows = invariants(problem, y)
        return {f"C{n}" if n else "H": row - row[0] for n, row in enumerate(rows)}


def casimir_gradients(quadratic: Sequence[Any], linear: Sequence[Any], ends: Array) -> list[Array]:
    """The gradients of Casimirs yᵀAy and bᵀy, averaged along the segment from y0 to y1:
    A·ends and b, ends = y0 + y1.

    Each average has the shape (d, ...). With ends = 2y the averages are the gradients at y.
    """
    extra = (1,) * (ends.ndim - 1)
    return [
        *(matvec(np.reshape(A, (*np.shape(A), *extra)), ends) for A in quadratic),
        *(np.broadcast_to(np.reshape(b, (-1, *extra)), ends.shape) for b in linear),
    ]


def slope_along(function: Callable[[Array], Any], y: Array, direction: Array, width: Any) -> Array:
    """The derivative of a function at y in a direction,
    by central differences exact for polynomials of degree 6.
    """
    rises = [
        np.asarray(function(y + n * width * direction)) - function(y - n * width * direction)
        for n in (1, 2, 3)
    ]
    return np.asarray((45.0 * rises[0] - 9.0 * rises[1] + rises[2]) / (60 * width))


def energy_change(problem: Problem, y0: Array, y1: Array) -> Array:
    """H(y1) − H(y0) = ∇̄Hᵀ(y1 − y0), (...), without the digits that the difference of two values of
    H loses.

    Its rounding error is relative to |∇H||y1 − y0|, whatever constant H contains.
    """
    return np.asarray(np.sum(average_gradient(problem, y0, y1).value * (y1 - y0), axis=0))
