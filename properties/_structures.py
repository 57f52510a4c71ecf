"""Conditions on B that laws need of a case, tested at states in general position.

A derivative of B may vanish at one state alone: that of 1 + y_1⁴y_2² does wherever y_1 = 0, and states of cases have
zero components. A condition that holds at such a state only would let a law judge a system that it is not about.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import numpy as np

from sepv.problem import Array, Problem, derivative_of_structure, jacobi_defect

# Distances from y of the other states, as shares of |y|: the first that stays in the problem's domain is taken.
SHARES = (2.0**-2, 2.0**-4, 2.0**-8, 2.0**-16)
GOLDEN = (5**0.5 - 1) / 2
# Jacobi's identity holds to this share of its largest term: a thousand times the error of differences, and far below
# the defect of a structure without it.
JACOBI = 1e-8


def places(problem: Problem, y: Array) -> Iterator[Array]:
    """The state y (d,), and up to two states near it of which no component, and no difference of two, is special."""
    yield y
    direction = 0.5 + np.arange(1, y.size + 1) * GOLDEN % 1.0
    largest = float(np.max(np.abs(y))) or 1.0
    for sign in (1.0, -1.0):
        moved = (y + sign * share * largest * direction for share in SHARES)
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
    return bool(np.max(np.abs(jacobi_defect(problem, y))) <= JACOBI * np.max(terms))
