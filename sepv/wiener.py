"""Wiener increments: truncation (Remark 2.1), and one path refined consistently over step sizes.

Streams are keyed by `SeedSequence(seed, spawn_key=(block,))` for blocks of 64 paths, and a block is
always drawn whole: path number p is the same numbers whatever else is asked for with it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from sepv.errors import UsageError
from sepv.problem import Array

# One SeedSequence costs about 15 µs, as much as 2000 normals: a block shares it.
BLOCK = 64


def truncation_bound(h: float, k: int) -> float:
    """A_h = √(2k|ln h|) of Remark 2.1, for 0 < h < 1.

    Raises
    ------
    UsageError
        For h ≥ 1, where |ln h| no longer measures how small h is (at h = 1 it would set every increment
        to zero): Remark 2.1 is about h < 1, and no other rule is silently put in its place.
    """
    if not 0 < h < 1:
        raise UsageError(
            expected="0 < h < 1 for truncated increments (Remark 2.1)",
            received=f"h = {h!r}",
            remedy="a smaller step, or untruncated increments (truncation=None)",
        )
    return math.sqrt(2 * k * abs(math.log(h)))


def truncate(dW: ArrayLike, h: float, k: int | None = 2) -> Array:
    """ΔŴ = √h clip(ΔW/√h, ±A_h) for increments over the step h; unchanged for k = None.

    Parameters
    ----------
    dW : array_like of any shape
        Wiener increments of variance h.
    k : int, optional
        As in A_h; 2 in the paper. E[(ΔW − ΔŴ)²] ≤ h^(k+1)(1 + 2√(2k|ln h|)).
    """
    increments = np.asarray(dW, dtype=np.float64)
    if k is None:
        return increments
    if k != int(k) or k < 1:
        raise UsageError(
            expected="truncation k, an integer ≥ 1, or None", received=repr(k), remedy="the paper takes k = 2"
        )
    bound = truncation_bound(h, k) * math.sqrt(h)
    return np.clip(increments, -bound, bound)


def increments(
    seed: int, *, T: float, steps: int, noises: int, paths: int | range = 1, refine: int | None = None
) -> Array:
    """Wiener increments of `paths` paths over `steps` equal steps of [0, T].

    Parameters
    ----------
    seed : int ≥ 0
    paths : int or range
        How many paths, or which ones by number.
    refine : int, optional
        How many halvings of a coarser grid the grid is made of (Lévy's construction); by default as
        many as `steps` allows. Step counts n·2^l with the same odd n show the same paths: a coarse
        increment is the sum of its fine ones, to rounding.

    Returns
    -------
    (steps, m, M) array of ΔW ~ N(0, T/steps), untruncated; `truncate` is for the scheme's side.

    Examples
    --------
    >>> fine = increments(7, T=1.0, steps=8, noises=1, paths=3)
    >>> coarse = increments(7, T=1.0, steps=4, noises=1, paths=3)
    >>> bool(np.allclose(coarse, fine[0::2] + fine[1::2], rtol=0, atol=1e-15))
    True
    """
    wanted = range(paths) if isinstance(paths, int) else paths
    _validate(seed, T, steps, noises, wanted)
    halvings = (steps & -steps).bit_length() - 1
    if refine is not None:
        if not 0 <= refine <= halvings:
            raise UsageError(
                expected=f"refine between 0 and {halvings} for {steps} steps",
                received=repr(refine),
                remedy=f"take a step count divisible by 2^{refine}",
            )
        halvings = refine
    chosen = np.asarray(wanted, dtype=np.int64)
    result = np.empty((steps, noises, chosen.size))
    blocks = chosen // BLOCK
    for block in np.unique(blocks):
        here = np.flatnonzero(blocks == block)
        result[:, :, here] = _block(seed, int(block), T, steps, noises, halvings)[:, :, chosen[here] % BLOCK]
    return result


def _block(seed: int, block: int, T: float, steps: int, noises: int, halvings: int) -> Array:
    """One block of paths, level by level: finer levels go on in the stream and leave the coarse as it is."""
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(block,))))
    count = steps >> halvings
    h = T / count
    dW = math.sqrt(h) * rng.standard_normal((count, noises, BLOCK))
    for _ in range(halvings):
        # Given ΔW over h, the increment over its first half is ΔW/2 + (√h/2) N(0, 1).
        left = 0.5 * dW + 0.5 * math.sqrt(h) * rng.standard_normal(dW.shape)
        dW = np.stack([left, dW - left], axis=1).reshape(2 * dW.shape[0], noises, BLOCK)
        h *= 0.5
    return dW


def coarsen(dW: Array, factor: int) -> Array:
    """The increments over steps `factor` times as long: sums of `factor` consecutive ones along axis 0."""
    if dW.shape[0] % factor:
        raise UsageError(
            expected=f"a number of steps divisible by {factor}",
            received=f"{dW.shape[0]} steps",
            remedy="coarsen by a divisor of the number of steps",
        )
    return np.asarray(dW).reshape(dW.shape[0] // factor, factor, *dW.shape[1:]).sum(axis=1)


def _validate(seed: int, T: float, steps: int, noises: int, paths: range) -> None:
    checks = (
        (isinstance(seed, (int, np.integer)) and seed >= 0, "seed, an integer ≥ 0", seed),
        (np.ndim(T) == 0 and np.isfinite(T) and T > 0, "T, a finite time > 0", T),
        (isinstance(steps, (int, np.integer)) and steps >= 1, "steps, an integer ≥ 1", steps),
        (isinstance(noises, (int, np.integer)) and noises >= 0, "noises, an integer ≥ 0", noises),
        (len(paths) >= 1 and min(paths) >= 0, "paths, at least one and numbered from 0", paths),
    )
    for ok, expected, received in checks:
        if not ok:
            raise UsageError(expected=expected, received=repr(received), remedy=f"give {expected}")
