"""The kernels of the compiled engine: loops over steps, lanes (paths of a block) and iterations,
as ordinary functions.

A generated module (`sepv.simulate._compiled.layout`) compiles these functions by `compiled`, with
its own values for the names at the top of this file: the sizes of a problem, and pieces of
straight-line code (module `llvm`) printed from the problem's records. The state of a block is in
one scratch buffer S at fixed offsets, its integers in I. The result of a lane never depends on
other lanes.
"""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any

from numba import njit

from sepv.simulate._compiled.functions import for_simd, prefetch
from sepv.simulate._compiled.layout import BUSY, EVALUATIONS, GROUP, LIVING, STRUCTURES, WORK
from sepv.simulate._compiled.newton import MORE_ITERATIONS
from sepv.simulate._compiled.signatures import OPTIONS, call_left_over

# A line number beyond the end of every file. (Lines of another function make Python 3.13 raise
# TokenError.)
BEYOND = 10**6
# Placeholders for names that a generated module defines, as it does those of `layout` and `newton`;
# the values here are never used.
_made: Any = None
# The number of lanes in a block.
L = 0
# For `iterated`: the first loop's passes (each for one or two lanes) and iterations.
FIRST_PASSES = FIRST_ITERATIONS = 0
# For `staged`: numbers of sweeps, and the nodes of the quadratures.
STAGES = RULES = BLIND = FUSED = TESTED = 0
EXACT = CHECKED = STRAIGHT = False
COUNTS = FIRSTS = NODES = _made
# For a projection: numbers of evaluations in the first iterations, and in each further iteration.
FIRST_GRADIENTS = FIRST_STRUCTURES = AVERAGES = 0
loaded = loaded_node = _made
# Pieces f(S, I, buffer, n, k, first, h, bound, q) for lane k in step n; each returns a number that
# is added up.
first_steps = iteration = blind = check = clear = add_node = quick = masked = invariants = _made


def compiled(
    function: Callable[..., Any], names: dict[str, Any], signature: Any = None, inline: bool = False
) -> Any:
    """Compile a copy of a function in which global names have the values in `names`,
    a generated module's globals.

    With a signature it is compiled at once, else at its first call. Compiled code is cached beside
    the module's file. That file has none of the copy's lines: numba looks for them there, and finds
    nothing BEYOND its end.
    """
    code = function.__code__
    code = code.replace(co_filename=names["__file__"], co_firstlineno=BEYOND + code.co_firstlineno)
    own = FunctionType(code, names, function.__name__)
    return njit(inline="always")(own) if inline else njit(signature, **OPTIONS)(own)


def start(S: Any, I: Any, buffer: Any, P: Any) -> None:
    """Compute the invariants at the start of the paths of a block, whose states are set."""
    q = loaded(P)
    for k in range(L):
        invariants(S, I, buffer, 0, k, 0, 0.0, 0.0, q)


def ahead(buffer: Any, n: int) -> None:
    """Prefetch the increments of step n + 2, because the cache lines of given increments are far
    apart.
    """
    for j in range(buffer.shape[1]):
        for k in range(0, L, 8):
            prefetch(buffer, n + 2, j, k)


def any_marked(I: Any, group: int, mark: int) -> bool:
    """True if BUSY has the bit `mark` (1, 2 or 4) in some lane of the group that begins with lane
    `group`.
    """
    for_simd()
    found = 0
    for k in range(group, group + GROUP):
        found |= I[BUSY + k]
    return found & mark != 0


def moved(
    S: Any, I: Any, buffer: Any, n: int, first: int, h: float, bound: float, q: Any, trouble: int
) -> bool:
    """End a step of all lanes: set the new states, statuses and defects of invariants.

    trouble : the number of lanes whose step may have failed; if it is 0 and all L paths live, no
        lane needs a mask

    Return True if the path of at least one lane has not failed.
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
    """Solve the step of every busy lane (path) by a call of Python (`sepv.core`);
    return the number of busy lanes.
    """
    trouble = 0
    for k in range(L):
        trouble += 1 if I[BUSY + k] != 0 else 0
    if trouble > 0:
        call_left_over(left_over, S, I, buffer, n)
    return trouble


def explicit(
    S: Any, I: Any, buffer: Any, count: int, first: int, h: float, bound: float, P: Any, left_over: int,  # noqa: ARG001
) -> int:  # fmt: skip
    """Take `count` steps of an explicit scheme, and test that states are finite;
    return 1 if all paths failed.
    """
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
    """Take `count` steps, in lockstep, by Newton's iteration or that of a projection;
    return 1 if all paths failed.

    The first iterations are one piece of code for all lanes; lanes not done after them continue in
    groups. `sepv.core` solves lanes that are not done after MORE_ITERATIONS further iterations.
    BUSY is 1 in a lane (path) that continues, else 0.
    """
    for_simd()
    q = loaded(P)
    for n in range(count):
        ahead(buffer, n)
        left = 0
        for k in range(FIRST_PASSES):
            left += first_steps(S, I, buffer, n, k, first, h, bound, q)
        I[EVALUATIONS] += FIRST_GRADIENTS * I[LIVING]
        I[STRUCTURES] += FIRST_STRUCTURES * I[LIVING]
        I[WORK] += FIRST_ITERATIONS * I[LIVING]
        for _ in range(MORE_ITERATIONS):
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
    """Take `count` steps of an s-stage method by fixed-point sweeps,
    with finer quadrature rules if needed.

    BUSY is 1 in a lane (path) that sweeps, 4 in a lane whose result is to be checked, 0 in a lane
    that is done, and 2 in a lane that Newton's iteration (`sepv.core`) is to solve. Return 1 if all
    paths failed.
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
    """Average ∇H by a quadrature rule, G_i = Σ_n W_in ∇H(u_n), in a group of lanes;
    do nothing if nodes are stages.
    """
    for_simd()
    if STRAIGHT:
        return
    for k in range(group, group + GROUP):
        clear(S, I, buffer, 0, k, 0, 0.0, 0.0, q)
    for node in range(FIRSTS[rule], FIRSTS[rule] + COUNTS[rule]):
        weights = q + loaded_node(NODES[node])
        for k in range(group, group + GROUP):
            add_node(S, I, buffer, 0, k, 0, 0.0, 0.0, weights)
