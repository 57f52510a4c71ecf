"""Explicit increments that are projected on the invariants: iterations of the invariants alone.

BUSY is 1 in a lane that goes on, 0 in one that is done, and 2 in one that ends outside the domain.
"""

from __future__ import annotations

from typing import Any

from sepv.simulate._engine.functions import prefer_512_bit
from sepv.simulate._engine.kernels.names import (
    AVERAGES,
    BROKEN,
    BUSY,
    EVALUATIONS,
    FAST,
    FIRST_GRADIENTS,
    FIRST_STRUCTURES,
    GROUP,
    INF,
    LEFT_DOMAIN,
    LIVING,
    NO_CONVERGENCE,
    STATUS,
    STEPS,
    STRUCTURES,
    UNKNOWN_ROWS,
    UNKNOWNS,
    WORK,
    L,
    ahead,
    first_steps,
    iteration,
    loaded,
    moved,
    some,
)


def advance(
    S: Any, I: Any, buffer: Any, count: int, first: int, h: float, bound: float, P: Any,
    careful: Any, problem: Any, shape: Any, table: Any,  # noqa: ARG001 - of implicit schemes
) -> int:  # fmt: skip
    """`count` steps of a block; 1 where no lane lives on."""
    prefer_512_bit()
    q = loaded(P)
    for n in range(count):
        ahead(buffer, n)
        left = 0
        for k in range(L):
            left += first_steps(S, I, buffer, n, k, first, h, bound, q)
        I[EVALUATIONS] += FIRST_GRADIENTS * I[LIVING]
        I[STRUCTURES] += FIRST_STRUCTURES * I[LIVING]
        I[WORK] += STEPS * I[LIVING]
        for _ in range(FAST):
            if left == 0:
                break
            I[WORK] += left
            I[EVALUATIONS] += AVERAGES * left
            left = 0
            for group in range(0, L, GROUP):
                if some(I, group, 1):
                    for k in range(group, group + GROUP):
                        left += iteration(S, I, buffer, n, k, first, h, bound, q)
        if not moved(S, I, buffer, n, first, h, bound, q, refused(S, I)):
            return 1
    return 0


def refused(S: Any, I: Any) -> int:
    """What is wrong with every lane that is left; how many there are."""
    trouble = 0
    for k in range(L):  # a loop of its own, without branches: it is made in every step
        trouble += 1 if I[BUSY + k] != 0 else 0
    if trouble == 0:
        return 0
    for k in range(L):
        if I[BUSY + k] != 0:
            size = 0.0
            for i in range(UNKNOWNS):
                size += abs(S[UNKNOWN_ROWS + i * L + k])
            code = NO_CONVERGENCE if size < INF else BROKEN
            I[STATUS + k] = LEFT_DOMAIN if I[BUSY + k] == 2 else code
    return trouble
