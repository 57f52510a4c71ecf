"""The loop over the steps of a chunk, block by block: draw increments, sum them,
and advance by a generated kernel.

The kernel is passed as the address of a function, so that this file is compiled once for all
kernels. Its call costs 50 ns, for more than a thousand steps of paths. This file needs numba, and
is loaded by `sepv.simulate._compiled.store`.
"""

from __future__ import annotations

from typing import Any

from numba import njit

from sepv.simulate._compiled.functions import add_rows, copy_row, for_simd, part, raise_row, set_bits, set_row
from sepv.simulate._compiled.layout import ALIVE, FAILED, LIVING, STATUS
from sepv.simulate._compiled.signatures import OPTIONS, RUN, call_advance, call_begin, call_fill, call_start


@njit(RUN, **OPTIONS | {"no_cpython_wrapper": False})
def run(  # noqa: PLR0912 - in one piece, as a block runs
    beginning: int, filling: int, drawing: int, starting: int, advance: int, left_over: int, S: Any, I: Any, sums: Any,
    rng: Any, stack: Any, top: Any, ends: Any, W: Any, marks: Any, done: Any, n1: int, y0: Any, words: Any, path: int,
    factors: Any, base: int, halvings: int, given: Any, place: int, h: float, bound: float, thresholds: Any,
    values: Any, P: Any, buffer: Any, points: Any,
) -> None:  # fmt: skip
    """Run a chunk of paths in blocks of lanes from step done[0] to step n1.

    The state of each block is a set of arrays S, I, sums, rng, stack and top, which is set up
    before step 0. If a call runs all steps of the chunk, all blocks share one set. The first path
    of the chunk has the number `path`. Results are written to ends, W and marks (see
    `sepv.simulate._compiled.block_run`).

    If `given` (N, m, M) is empty, increments are drawn; else they are the columns of `given` from
    `place` on. If there are `values`, each increment is replaced by the value of the last threshold
    that it reaches. `advance` calls `left_over` for lanes that it has not solved. The last two
    arguments are scratch space.
    """
    for_simd()
    (piece, noises, lanes), n0 = buffer.shape, done[0]
    for first in range(0, ends.shape[1], lanes):
        alive, own, left = True, (first // lanes if S.shape[0] > 1 else 0), ends.shape[1] - first
        living = left if left < lanes else lanes  # numba would need longer to compile `min`
        streams, waiting, coarse = rng[own], stack[own], top[own]
        if n0 == 0:  # one block at a time, so that its data are in the cache when they are used
            set_bits(S.shape[1], (S, (own, 0), 0))
            set_bits(noises * lanes, (sums, (own, 0, 0), 0))
            set_bits(4 * lanes, (I, (own, 0), 0))
            set_bits(lanes, (I, (own, FAILED * lanes), -1))
            for i in range(y0.shape[0]):
                set_row(lanes, (S, (own, i * lanes), y0[i]))
            set_row(living, (I, (own, ALIVE * lanes), 1))
            I[own, 4 * lanes + LIVING] = living
            call_start(starting, (S[own], I[own], buffer, P))
        if n0 == 0 and rng.shape[1] > 0:
            number = path + first
            begun = drawing, streams, coarse, words, number, factors, base, halvings
            call_begin(beginning, begun)
        for n in range(n0, n1, piece):
            count = piece if n1 - n > piece else n1 - n
            lane = place + first
            increments = buffer
            if given.shape[0] == 0:
                rows = drawing, buffer, n, count, streams, waiting, coarse, factors, halvings
                call_fill(filling, rows)
            elif lane + lanes > given.shape[2]:  # lanes without a path have zeros
                for i in range(count):
                    for j in range(noises):
                        copy_row(given.shape[2] - lane, (given, (n + i, j, lane), buffer, (i, j, 0)))
            else:
                increments = part(given, n, lane)
            seen = increments
            if values.shape[0] > 0:
                seen = points
                for i in range(count):
                    for j in range(noises):
                        for t in range(values.shape[0]):
                            step = increments, (i, j, 0), points, (i, j, 0), thresholds[t], values[t]
                            raise_row(lanes, step)
            if alive:
                alive = call_advance(advance, (S[own], I[own], seen, count, n, h, bound, P, left_over)) == 0
            for j in range(noises):
                add_rows(increments, count, j, sums, own)
        for i in range(ends.shape[0]):
            copy_row(living, (S, (own, i * lanes), ends, (i, first)))
        for j in range(noises):
            copy_row(living, (sums, (own, j, 0), W, (j, first)))
        for i in range(2):
            copy_row(living, (I, (own, (STATUS + i) * lanes), marks, (i, first)))
    # The number of steps is written here, not by the caller, so that states are never ahead of it
    # after an interrupt.
    done[0] = n1
