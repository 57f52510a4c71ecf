"""Normals and Wiener increments of a block of paths side by side: each lane (path)
has its own streams of SFC64.

The streams, their order and the ziggurat are numpy's (`Generator(SFC64).standard_normal`), so that
the numbers are those of `sepv.simulate._wiener` to the bit. This file needs numba;
`sepv.simulate._compiled.store` loads it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numba.np.random._constants import fi_double, ki_double, wi_double, ziggurat_nor_inv_r, ziggurat_nor_r

from sepv.simulate._compiled.functions import (
    copy_row,
    draw,
    eight_normals,
    float_bits,
    for_simd,
    halve_rows,
    lowest_bit,
    mix,
    scale_row,
    select,
)
from sepv.simulate._compiled.signatures import BEGIN, FILL, NORMALS, OPTIONS, ZIGGURAT, address, call_normals
from sepv.simulate._wiener import MIXING, STREAMS

# The most levels that `fill` halves together, 64 steps: only the driver's pieces of single paths
# are so long.
FILLED_LEVELS = 6
# Inlined before types are inferred, so that numba compiles only the functions that are called by
# their address.
_inline: Any = njit(error_model="numpy", inline="always")
# The width and the limit of each layer of the ziggurat; the limits are integers below 2⁵².
_LAYERS = np.array([wi_double, ki_double], dtype=np.float64).T.copy()
_HEIGHT = np.array(fi_double, dtype=np.float64)
_R, _INVERSE_R = float(ziggurat_nor_r), float(ziggurat_nor_inv_r)
_MANTISSA = np.uint64(0x000FFFFFFFFFFFFF)
_UNIT = 1.0 / 9007199254740992.0


@_inline
def _uniform(rng: Any, s: int, k: int) -> float:
    return np.int64(draw(rng, s, k) >> np.uint64(11)) * _UNIT


@_inline
def _first(r: Any) -> Any:
    """The normal that the ziggurat makes of the 64 bits r,
    and True if it is accepted without further draws.
    """
    layer = r & np.uint64(0xFF)
    size = float((r >> np.uint64(9)) & _MANTISSA)
    x = size * _LAYERS[layer, 0]
    return select((r & np.uint64(0x100)) != 0, -x, x), size < _LAYERS[layer, 1]


@njit(ZIGGURAT, **OPTIONS)
def _ziggurat(rng: Any, s: int, k: int, r: Any) -> float:
    """Continue the ziggurat of lane k from the draw r of stream s until it accepts a standard
    normal.
    """
    while True:
        x, done = _first(r)
        if done:
            return x
        layer = np.int64(r & np.uint64(0xFF))
        if layer == 0:
            while True:
                xx = -_INVERSE_R * math.log1p(-_uniform(rng, s, k))
                yy = -math.log1p(-_uniform(rng, s, k))
                if yy + yy > xx * xx:
                    return -(_R + xx) if r & np.uint64(1 << 17) else _R + xx
        elif (_HEIGHT[layer - 1] - _HEIGHT[layer]) * _uniform(rng, s, k) + _HEIGHT[layer] < math.exp(
            -0.5 * x * x
        ):
            return x
        r = draw(rng, s, k)


@njit(NORMALS, **OPTIONS)
def normals(rng: Any, s: int, out: Any, first: int, apart: int, count: int) -> None:
    """Draw standard normals from stream s of rng (streams, 4, L), for each of L lanes (paths)
    and each noise.

    The normals fill the `count` rows first, first + apart, and so on of out (n, m, L).
    """
    for_simd()
    noises, lanes = out.shape[1], out.shape[2]
    if lanes == 1:
        for i in range(first, first + apart * count, apart):
            for j in range(noises):
                r = draw(rng, s, 0)
                x, done = _first(r)
                out[i, j, 0] = x if done else _ziggurat(rng, s, 0, r)
        return
    for i in range(first, first + apart * count, apart):
        for j in range(noises):
            for block in range(0, lanes, 64):
                # Bits mark the lanes that need more draws (one lane in 67). A branch for each lane
                # would cost more.
                bits = np.uint64(0)
                for k in range(block, block + 64, 8):
                    bits |= eight_normals(rng, s, k, _LAYERS, out, i, j) << np.uint64(k - block)
                while bits != 0:
                    lane = block + lowest_bit(bits)
                    bits &= bits - np.uint64(1)
                    out[i, j, lane] = _ziggurat(rng, s, lane, np.uint64(float_bits(out[i, j, lane])))


@njit(FILL, **OPTIONS)
def fill(
    drawing: int, out: Any, first: int, count: int, rng: Any, stack: Any, top: Any, factors: Any, above: int,
) -> None:  # fmt: skip
    """Write increments of the steps first … first + count − 1 of a block into out (count, m, L).

    drawing : the address of `normals` An increment is halved into two. `stack` (streams, m, L)
        keeps the right halves for later steps. `top` (n, m, L) has the coarse increments, which
        `above` earlier halvings have made; if n = 0, they are drawn here.
    """
    for_simd()
    fine = select(rng.shape[0] == 0, 0, rng.shape[0] - 1)  # without noise there are no streams
    width = out.shape[1] * out.shape[2]
    below = select(fine < FILLED_LEVELS, fine, FILLED_LEVELS)
    if top.shape[0] == 0 and width > 0:
        begun = -first & ((1 << fine) - 1)
        call_normals(drawing, (rng, 0, out, begun, 1 << fine, ((count - begun - 1) >> fine) + 1))
    i = drawn = 0
    while i < count:
        n = first + i
        level = fine
        while level > 0 and n & 1 == 0:
            level -= 1
            n >>= 1
        # n is now the number of an increment of this level; if n is odd, the increment is already
        # on the stack.
        if level > 0:
            copy_row(width, (stack, (level, 0, 0), out, (i, 0, 0)))
        elif top.shape[0]:
            copy_row(width, (top, (n, 0, 0), out, (i, 0, 0)))
        else:
            scale_row(width, (out, (i, 0, 0), factors[0]))
        # The last levels are halved together if all their steps are written; all their normals are
        # drawn in one go.
        together = below if level <= fine - below and i + (1 << below) <= count else 0
        groups = (count - i) >> below if together > 0 and i >= drawn else 0
        drawn = select(groups > 0, i + (groups << below), drawn)
        for deeper in range(level + 1, fine + 1 - together):
            call_normals(drawing, (rng, deeper, stack, deeper, 1, 1))
            halve_rows(width, (out, (i, 0, 0), stack, (deeper, 0, 0), factors[above + deeper]))
        for deeper in range(fine + 1 - together, fine + 1):
            apart = 1 << (fine - deeper)
            if groups > 0:
                call_normals(
                    drawing, (rng, deeper, out, i + apart, 2 * apart, (groups << below) // (2 * apart))
                )
            for left in range(i, i + (1 << together), 2 * apart):
                halve_rows(width, (out, (left, 0, 0), out, (left + apart, 0, 0), factors[above + deeper]))
        i += 1 << together


@njit(BEGIN, **OPTIONS)
def begin(
    drawing: int, rng: Any, top: Any, words: Any, path: int, factors: Any, base: int, halvings: int
) -> None:
    """Set up the streams rng (streams, 4, L) and the coarse increments of a block of L paths,
    numbered from `path` on.

    The coarse increments are top (n, m, L), n = base·2^halvings or 0: `base` increments, halved
    `halvings` times.

    drawing : the address of `normals`
    words : (streams, 3), the state words of the streams of path 0
        (`sepv.simulate._wiener.stream_words`)
    """
    for_simd()
    for s in range(rng.shape[0]):
        for k in range(rng.shape[2]):
            rng[s, 0, k], rng[s, 1, k], rng[s, 3, k] = words[s, 0], words[s, 1], np.uint64(1)
            rng[s, 2, k] = words[s, 2] + np.uint64(path + k) * np.uint64(STREAMS)
        mix(rng, s, MIXING)
    if top.shape[0] == 0:
        return
    width, apart = top.shape[1] * top.shape[2], 1 << halvings
    call_normals(drawing, (rng, 0, top, 0, apart, base))
    for i in range(0, top.shape[0], apart):
        scale_row(width, (top, (i, 0, 0), factors[0]))
    for level in range(1, halvings + 1):
        # The normals of a level are drawn in the order of time.
        call_normals(drawing, (rng, 0, top, apart // 2, apart, base << (level - 1)))
        for i in range(0, top.shape[0], apart):
            halve_rows(width, (top, (i, 0, 0), top, (i + apart // 2, 0, 0), factors[level]))
        apart //= 2


BEGIN_ADDRESS, FILL_ADDRESS, NORMALS_ADDRESS = address(begin), address(fill), address(normals)
