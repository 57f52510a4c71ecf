"""The kernels of the compiled engine: loops over steps, lanes and iterations, as ordinary functions.

A generated module (`sepv.simulate._compiled.layout`) compiles them by `compiled`, with its own values for the names at
the top here: the sizes of a problem and the pieces of straight-line code (`sepv.simulate._compiled.llvm`) printed from
its records. All state of a block is in one scratch buffer S at fixed offsets, its integers in I. The result of a lane
never depends on other lanes.
"""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any

from numba import njit

from sepv.simulate._compiled.functions import for_simd, prefetch
from sepv.simulate._compiled.signatures import OPTIONS, call_left_over

# Placeholders for names that a generated module defines; the values here are never used.
_made: Any = None
# The number of lanes in a block, and in a group of lanes that continue together.
L = GROUP = 0
# For `iterated`: the lanes in the first loop, whose piece may take two at a time; its iterations; further iterations.
TOGETHER = STEPS = FAST = 0
# Offsets in the integers of a block.
BUSY = ALIVE = STATUS = EVALUATIONS = STRUCTURES = LIVING = WORK = 0
# For `staged`: sweeps, and the nodes of the quadratures.
STAGES = RULES = BLIND = FUSED = TESTED = 0
EXACT = CHECKED = STRAIGHT = False
COUNTS = FIRSTS = NODES = _made
# For a projection: evaluations of the first iterations and of each further one.
FIRST_GRADIENTS = FIRST_STRUCTURES = AVERAGES = 0
loaded = loaded_node = _made
# Pieces f(S, I, buffer, n, k, first, h, bound, q) for lane k in step n; each returns a number that is added up.
first_steps = iteration = blind = check = clear = add_node = quick = masked = invariants = _made


def compiled(
    function: Callable[..., Any], names: dict[str, Any], signature: Any = None, inline: bool = False
) -> Any:
    """Compile the function over `names`, the globals of a generated module; the compiled code is kept beside its file.

    With a signature it is compiled at once, else at its first call.
    """
    code = function.__code__.replace(co_filename=names["__file__"])
    own = FunctionType(code, names, function.__name__)
    return njit(inline="always")(own) if inline else njit(signature, **OPTIONS)(own)


def start(S: Any, I: Any, buffer: Any, P: Any) -> None:
    """Compute the invariants of a block whose states are set."""
    q = loaded(P)
    for k in range(L):
        invariants(S, I, buffer, 0, k, 0, 0.0, 0.0, q)


def ahead(buffer: Any, n: int) -> None:
    """Prefetch the increments of the step after the next: given ones have their cache lines far apart."""
    for j in range(buffer.shape[1]):
        for k in range(0, L, 8):
            prefetch(buffer, n + 2, j, k)


def any_marked(I: Any, group: int, mark: int) -> bool:
    """True if BUSY has the bit `mark` (1, 2 or 4) for a lane of the group that begins at lane `group`."""
    for_simd()
    found = 0
    for k in range(group, group + GROUP):
        found |= I[BUSY + k]
    return found & mark != 0


def moved(
    S: Any, I: Any, buffer: Any, n: int, first: int, h: float, bound: float, q: Any, trouble: int
) -> bool:
    """End a step of all lanes: new states, statuses and defects of invariants.

    trouble : the number of lanes whose step failed; if it is 0 and all lanes live, no lane needs a mask

    Return True if a lane lives on.
    """
    for_simd()
    if trouble == 0 and I[LIVING] == L:
        for k in range(L):
            quick(S, I, buffer, n, k, first, h, bound, q)
        return True
    living = 0
    for k in range(L):
        living += masked(S, I, buffer, n, k, first, h, bound, q)
    I[LIVING] = living
    return living > 0


def solved(S: Any, I: Any, buffer: Any, n: int, left_over: int) -> int:
    """Solve the step of every lane that is still busy by a call of Python (`sepv.solve`); return their number."""
    trouble = 0
    for k in range(L):
        trouble += 1 if I[BUSY + k] != 0 else 0
    if trouble > 0:
        call_left_over(left_over, S, I, buffer, n)
    return trouble


def explicit(
    S: Any, I: Any, buffer: Any, count: int, first: int, h: float, bound: float, P: Any, left_over: int,  # noqa: ARG001
) -> int:  # fmt: skip
    """Take steps of an explicit scheme: the increment, and a test that it is finite. 1 if no lane lives on."""
    for_simd()
    q = loaded(P)
    for n in range(count):
        ahead(buffer, n)
        trouble = 0
        for k in range(L):
            trouble += first_steps(S, I, buffer, n, k, first, h, bound, q)
        if not moved(S, I, buffer, n, first, h, bound, q, trouble):
            return 1
    return 0


def iterated(
    S: Any, I: Any, buffer: Any, count: int, first: int, h: float, bound: float, P: Any, left_over: int
) -> int:
    """Take `count` steps by Newton's iteration, or by that of a projection, in lockstep; 1 if no lane lives on.

    The first steps of all lanes are one piece; lanes that are not done then go on in groups. Lanes not done after FAST
    steps, or in any trouble, are left over. BUSY is 1 in a lane that goes on, 0 in one that is done, and 2 where a
    projection ends outside the domain.
    """
    for_simd()
    q = loaded(P)
    for n in range(count):
        ahead(buffer, n)
        left = 0
        for k in range(TOGETHER):
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
                if any_marked(I, group, 1):
                    for k in range(group, group + GROUP):
                        left += iteration(S, I, buffer, n, k, first, h, bound, q)
        if left > 0:
            left = solved(S, I, buffer, n, left_over)
        if not moved(S, I, buffer, n, first, h, bound, q, left):
            return 1
    return 0


def staged(  # noqa: PLR0912 - in one piece, as the method reads
    S: Any, I: Any, buffer: Any, count: int, first: int, h: float, bound: float, P: Any, left_over: int
) -> int:
    """Take `count` steps of an s-stage method: sweeps, rule by rule.

    BUSY is 1 in a lane that sweeps, 4 in one whose result is to be checked, 0 in one that is done, and 2 in one left to
    Newton's iteration (`sepv.solve`).
    """
    for_simd()
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
                    if any_marked(I, group, 1):
                        sums(S, I, buffer, group, 2 * rule, q)
                        for k in range(group, group + GROUP):
                            left += iteration(S, I, buffer, n, k, first, h, bound, q)
            if CHECKED:
                for group in range(0, L, GROUP):
                    if any_marked(I, group, 4):
                        sums(S, I, buffer, group, 2 * rule if EXACT else 2 * rule + 1, q)
                        for k in range(group, group + GROUP):
                            left += check(S, I, buffer, n, k, first, h, bound, q)
                I[EVALUATIONS] += I[LIVING] * COUNTS[2 * rule + 1]
        if not moved(S, I, buffer, n, first, h, bound, q, solved(S, I, buffer, n, left_over)):
            return 1
    return 0


def sums(S: Any, I: Any, buffer: Any, group: int, rule: int, q: Any) -> None:
    """Compute G_i = Σ W_in ∇H(u_n) of a group, node by node. If a sweep is written out, do nothing."""
    for_simd()
    if STRAIGHT:
        return
    for k in range(group, group + GROUP):
        clear(S, I, buffer, 0, k, 0, 0.0, 0.0, q)
    for node in range(FIRSTS[rule], FIRSTS[rule] + COUNTS[rule]):
        weights = q + loaded_node(NODES[node])
        for k in range(group, group + GROUP):
            add_node(S, I, buffer, 0, k, 0, 0.0, 0.0, weights)
