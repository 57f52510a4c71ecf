"""The loop over the steps of a chunk of blocks: draw increments, sum them, and let a generated kernel advance.

The kernel is an argument, the address of a function of this type, so that this file is compiled once for all of them: a
call costs 30 ns and is made for some thousand path-steps. Needs numba; loaded by `sepv.engine.store`, by its content.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, types

from sepv.engine.functions import pick
from sepv.engine.lanes import coarse, fill, mix

_vector, _matrix, _block = types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1]
_integers, _streams = types.int64[:, ::1], types.uint64[:, :, :, ::1]
_stacks, _int, _float = types.float64[:, :, :, ::1], types.int64, types.float64
# advance(S, I, increments, count, first, h, bound, P): `count` steps of a block; 0 while one of its lanes lives.
ADVANCE = types.FunctionType(
    types.int64(_vector, types.int64[::1], _block, _int, _int, _float, _float, _vector)
)


@njit(types.void(_streams, _stacks, _vector, _int, _int), error_model="numpy", nogil=True, cache=True)
def start_streams(rng: Any, top: Any, factors: Any, base: int, halvings: int) -> None:
    """From the seeds of the streams rng (blocks, streams, 4, L) to their states, and the coarse increments `top`."""
    noises, lanes = top.shape[2], top.shape[3]
    raw = np.empty(lanes, np.uint64)
    scratch = np.empty((top.shape[1], noises, lanes))
    for b in range(rng.shape[0]):
        for stream in range(rng.shape[1]):
            mix(rng[b], stream)
        if top.shape[1] > 0:
            coarse(rng[b], top[b], factors, base, halvings, scratch, raw)


_kernel: Any = njit(error_model="numpy", nogil=True, cache=True)


@_kernel
def _copy(given: Any, first: int, count: int, lane: int, out: Any) -> None:
    """The steps first … first + count − 1 of lanes `lane` and on of `given`, zero where it has no more."""
    noises, lanes = out.shape[1], out.shape[2]
    width = min(lanes, given.shape[2] - lane)
    for i in range(count):
        for j in range(noises):
            row = given[first + i, j, lane : lane + width]
            if width == lanes:
                for k in range(lanes):
                    out[i, j, k] = row[k]
            else:
                for k in range(lanes):
                    out[i, j, k] = row[k] if k < width else 0.0


@_kernel
def _to_points(out: Any, count: int, thresholds: Any, values: Any) -> None:
    """Each increment becomes the value between whose thresholds it lies."""
    for i in range(count):
        for j in range(out.shape[1]):
            for k in range(out.shape[2]):
                u = out[i, j, k]
                v = values[0]
                for t in range(thresholds.shape[0]):
                    v = pick(u >= thresholds[t], values[t + 1], v)
                out[i, j, k] = v


@njit(
    types.void(
        ADVANCE, _matrix, _integers, _block, _streams, _stacks, _stacks, _vector, _int, _block, _int, _int, _int,
        _float, _float, _vector, _vector, _vector,
    ),
    error_model="numpy", nogil=True, cache=True,
)  # fmt: skip
def run(
    advance: Any, S: Any, I: Any, W: Any, rng: Any, stack: Any, top: Any, factors: Any, halvings: int, given: Any,
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
                fill(buffer, n, count, rng[b], stack[b], top[b], factors, halvings, raw)
            else:
                _copy(given, n, count, place + b * lanes, buffer)
            for i in range(count):
                for j in range(noises):
                    for k in range(lanes):
                        W[b, j, k] += buffer[i, j, k]
            if values.shape[0] > 0:
                _to_points(buffer, count, thresholds, values)
            if alive:
                alive = advance(S[b], I[b], buffer, count, n, h, bound, P) == 0
        # Written here and not by the caller, so that an interrupt never finds states ahead of their number.
        I[b, 4 * lanes + 4] = n1
