"""The loop over the steps of a chunk of blocks: draw increments, sum them, and let a generated kernel advance.

The kernel is an argument, the address of a function, so that this file is compiled once for all of them: a call costs
50 ns and is made for some thousand path-steps. Needs numba; loaded by `sepv.simulate._compiled.store`, by its content.
"""

from __future__ import annotations

from typing import Any

from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from sepv.simulate._compiled.functions import select
from sepv.simulate._compiled.lanes import begin, fill, normals
from sepv.simulate._compiled.layout import ALIVE, DONE, FAILED, LANES, LIVING
from sepv.simulate._compiled.signatures import OPTIONS, RUN, address, call_advance, call_begin, call_fill

BEGINNING, FILLING, DRAWING = address(begin), address(fill), address(normals)


# Inlined by numba, so that they are compiled once, with `run`.
_kernel: Any = njit(error_model="numpy", nogil=True, inline="always")


@intrinsic
def _from(typingctx: Any, array: Any, first: Any, lane: Any) -> Any:  # noqa: ARG001 - numba's signature
    """The array (N, m, M) from array[first, 0, lane] on, with its strides: rows go on into the next at their end."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = signature.return_type
        whole = make_array(kind)(context, builder, arguments[0])
        shape = cgutils.unpack_tuple(builder, whole.shape, 3)
        skipped = builder.mul(arguments[1], builder.mul(shape[1], shape[2]))
        data = builder.gep(whole.data, [builder.add(skipped, arguments[2])], inbounds=True)
        found = make_array(kind)(context, builder)
        populate_array(
            found, data=data, shape=whole.shape, strides=whole.strides, itemsize=whole.itemsize, meminfo=None
        )
        return found._getvalue()

    return array(array, types.int64, types.int64), code


@_kernel
def _copy(given: Any, first: int, count: int, lane: int, out: Any) -> None:
    """Copy the steps first … first + count − 1 of lanes `lane` and on of `given`, zero beyond its end."""
    width = given.shape[2] - lane
    for i in range(count):
        for j in range(out.shape[1]):
            for k in range(out.shape[2]):
                out[i, j, k] = given[first + i, j, lane + k] if k < width else 0.0


@_kernel
def _add(increments: Any, count: int, W: Any, b: int) -> None:
    """Add the increments to the sums of block b."""
    for j in range(W.shape[1]):
        if W.shape[2] == LANES:
            for i in range(count):
                for k in range(LANES):
                    W[b, j, k] += increments[i, j, k]
        else:
            for k in range(W.shape[2]):
                total = W[b, j, k]  # in a register: through memory each sum would wait for the last store
                for i in range(count):
                    total += increments[i, j, k]
                W[b, j, k] = total


@_kernel
def _to_points(increments: Any, count: int, thresholds: Any, values: Any, out: Any) -> None:
    """Replace each increment by the value between whose thresholds it lies."""
    for i in range(count):
        for j in range(out.shape[1]):
            for k in range(out.shape[2]):
                u = increments[i, j, k]
                v = values[0]
                for t in range(thresholds.shape[0]):
                    v = select(u >= thresholds[t], values[t + 1], v)
                out[i, j, k] = v


@_kernel
def _settle(S: Any, I: Any, lanes: int, start: Any, count: int, b: int) -> None:
    """Set the state of block b at the start; its integers I and the sums of its increments are zero already."""
    living = min(lanes, count - b * lanes)
    for i in range(start.shape[0]):
        S[b, i] = start[i]
    for k in range(lanes):
        I[b, FAILED * lanes + k] = -1
        I[b, ALIVE * lanes + k] = select(k < living, 1, 0)
    I[b, 4 * lanes + LIVING] = living


@njit(RUN, **OPTIONS)
def run(
    beginning: int, filling: int, drawing: int, advance: Any, left_over: Any, S: Any, I: Any, W: Any, start: Any,
    living: int, words: Any, path: int, rng: Any, stack: Any, top: Any, factors: Any, base: int, halvings: int,
    given: Any, place: int, n0: int, n1: int, h: float, bound: float, thresholds: Any, values: Any, P: Any,
    buffer: Any, points: Any, halves: Any, scratch: Any,
) -> None:  # fmt: skip
    """Run steps n0 … n1 − 1 of a chunk of blocks.

    The state of the chunk is S, I, W, rng, stack and top; it is set up if n0 = 0. Blocks that run to the end at once
    share one set of the last three. The first path has the number `path`.

    Increments are those of lanes `place` and on of `given` (N, m, M), or are drawn if that is empty. If there are
    `values`, each increment is replaced by the value between whose thresholds it lies. `advance` calls `left_over` for
    lanes that it has not solved. The last four arguments are scratch space of this function, `begin` and `normals`.
    """
    piece, lanes = buffer.shape[0], W.shape[2]
    for b in range(S.shape[0]):
        alive, own = True, min(b, rng.shape[0] - 1)
        streams, waiting, coarse = rng[own], stack[own], top[own]
        if n0 == 0:  # one block at a time, so that its data are in the cache when they are used
            _settle(S, I, lanes, start, living, b)
        if n0 == 0 and rng.shape[1] > 0:
            number = path + b * lanes
            begun = drawing, streams, coarse, words, number, factors, base, halvings, halves, scratch
            call_begin(beginning, begun)
        for n in range(n0, n1, piece):
            count = min(piece, n1 - n)
            lane = place + b * lanes
            increments = buffer
            if given.shape[0] == 0:
                rows = drawing, buffer, n, count, streams, waiting, coarse, factors, halvings, scratch
                call_fill(filling, rows)
            elif lane + lanes > given.shape[2]:
                _copy(given, n, count, lane, buffer)
            else:
                increments = _from(given, n, lane)
            seen = increments
            if values.shape[0] > 0:
                _to_points(increments, count, thresholds, values, points)
                seen = points
            if alive:
                alive = call_advance(advance, (S[b], I[b], seen, count, n, h, bound, P, left_over)) == 0
            _add(increments, count, W, b)
        # Written here and not by the caller, so that states are never ahead of their number after an interrupt.
        I[b, 4 * lanes + DONE] = n1
