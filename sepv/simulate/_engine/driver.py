"""The loop over the steps of a chunk of blocks: draw increments, sum them, and let a generated kernel advance.

The kernel is an argument, the address of a function, so that this file is compiled once for all of them: a call costs
50 ns and is made for some thousand path-steps. Needs numba; loaded by `sepv.simulate._engine.store`, by its content.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from sepv.simulate._engine.functions import select
from sepv.simulate._engine.lanes import fill
from sepv.simulate._engine.module import LANES, PENDING
from sepv.simulate._engine.signatures import CAREFUL, RUN, address, call_advance, call_fill


@njit(CAREFUL, error_model="numpy", nogil=True, cache=True)
def later(S: Any, I: Any, k: int, P: Any, problem: Any, shape: Any, table: Any) -> int:  # noqa: ARG001 - CAREFUL
    """In the place of `sepv.simulate._engine.careful`, which is compiled when a lane first needs it."""
    return PENDING


LATER, FILLING = address(later), address(fill)


_kernel: Any = njit(error_model="numpy", nogil=True, cache=True)


@_kernel
def _copy(given: Any, first: int, count: int, lane: int, out: Any) -> None:
    """The steps first … first + count − 1 of lanes `lane` and on of `given`, zero where it has no more."""
    noises, lanes = out.shape[1], out.shape[2]
    width = min(lanes, given.shape[2] - lane)
    # Not negative, as the compiler cannot know otherwise.
    place = np.uint64(lane)
    for i in range(count):
        for j in range(noises):
            if width == LANES:  # a number that the compiler knows: twice as fast
                for k in range(LANES):
                    out[i, j, k] = given[first + i, j, place + np.uint64(k)]
            else:
                for k in range(width):
                    out[i, j, k] = given[first + i, j, place + np.uint64(k)]
                for k in range(width, lanes):
                    out[i, j, k] = 0.0


@_kernel
def _add(increments: Any, count: int, W: Any, b: int) -> None:
    """The sums of block b."""
    for i in range(count):
        for j in range(W.shape[1]):
            if W.shape[2] == LANES:
                for k in range(LANES):
                    W[b, j, k] += increments[i, j, k]
            else:
                for k in range(W.shape[2]):
                    W[b, j, k] += increments[i, j, k]


@_kernel
def _to_points(out: Any, count: int, thresholds: Any, values: Any) -> None:
    """Each increment becomes the value between whose thresholds it lies."""
    for i in range(count):
        for j in range(out.shape[1]):
            for k in range(out.shape[2]):
                u = out[i, j, k]
                v = values[0]
                for t in range(thresholds.shape[0]):
                    v = select(u >= thresholds[t], values[t + 1], v)
                out[i, j, k] = v


@njit(RUN, error_model="numpy", nogil=True, cache=True)
def run(
    filling: int, advance: Any, careful: Any, problem: Any, shape: Any, table: Any,
    S: Any, I: Any, W: Any, rng: Any, stack: Any, top: Any, factors: Any, halvings: int, given: Any,
    place: int, n0: int, n1: int, h: float, bound: float, thresholds: Any, values: Any, P: Any,
) -> None:  # fmt: skip
    """Steps n0 … n1 − 1 of a chunk of blocks; S, I, W, rng, stack and top are its state.

    Increments are drawn, or those of lanes `place` and on of `given` (N, m, M) where it is not empty; where there are
    `values`, the scheme sees the one between whose thresholds the increment lies.
    """
    noises, lanes = W.shape[1], W.shape[2]
    piece = max(16, 1024 // lanes)
    buffer = np.empty((piece, noises, lanes))
    raw = np.empty(lanes, np.uint64)
    for b in range(S.shape[0]):
        alive = True
        for n in range(n0, n1, piece):
            count = min(piece, n1 - n)
            if given.shape[0] == 0:
                call_fill(filling, (buffer, n, count, rng[b], stack[b], top[b], factors, halvings, raw))
            else:
                _copy(given, n, count, place + b * lanes, buffer)
            _add(buffer, count, W, b)
            if values.shape[0] > 0:
                _to_points(buffer, count, thresholds, values)
            if alive:
                alive = (
                    call_advance(
                        advance, (S[b], I[b], buffer, count, n, h, bound, P, careful, problem, shape, table)
                    )
                    == 0
                )
        # Written here and not by the caller, so that an interrupt never finds states ahead of their number.
        I[b, 4 * lanes + 4] = n1
