"""Newton's iteration for a block of lanes in lockstep.

The first steps of all lanes are one piece; what is not done then goes on in groups, and what is not done after FAST
steps, or is in any trouble, is solved again by itself (`sepv.simulate._engine.careful`).
"""

from __future__ import annotations

from typing import Any

from sepv.simulate._engine.functions import prefer_512_bit
from sepv.simulate._engine.kernels.names import (
    FAST,
    GROUP,
    LIVING,
    STEPS,
    TOGETHER,
    WORK,
    L,
    ahead,
    first_steps,
    iteration,
    left_over,
    loaded,
    moved,
    some,
)


def advance(
    S: Any, I: Any, buffer: Any, count: int, first: int, h: float, bound: float, P: Any, careful: Any, problem: Any,
    shape: Any, table: Any,
) -> int:  # fmt: skip
    """`count` steps of a block; 1 where no lane lives on."""
    prefer_512_bit()
    q = loaded(P)
    for n in range(count):
        ahead(buffer, n)
        left = 0
        for k in range(TOGETHER):
            left += first_steps(S, I, buffer, n, k, first, h, bound, q)
        I[WORK] += STEPS * I[LIVING]
        for _ in range(FAST):
            if left == 0:
                break
            I[WORK] += left
            left = 0
            for group in range(0, L, GROUP):
                if some(I, group, 1):
                    for k in range(group, group + GROUP):
                        left += iteration(S, I, buffer, n, k, first, h, bound, q)
        if left > 0:
            left = left_over(S, I, P, careful, problem, shape, table)
        if not moved(S, I, buffer, n, first, h, bound, q, left):
            return 1
    return 0
