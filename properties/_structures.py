"""Tests of conditions on B (constant, Jacobi's identity)
at a state y and at states in general position near y.

The derivative of an entry of B may vanish at special states: that of 1 + y_1⁴y_2² does if y_1 = 0.
States of test cases often have zero components. If B were tested at y alone, a law could judge a
system to which it does not apply.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import numpy as np

from sepv.problem import Array, Problem, derivative_of_structure, jacobi_defect

# Distances of states near y from y, as shares of |y|. The first distance that stays in the
# problem's domain is used.
NEAR_SHARES = (2.0**-2, 2.0**-4, 2.0**-8, 2.0**-16)
GOLDEN_SHARE = (5**0.5 - 1) / 2
# Jacobi's identity counts as satisfied up to this share of its largest term. The share is a
# thousand times the error of numerical derivatives, and far below the defect of a B that violates
# the identity.
JACOBI_SHARE = 1e-8


def places(problem: Problem, y: Array) -> Iterator[Array]:
    """Yield y (d,) and up to two states near y in general position,
    without special components or differences.
    """
    yield y
    direction = 0.5 + np.arange(1, y.size + 1) * GOLDEN_SHARE % 1.0
    largest = float(np.max(np.abs(y))) or 1.0
    for sign in (1.0, -1.0):
        moved = (y + sign * share * largest * direction for share in NEAR_SHARES)
        yield from islice(
            (state for state in moved if problem.domain is None or np.all(problem.domain(state))), 1
        )


def is_constant(problem: Problem, y: Array) -> bool:
    """True if B is constant near y (d,): each of its derivatives is 0."""
    return not any(np.any(derivative_of_structure(problem, state)) for state in places(problem, y))


def is_poisson(problem: Problem, y: Array) -> bool:
    """True if B satisfies Jacobi's identity near y (d,)."""
    return all(_is_jacobi(problem, state) for state in places(problem, y))


def _is_jacobi(problem: Problem, y: Array) -> bool:
    terms = np.einsum(
        "il,jkl->ijk", np.abs(problem.structure(y)), np.abs(derivative_of_structure(problem, y))
    )
    return bool(np.max(np.abs(jacobi_defect(problem, y))) <= JACOBI_SHARE * np.max(terms))
