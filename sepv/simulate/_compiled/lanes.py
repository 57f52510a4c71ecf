"""The normals and the increments of a block of paths side by side: one stream of SFC64 a lane.

The streams, their order and the ziggurat are numpy's (`Generator(SFC64).standard_normal`), so that the
numbers are those of `sepv.simulate._wiener` to the bit. Imported by generated code alone: this module needs numba.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numba.np.random._constants import fi_double, ki_double, wi_double, ziggurat_nor_inv_r, ziggurat_nor_r

from sepv.simulate._compiled.functions import lowest_bit, marked, prefer_512_bit, select
from sepv.simulate._compiled.signatures import BEGIN, COARSE, DRAW, FILL, MIX, ZIGGURAT
from sepv.simulate._wiener import MIXING, STREAMS

# The number of levels that `fill` halves together, 64 steps: only the driver's pieces of single paths are so long.
TOGETHER = 6
_OPTIONS: Any = {"error_model": "numpy", "nogil": True, "cache": True}
# Inlined: a call counts the references of its arrays, which takes longer than the work for one lane.
_inline: Any = njit(error_model="numpy", forceinline=True, cache=True)
_WIDTH = np.array(wi_double, dtype=np.float64)
_LIMIT = np.array(ki_double, dtype=np.int64)
_HEIGHT = np.array(fi_double, dtype=np.float64)
_R, _INVERSE_R = float(ziggurat_nor_r), float(ziggurat_nor_inv_r)
_MANTISSA = np.int64(0x000FFFFFFFFFFFFF)
_UNIT = 1.0 / 9007199254740992.0


@_inline
def _after(a: Any, b: Any, c: Any, counter: Any) -> Any:
    """The next 64 bits of a stream in this state, and the following state."""
    out = a + b + counter
    turned = (c << np.uint64(24)) | (c >> np.uint64(40))
    return out, b ^ (b >> np.uint64(11)), c + (c << np.uint64(3)), turned + out, counter + np.uint64(1)


@_inline
def _next(rng: Any, s: int, k: int) -> Any:
    """The next 64 bits of stream s of lane k."""
    out, a, b, c, counter = _after(rng[s, 0, k], rng[s, 1, k], rng[s, 2, k], rng[s, 3, k])
    rng[s, 0, k], rng[s, 1, k], rng[s, 2, k], rng[s, 3, k] = a, b, c, counter
    return out


@njit(MIX, **_OPTIONS)
def mix(rng: Any, s: int) -> None:
    """Turn the seeds of a stream into its initial states by the first draws, which are not used."""
    prefer_512_bit()
    for k in range(rng.shape[2]):
        a, b, c, counter = rng[s, 0, k], rng[s, 1, k], rng[s, 2, k], rng[s, 3, k]
        for _ in range(MIXING):  # in registers
            _, a, b, c, counter = _after(a, b, c, counter)
        rng[s, 0, k], rng[s, 1, k], rng[s, 2, k], rng[s, 3, k] = a, b, c, counter


@_inline
def _uniform(rng: Any, s: int, k: int) -> float:
    return np.int64(_next(rng, s, k) >> np.uint64(11)) * _UNIT


@njit(ZIGGURAT, error_model="numpy", forceinline=True, cache=True)
def _ziggurat(rng: Any, s: int, k: int, r: Any) -> float:
    """Continue the ziggurat from the draw r."""
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


@njit(DRAW, **_OPTIONS)
def normals(rng: Any, s: int, out: Any, i: int, j: int, scratch: Any) -> None:
    """Draw a standard normal from stream s of rng (streams, 4, L) for each lane into out[i, j].

    scratch : the draws (L,), and a byte for each lane that the ziggurat has not finished, 0 in those beyond L
    Arrays are passed whole: a slice counts its references, which takes longer than a normal.
    """
    prefer_512_bit()
    raw, late = scratch
    lanes = out.shape[2]
    for k in range(lanes):
        r = raw[k] = _next(rng, s, k)
        layer = r & np.uint64(0xFF)
        rabs = np.int64(r >> np.uint64(9)) & _MANTISSA
        x = rabs * _WIDTH[layer]
        out[i, j, k] = select((r & np.uint64(0x100)) != 0, -x, x)
        late[k] = rabs >= _LIMIT[layer]
    # Bits tell which lanes need more: a branch for each lane would cost more than their work, one lane in a hundred.
    for first in range(0, late.shape[0], 64):
        bits = marked(late, first)
        while bits != 0:
            k = first + lowest_bit(bits)
            bits &= bits - np.uint64(1)
            out[i, j, k] = _ziggurat(rng, s, k, raw[k])


@njit(COARSE, **_OPTIONS)
def coarse(rng: Any, top: Any, factors: Any, base: int, halvings: int, halves: Any, scratch: Any) -> None:
    """Draw the coarse part of a block, top (n, m, L) with n = base·2^halvings, level by level in place.

    `halves` (n/2, m, L) is scratch space.
    """
    prefer_512_bit()
    noises, lanes = top.shape[1], top.shape[2]
    length = base
    for i in range(base):
        for j in range(noises):
            normals(rng, 0, top, i, j, scratch)
            for k in range(lanes):
                top[i, j, k] *= factors[0]
    for level in range(1, halvings + 1):
        # Normals of a level come in the order of time; its increments are spread from the end.
        for i in range(length):
            for j in range(noises):
                normals(rng, 0, halves, i, j, scratch)
        for i in range(length - 1, -1, -1):
            for j in range(noises):
                for k in range(lanes):
                    whole = top[i, j, k]
                    left = 0.5 * whole + factors[level] * halves[i, j, k]
                    top[2 * i, j, k] = left
                    top[2 * i + 1, j, k] = whole - left
        length *= 2


@njit(DRAW, error_model="numpy", forceinline=True, cache=True)
def _draw(rng: Any, s: int, out: Any, i: int, j: int, scratch: Any) -> None:
    """Draw a normal from stream s for each lane into out[i, j]."""
    if out.shape[2] == 1:  # inlined: a call that passes three arrays counts their references
        out[i, j, 0] = _ziggurat(rng, s, 0, _next(rng, s, 0))
    else:
        normals(rng, s, out, i, j, scratch)


@njit(FILL, **_OPTIONS)
def fill(  # noqa: PLR0912 - in one piece, since calls that pass several arrays count references
    out: Any, first: int, count: int, rng: Any, stack: Any, top: Any, factors: Any, above: int, scratch: Any
) -> None:
    """Write increments of the steps first … first + count − 1 of a block into out (count, m, L).

    stack (streams, m, L) keeps the right halves for later; top (n, m, L) is the coarse part, n = 0 where it is drawn
    here; `above` is the number of its halvings.
    """
    prefer_512_bit()
    fine = max(rng.shape[0] - 1, 0)  # without noise there are no streams
    noises, lanes = out.shape[1], out.shape[2]
    below = min(fine, TOGETHER)
    i = 0
    while i < count:
        n = first + i
        level = fine
        while level > 0 and n & 1 == 0:
            level -= 1
            n >>= 1
        # n is now the number of the increment of that level; an odd one waits on the stack.
        for j in range(noises):
            if level > 0:
                for k in range(lanes):
                    out[i, j, k] = stack[level, j, k]
            elif top.shape[0]:
                for k in range(lanes):
                    out[i, j, k] = top[n, j, k]
            else:
                _draw(rng, 0, out, i, j, scratch)
                for k in range(lanes):
                    out[i, j, k] *= factors[0]
        # The last levels are halved together where all their steps are asked for.
        together = below if level <= fine - below and i + (1 << below) <= count else 0
        for deeper in range(level + 1, fine + 1 - together):
            for j in range(noises):
                _draw(rng, deeper, stack, deeper, j, scratch)
                for k in range(lanes):
                    whole = out[i, j, k]
                    left = 0.5 * whole + factors[above + deeper] * stack[deeper, j, k]
                    out[i, j, k] = left
                    stack[deeper, j, k] = whole - left
        for deeper in range(fine + 1 - together, fine + 1):
            apart = 1 << (fine - deeper)
            for left_half in range(i, i + (1 << together), 2 * apart):
                for j in range(noises):
                    _draw(rng, deeper, out, left_half + apart, j, scratch)
                    for k in range(lanes):
                        whole = out[left_half, j, k]
                        left = 0.5 * whole + factors[above + deeper] * out[left_half + apart, j, k]
                        out[left_half, j, k] = left
                        out[left_half + apart, j, k] = whole - left
        i += 1 << together


@njit(BEGIN, **_OPTIONS)
def begin(
    rng: Any,
    top: Any,
    words: Any,
    path: int,
    factors: Any,
    base: int,
    halvings: int,
    halves: Any,
    scratch: Any,
) -> None:
    """Set up the streams of a block, rng (streams, 4, L), of paths `path` and on, and its coarse increments `top`.

    words (streams, 3) starts the streams (`sepv.simulate._wiener.stream_words`); `halves` is that of `coarse`, and
    `scratch` that of `normals`.
    """
    for s in range(rng.shape[0]):
        for k in range(rng.shape[2]):
            rng[s, 0, k], rng[s, 1, k] = words[s, 0], words[s, 1]
            rng[s, 2, k] = words[s, 2] + np.uint64(path + k) * np.uint64(STREAMS)
            rng[s, 3, k] = np.uint64(1)
        mix(rng, s)
    if top.shape[0] > 0:
        coarse(rng, top, factors, base, halvings, halves, scratch)
