"""What the kernels of all schemes have in common: the start, the end of a step, lanes that are looked at alone."""

from __future__ import annotations

from typing import Any

from sepv.simulate._engine.functions import prefer_512_bit, prefetch
from sepv.simulate._engine.kernels.names import (
    BUSY,
    EQUATION,
    GRADIENT,
    GROUP,
    HESSIAN,
    INSIDE,
    LIVING,
    STATUS,
    STRUCTURE,
    L,
    domain,
    equation,
    first_steps,
    gradient,
    hessian,
    invariants,
    loaded,
    masked,
    quick,
    structure,
    turned,
)
from sepv.simulate._engine.signatures import call_careful


def start(S: Any, I: Any, buffer: Any, P: Any) -> None:
    """The invariants of a block whose states are set."""
    q = loaded(P)
    for k in range(L):
        invariants(S, I, buffer, 0, k, 0, 0.0, 0.0, q)


def problem(what: int, x: Any, v: Any, A: Any, b: Any, P: Any) -> int:
    """One of a problem's functions at x, for a lane by itself."""
    q = loaded(P)
    if what == EQUATION:
        return equation(x, v, A, b, q)
    if what == INSIDE:
        return domain(x, v, A, b, q)
    if what == GRADIENT:
        return gradient(x, v, A, b, q)
    if what == HESSIAN:
        return hessian(x, v, A, b, q)
    if what == STRUCTURE:
        return structure(x, v, A, b, q)
    return turned(x, v, A, b, q)


def ahead(buffer: Any, n: int) -> None:
    """Fetches the increments of the step after the next, whose cache lines lie far apart where they are given."""
    for j in range(buffer.shape[1]):
        for k in range(0, L, 8):
            prefetch(buffer, n + 2, j, k)


def some(I: Any, group: int, mark: int) -> bool:
    """Whether one lane of the group has this mark, 1, 2 or 4."""
    prefer_512_bit()
    found = 0
    for k in range(group, group + GROUP):
        found |= I[BUSY + k]
    return found & mark != 0


def moved(
    S: Any, I: Any, buffer: Any, n: int, first: int, h: float, bound: float, q: Any, trouble: int
) -> bool:
    """The step's end: states, statuses, invariants; without masks where all lanes live and none was in trouble.

    Whether a lane lives on.
    """
    prefer_512_bit()
    if trouble == 0 and I[LIVING] == L:
        for k in range(L):
            quick(S, I, buffer, n, k, first, h, bound, q)
        return True
    living = 0
    for k in range(L):
        living += masked(S, I, buffer, n, k, first, h, bound, q)
    I[LIVING] = living
    return living > 0


def left_over(S: Any, I: Any, P: Any, careful: Any, problem: Any, shape: Any, table: Any) -> int:
    """Every lane that is still busy, by itself; how many there were."""
    trouble = 0
    for k in range(L):
        trouble += 1 if I[BUSY + k] != 0 else 0
    if trouble > 0:
        for k in range(L):
            if I[BUSY + k] != 0:
                I[STATUS + k] = call_careful(careful, (S, I, k, P, problem, shape, table))
    return trouble


def explicit(
    S: Any, I: Any, buffer: Any, count: int, first: int, h: float, bound: float, P: Any,
    careful: Any, problem: Any, shape: Any, table: Any,  # noqa: ARG001 - of implicit schemes
) -> int:  # fmt: skip
    """Steps of an explicit scheme: the increment itself, and whether it leads anywhere. 1 where no lane lives on."""
    prefer_512_bit()
    q = loaded(P)
    for n in range(count):
        ahead(buffer, n)
        trouble = 0
        for k in range(L):
            trouble += first_steps(S, I, buffer, n, k, first, h, bound, q)
        if not moved(S, I, buffer, n, first, h, bound, q, trouble):
            return 1
    return 0
