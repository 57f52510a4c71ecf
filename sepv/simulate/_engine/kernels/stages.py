"""Sweeps of an s-stage method for a block of lanes, rule by rule.

BUSY is 1 in a lane that sweeps, 4 in one that is to be checked, 0 in one that is done, and 2 in one that is left to
Newton's iteration (`sepv.simulate._engine.careful`).
"""

from __future__ import annotations

from typing import Any

from sepv.simulate._engine.functions import prefer_512_bit
from sepv.simulate._engine.kernels.names import (
    BLIND,
    CHECKED,
    COUNTS,
    EVALUATIONS,
    EXACT,
    FIRSTS,
    FUSED,
    GROUP,
    LIVING,
    NODES,
    RULES,
    STAGES,
    STRAIGHT,
    TESTED,
    WORK,
    L,
    add_node,
    ahead,
    blind,
    check,
    clear,
    first_steps,
    iteration,
    left_over,
    loaded,
    loaded_node,
    moved,
    some,
)


def advance(  # noqa: PLR0912 - in one piece, as the method reads
    S: Any, I: Any, buffer: Any, count: int, first: int, h: float, bound: float, P: Any, careful: Any, problem: Any,
    shape: Any, table: Any,
) -> int:  # fmt: skip
    """`count` steps of a block; 1 where no lane lives on."""
    prefer_512_bit()
    q = loaded(P)
    for n in range(count):
        ahead(buffer, n)
        for k in range(L):
            first_steps(S, I, buffer, n, k, first, h, bound, q)
        for _ in range(BLIND // FUSED):
            for k in range(L):
                blind(S, I, buffer, n, k, first, h, bound, q)
        I[EVALUATIONS] += (1 + BLIND * STAGES) * I[LIVING]
        I[WORK] += (1 + BLIND) * I[LIVING]
        left = I[LIVING]
        for rule in range(RULES):
            for _ in range(TESTED):
                if left == 0:
                    break
                I[WORK] += left
                I[EVALUATIONS] += left * COUNTS[2 * rule]
                left = 0
                for group in range(0, L, GROUP):
                    if some(I, group, 1):
                        sums(S, I, buffer, group, 2 * rule, q)
                        for k in range(group, group + GROUP):
                            left += iteration(S, I, buffer, n, k, first, h, bound, q)
            if CHECKED:
                for group in range(0, L, GROUP):
                    if some(I, group, 4):
                        sums(S, I, buffer, group, 2 * rule if EXACT else 2 * rule + 1, q)
                        for k in range(group, group + GROUP):
                            left += check(S, I, buffer, n, k, first, h, bound, q)
                I[EVALUATIONS] += I[LIVING] * COUNTS[2 * rule + 1]
        if not moved(S, I, buffer, n, first, h, bound, q, left_over(S, I, P, careful, problem, shape, table)):
            return 1
    return 0


def sums(S: Any, I: Any, buffer: Any, group: int, rule: int, q: Any) -> None:
    """G_i = Σ W_in ∇H(u_n) of a group, node by node; nothing where a sweep is written out."""
    prefer_512_bit()
    if STRAIGHT:
        return
    for k in range(group, group + GROUP):
        clear(S, I, buffer, 0, k, 0, 0.0, 0.0, q)
    for node in range(FIRSTS[rule], FIRSTS[rule] + COUNTS[rule]):
        weights = q + loaded_node(NODES[node])
        for k in range(group, group + GROUP):
            add_node(S, I, buffer, 0, k, 0, 0.0, 0.0, weights)
