"""Wiener increments of numbered paths; the same path can be drawn with finer and with coarser
steps.

Every path has its own random streams, so path number p has the same increments in any run and
engine. Lévy's construction halves coarse increments again and again, level by level. The first
stream draws the coarse levels. Each finer level has its own stream, read in the order of time, so
that a path of any length can be drawn piece by piece. A stream is numpy's generator SFC64, whose
state is cheap to set: two words that `SeedSequence` makes from the seed, and one word with the
numbers of the path and the stream.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sepv.errors import UsageError
from sepv.problem import Array

# Levels of Lévy's construction with at most this many increments are drawn from the path's first
# stream.
TOP_INCREMENTS = 64
# Rounds of mixing after a stream's state is set. NumPy uses 12 for SFC64; SFC64's author uses 18
# for three words.
MIXING = 18
# The low six bits of a state word are the number of the stream: 64 streams, more than the levels of
# 2**58 steps.
STREAMS = 64


def increments(
    seed: int, *, T: float, steps: int, noises: int, paths: int | range = 1, refine: int | None = None
) -> Array:
    """Draw Wiener increments of `paths` paths over `steps` equal steps of [0, T].

    Parameters
    ----------
    seed : int ≥ 0
    paths : int or range
        How many paths (numbered from 0), or the range of their numbers.
    refine : int, optional
        How often a coarser grid is halved (Lévy's construction) to give the grid of `steps` steps;
        by default as often as `steps` allows. All step counts n·2^l with the same odd n then give
        the same paths: up to rounding, a coarse increment is the sum of its fine increments.

    Returns
    -------
    (steps, m, M) array of untruncated ΔW ~ N(0, T/steps); `truncate` bounds them for a scheme.

    Examples
    --------
    >>> fine = increments(7, T=1.0, steps=8, noises=1, paths=3)
    >>> coarse = increments(7, T=1.0, steps=4, noises=1, paths=3)
    >>> bool(np.allclose(coarse, fine[0::2] + fine[1::2], rtol=0, atol=1e-15))
    True
    """
    (whole,) = walk(seed, T=T, steps=steps, noises=noises, paths=paths, refine=refine, size=steps)
    return whole


class Grid(NamedTuple):
    """A grid of N = base·2^halvings steps; the path's first random stream draws the first `top`
    halvings.
    """

    base: int
    halvings: int
    top: int

    @property
    def streams(self) -> int:
        """The number of streams that a path needs."""
        return 1 + self.halvings - self.top


def grid(steps: int, refine: int | None = None) -> Grid:
    """The grid of `steps` steps with `refine` halvings;
    UsageError if `steps` is not divisible by 2^refine.
    """
    halvings = (steps & -steps).bit_length() - 1
    if refine is not None:
        if not 0 <= refine <= halvings:
            raise UsageError(
                expected=f"refine between 0 and {halvings} for {steps} steps",
                received=repr(refine),
                remedy=f"take a step count divisible by 2^{refine}",
            )
        halvings = refine
    base = steps >> halvings
    top = 0
    while top < halvings and base << (top + 1) <= TOP_INCREMENTS:
        top += 1
    return Grid(base, halvings, top)


@lru_cache(maxsize=64)
def spreads(T: float, grid: Grid) -> Array:
    """Standard deviations of the draws by level: √h₀ for level 0 (coarse steps h₀),
    then ½√h for halving steps h.
    """
    h = T / grid.base * 0.5 ** np.maximum(np.arange(grid.halvings + 1) - 1.0, 0.0)
    factors: Array = 0.5 * np.sqrt(h)
    factors[0] *= 2
    return factors


@lru_cache(maxsize=64)
def stream_words(seed: int, grid: Grid) -> NDArray[np.uint64]:
    """The three state words (streams, 3) of each SFC64 stream of path 0: two from the seed,
    and the stream's level.

    Stream 0 draws the coarse part of a path (level 0), and stream i > 0 draws level top + i. Path p
    adds 64p to word 3.
    """
    levels = np.concatenate([[0], np.arange(grid.top + 1, grid.halvings + 1)])
    words = np.random.SeedSequence(int(seed)).generate_state(2, np.uint64)
    return np.array([[*words, level] for level in levels.astype(np.uint64)])


def stream_states(seed: int, paths: ArrayLike, grid: Grid) -> NDArray[np.uint64]:
    """The initial SFC64 states (streams, 4, M) of M paths: three words and the counter 1,
    after MIXING draws.
    """
    a, b, level = stream_words(seed, grid).T[..., None]
    word = level + np.asarray(paths, dtype=np.uint64)[None] * np.uint64(STREAMS)
    state = [np.full_like(word, a), np.full_like(word, b), word, np.ones_like(word)]
    for _ in range(MIXING):
        out = state[0] + state[1] + state[3]
        state = [
            state[1] ^ (state[1] >> np.uint64(11)),
            state[2] + (state[2] << np.uint64(3)),
            ((state[2] << np.uint64(24)) | (state[2] >> np.uint64(40))) + out,
            state[3] + np.uint64(1),
        ]
    return np.stack(state, axis=1)


def walk(
    seed: int, *, T: float, steps: int, noises: int, paths: int | range, refine: int | None = None, size: int
) -> Iterator[Array]:
    """Yield the Wiener increments of M paths in the order of time, in pieces (k, m, M)
    of about `size` steps.

    The arguments are those of `increments`. A piece has at least the 2^(halvings − top) steps of a
    coarse increment.
    """
    wanted = range(paths) if isinstance(paths, int) else paths
    validate(seed, T, steps, noises, wanted)
    plan = grid(steps, refine)
    factors = spreads(T, plan)
    streams = _Streams(stream_states(seed, wanted, plan), noises)
    fine = plan.halvings - plan.top
    group = max(1, size >> fine)
    coarse = None
    if plan.base <= TOP_INCREMENTS:
        normals = streams.draw(0, plan.base << plan.top)
        coarse = factors[0] * normals[: plan.base]
        for level in range(1, plan.top + 1):
            coarse = _halve(coarse, factors[level] * normals[len(coarse) : 2 * len(coarse)])
    total = plan.base << plan.top
    for first in range(0, total, group):
        length = min(group, total - first)
        dW = factors[0] * streams.draw(0, length) if coarse is None else coarse[first : first + length]
        for i in range(1, fine + 1):
            dW = _halve(dW, factors[plan.top + i] * streams.draw(i, len(dW)))
        yield dW


def _halve(dW: Array, z: Array) -> Array:
    """Split increments ΔW over steps h into ΔW/2 + z and ΔW/2 − z over half steps,
    given z ~ N(0, h/4).
    """
    left = 0.5 * dW + z
    return np.stack([left, dW - left], axis=1).reshape(2 * dW.shape[0], *dW.shape[1:])


class _Streams:
    """The random streams of several paths; a draw from a stream continues at its last position."""

    def __init__(self, states: NDArray[np.uint64], noises: int) -> None:
        self.states, self.noises = states, noises
        self.bits = np.random.SFC64(0)
        self.generator = np.random.Generator(self.bits)
        self.record: Any = {"bit_generator": "SFC64", "state": {}, "has_uint32": 0, "uinteger": 0}

    def draw(self, stream: int, count: int) -> Array:
        """Draw standard normals (count, m, M)."""
        states = self.states[stream]
        normals = np.empty((states.shape[1], count, self.noises))
        if normals.size:
            for path, row in enumerate(normals):
                self.record["state"]["state"] = states[:, path]
                self.bits.state = self.record
                self.generator.standard_normal(out=row)
                states[:, path] = self.bits.state["state"]["state"]
        return np.ascontiguousarray(np.moveaxis(normals, 0, -1))


def coarsen(dW: Array, factor: int) -> Array:
    """The increments over steps `factor` times as long:
    sums of `factor` consecutive increments along axis 0.
    """
    if dW.shape[0] % factor:
        raise UsageError(
            expected=f"a number of steps divisible by {factor}",
            received=f"{dW.shape[0]} steps",
            remedy="coarsen by a divisor of the number of steps",
        )
    sums: Array = np.asarray(dW).reshape(dW.shape[0] // factor, factor, *dW.shape[1:]).sum(axis=1)
    return sums


def validate(seed: int, T: float, steps: int, noises: int, paths: range) -> None:
    """Raise UsageError for arguments with which no increments can be drawn."""
    checks = (
        (isinstance(seed, (int, np.integer)) and seed >= 0, "seed, an integer ≥ 0", seed),
        (np.ndim(T) == 0 and np.isfinite(T) and T > 0, "T, a finite time > 0", T),
        (isinstance(steps, (int, np.integer)) and steps >= 1, "steps, an integer ≥ 1", steps),
        (isinstance(noises, (int, np.integer)) and noises >= 0, "noises, an integer ≥ 0", noises),
        (len(paths) >= 1 and min(paths[0], paths[-1]) >= 0, "paths, at least one and numbered from 0", paths),
    )
    for ok, expected, received in checks:
        if not ok:
            raise UsageError(expected=expected, received=repr(received), remedy=f"give {expected}")
