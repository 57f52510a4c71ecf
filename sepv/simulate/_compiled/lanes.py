"""The normals and the increments of a block of paths side by side: one stream of SFC64 a lane.

The streams, their order and the ziggurat are numpy's (`Generator(SFC64).standard_normal`), so that the
numbers are those of `sepv.simulate._wiener` to the bit. Imported by generated code alone: this module needs numba.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numba.np.random._constants import fi_double, ki_double, wi_double, ziggurat_nor_inv_r, ziggurat_nor_r

from sepv.simulate._compiled.functions import lowest_bit, marked, not_, prefer_512_bit, select, sfc64
from sepv.simulate._compiled.signatures import BEGIN, FILL, NORMALS, OPTIONS, ZIGGURAT, call_normals
from sepv.simulate._wiener import MIXING, STREAMS

# The number of levels that `fill` halves together, 64 steps: only the driver's pieces of single paths are so long.
TOGETHER = 6
_OPTIONS: Any = OPTIONS | {"no_cpython_wrapper": True}
# Inlined before types are inferred: one compilation for each function that is called by its address.
_inline: Any = njit(error_model="numpy", inline="always")
_WIDTH = np.array(wi_double, dtype=np.float64)
_LIMIT = np.array(ki_double, dtype=np.int64)
_HEIGHT = np.array(fi_double, dtype=np.float64)
_R, _INVERSE_R = float(ziggurat_nor_r), float(ziggurat_nor_inv_r)
_MANTISSA = np.int64(0x000FFFFFFFFFFFFF)
_UNIT = 1.0 / 9007199254740992.0


@_inline
def _next(rng: Any, s: int, k: int) -> Any:
    """The next 64 bits of stream s of lane k."""
    out, a, b, c, counter = sfc64(rng[s, 0, k], rng[s, 1, k], rng[s, 2, k], rng[s, 3, k])
    rng[s, 0, k], rng[s, 1, k], rng[s, 2, k], rng[s, 3, k] = a, b, c, counter
    return out


@_inline
def _uniform(rng: Any, s: int, k: int) -> float:
    return np.int64(_next(rng, s, k) >> np.uint64(11)) * _UNIT


@_inline
def _first(r: Any) -> Any:
    """The normal that the ziggurat makes of the 64 bits r, and True if it is accepted without further draws."""
    layer = r & np.uint64(0xFF)
    rabs = np.int64(r >> np.uint64(9)) & _MANTISSA
    x = rabs * _WIDTH[layer]
    return select((r & np.uint64(0x100)) != 0, -x, x), rabs < _LIMIT[layer]


@njit(ZIGGURAT, **_OPTIONS)
def _ziggurat(rng: Any, s: int, k: int, r: Any) -> float:
    """Continue the ziggurat of lane k from the draw r of stream s until it accepts a standard normal."""
    while True:
        layer = np.int64(r & np.uint64(0xFF))
        rabs = np.int64(r >> np.uint64(9)) & _MANTISSA
        x = rabs * _WIDTH[layer]
        if r & np.uint64(0x100):
            x = -x
        if rabs < _LIMIT[layer]:
            return x
        if layer == 0:
            while True:
                xx = -_INVERSE_R * np.log1p(-_uniform(rng, s, k))
                yy = -np.log1p(-_uniform(rng, s, k))
                if yy + yy > xx * xx:
                    return -(_R + xx) if (rabs >> 8) & 1 else _R + xx
        elif (_HEIGHT[layer - 1] - _HEIGHT[layer]) * _uniform(rng, s, k) + _HEIGHT[layer] < np.exp(
            -0.5 * x * x
        ):
            return x
        r = _next(rng, s, k)


@njit(NORMALS, **_OPTIONS)
def normals(rng: Any, s: int, out: Any, first: int, apart: int, count: int, scratch: Any) -> None:
    """Draw standard normals from stream s of rng (streams, 4, L), for each lane and noise.

    They fill the `count` rows first, first + apart, and so on of out (n, m, L).

    scratch : the draws (L,), and a byte for each lane that the ziggurat has not finished, 0 in those beyond L
    """
    prefer_512_bit()
    raw, late = scratch
    noises, lanes = out.shape[1], out.shape[2]
    if lanes == 1:
        # The state stays in registers: through memory each draw would wait for the last store.
        a, b, c, counter = rng[s, 0, 0], rng[s, 1, 0], rng[s, 2, 0], rng[s, 3, 0]
        for i in range(first, first + apart * count, apart):
            for j in range(noises):
                r, a, b, c, counter = sfc64(a, b, c, counter)
                x, done = _first(r)
                if not done:
                    rng[s, 0, 0], rng[s, 1, 0], rng[s, 2, 0], rng[s, 3, 0] = a, b, c, counter
                    x = _ziggurat(rng, s, 0, r)
                    a, b, c, counter = rng[s, 0, 0], rng[s, 1, 0], rng[s, 2, 0], rng[s, 3, 0]
                out[i, j, 0] = x
        rng[s, 0, 0], rng[s, 1, 0], rng[s, 2, 0], rng[s, 3, 0] = a, b, c, counter
        return
    for i in range(first, first + apart * count, apart):
        for j in range(noises):
            for k in range(lanes):
                raw[k] = _next(rng, s, k)
                out[i, j, k], done = _first(raw[k])
                late[k] = not_(done)
            # Bits mark the lanes that need more draws, one in a hundred. A branch for each lane would cost more.
            for block in range(0, lanes, 64):
                bits = marked(late, block)
                while bits != 0:
                    k = block + lowest_bit(bits)
                    bits &= bits - np.uint64(1)
                    out[i, j, k] = _ziggurat(rng, s, k, raw[k])


@_inline
def _halve(left: Any, i: int, right: Any, n: int, j: int, k: int, factor: float) -> None:
    """Replace an increment in left[i] and a normal in right[n] by the increments over the halves of its step."""
    whole = left[i, j, k]
    half = 0.5 * whole + factor * right[n, j, k]
    left[i, j, k] = half
    right[n, j, k] = whole - half


@njit(FILL, **_OPTIONS)
def fill(  # noqa: PLR0912 - in one piece, as the levels follow each other
    drawing: int, out: Any, first: int, count: int, rng: Any, stack: Any, top: Any, factors: Any, above: int,
    scratch: Any,
) -> None:  # fmt: skip
    """Write increments of the steps first … first + count − 1 of a block into out (count, m, L).

    drawing : the address of `normals`
    stack (streams, m, L) keeps the right halves for later; top (n, m, L) is the coarse part, n = 0 where it is drawn
    here; `above` is the number of its halvings.
    """
    prefer_512_bit()
    fine = max(rng.shape[0] - 1, 0)  # without noise there are no streams
    noises, lanes = out.shape[1], out.shape[2]
    below = min(fine, TOGETHER)
    if top.shape[0] == 0 and noises > 0:
        begun = -first & ((1 << fine) - 1)
        call_normals(drawing, (rng, 0, out, begun, 1 << fine, ((count - begun - 1) >> fine) + 1, scratch))
    i = 0
    while i < count:
        n = first + i
        level = fine
        while level > 0 and n & 1 == 0:
            level -= 1
            n >>= 1
        # n is now the number of the increment of that level; an odd one waits on the stack.
        for j in range(noises):
            for k in range(lanes):
                if level > 0:
                    out[i, j, k] = stack[level, j, k]
                elif top.shape[0]:
                    out[i, j, k] = top[n, j, k]
                else:
                    out[i, j, k] *= factors[0]
        # The last levels are halved together where all their steps are asked for.
        together = below if level <= fine - below and i + (1 << below) <= count else 0
        for deeper in range(level + 1, fine + 1 - together):
            call_normals(drawing, (rng, deeper, stack, deeper, 1, 1, scratch))
            for j in range(noises):
                for k in range(lanes):
                    _halve(out, i, stack, deeper, j, k, factors[above + deeper])
        for deeper in range(fine + 1 - together, fine + 1):
            apart = 1 << (fine - deeper)
            pairs = 1 << (together - 1 - fine + deeper)
            call_normals(drawing, (rng, deeper, out, i + apart, 2 * apart, pairs, scratch))
            for left_half in range(i, i + (1 << together), 2 * apart):
                for j in range(noises):
                    if lanes == 1:  # without a loop, whose start costs more than its work
                        _halve(out, left_half, out, left_half + apart, j, 0, factors[above + deeper])
                        continue
                    for k in range(lanes):
                        _halve(out, left_half, out, left_half + apart, j, k, factors[above + deeper])
        i += 1 << together


@njit(BEGIN, **_OPTIONS)
def begin(
    drawing: int, rng: Any, top: Any, words: Any, path: int, factors: Any, base: int, halvings: int, halves: Any,
    scratch: Any,
) -> None:  # fmt: skip
    """Set up the streams of a block, rng (streams, 4, L), of paths `path` and on, and its coarse increments.

    The latter are top (n, m, L) with n = base·2^halvings or 0, drawn level by level in place.

    drawing, scratch : the address of `normals`, and its scratch space
    words : the first words of the streams, (streams, 3) (`sepv.simulate._wiener.stream_words`)
    halves : scratch space (n/2, m, L)
    """
    prefer_512_bit()
    for s in range(rng.shape[0]):
        for k in range(rng.shape[2]):
            a, b, counter = words[s, 0], words[s, 1], np.uint64(1)
            c = words[s, 2] + np.uint64(path + k) * np.uint64(STREAMS)
            for _ in range(MIXING):  # in registers
                _, a, b, c, counter = sfc64(a, b, c, counter)
            rng[s, 0, k], rng[s, 1, k], rng[s, 2, k], rng[s, 3, k] = a, b, c, counter
    if top.shape[0] == 0:
        return
    noises, lanes = top.shape[1], top.shape[2]
    length = base
    call_normals(drawing, (rng, 0, top, 0, 1, base, scratch))
    for i in range(base):
        for j in range(noises):
            for k in range(lanes):
                top[i, j, k] *= factors[0]
    for level in range(1, halvings + 1):
        # Normals of a level come in the order of time; its increments are spread from the end.
        call_normals(drawing, (rng, 0, halves, 0, 1, length, scratch))
        for i in range(length - 1, -1, -1):
            for j in range(noises):
                for k in range(lanes):
                    whole = top[i, j, k]
                    left = 0.5 * whole + factors[level] * halves[i, j, k]
                    top[2 * i, j, k] = left
                    top[2 * i + 1, j, k] = whole - left
        length *= 2
