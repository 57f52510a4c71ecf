"""The stop rule of Newton's iteration for z = R(z), written for numbers and for arrays of lanes alike.

A correction is measured twice. `move` is its largest component, to be compared with `scale`, the largest component of
the state. `size` is the largest relative change of a component. A correction must be small in both measures, because
one component may be 1 while |y| is 10⁸. Names with `last_` belong to the previous correction.

The final correction is applied too, here and in the compiled engine. If Newton's matrix differs from ∂R/∂z by a
rounding, corrections below half an ulp can have the same sign in every step. To leave them out would act as a force: on
the oscillator the energy would drift by a tenth of a rounding a step.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sepv.record import EPS, TINY

# The largest residual that counts as zero: a few of the smallest positive numbers.
QUANTA = 4 * float(np.finfo(np.float64).smallest_subnormal)
# Corrections that stop shrinking mean rounding, not divergence, if they are at most √eps relative to the state.
STAGNATION = float(np.sqrt(EPS))
# The largest residual, relative to the state, that counts as rounding: R has a few hundred operations, each rounded at
# the scale of y. Without this bound, corrections that shrink slowly, because Newton's matrix is approximate for some H,
# would count as stagnation.
ROUNDING = 256 * EPS
# The largest error after a correction, relative to the state, with which the iteration may stop: 2⁻¹⁰ of a rounding.
LEFT = 2.0**-62
# The largest `size` of a correction after which Newton's matrix is used once more: the error after the next correction
# is of the order of size³, below a rounding. The corrections must also shrink by the factor SHRINKING or faster.
# Otherwise the matrix changes during the iteration, or is inexact.
REUSE, SHRINKING = 2.0**-18, 2.0**-4


def relative(moves: Any, magnitude: Any, scale: Any) -> Any:
    """The relative change of components by a correction: `moves`, the absolute corrections, over `magnitude`.

    A magnitude below a rounding of `scale` counts as a rounding of `scale`.
    """
    return moves / (magnitude + EPS * scale + TINY)


def is_last(size: Any, last_size: Any, residual: Any, scale: Any) -> Any:
    """True where a correction is the final one, because after it the error is only rounding.

    This holds for a correction below half an ulp of every component. After a larger correction the next is at most
    size²/last_size, because corrections shrink at least as fast as before (E. Hairer, G. Wanner, Solving Ordinary
    Differential Equations II, 1996, IV.8). This bound must be far below a rounding, and the residual below a rounding.
    """
    shrinks = (last_size < np.inf) & (size * size <= LEFT * last_size)
    return (size <= 0.5 * EPS) | shrinks & (residual <= EPS * scale)


def is_stuck(size: Any, move: Any, scale: Any, last_size: Any, last_move: Any) -> Any:
    """True where corrections stagnate: a small correction is at least half of the one before, in both measures.

    Both measures must have stopped shrinking, because the relative change of a component near zero may stay large long
    before the other components have converged.
    """
    return (move <= STAGNATION * scale) & (size >= 0.5 * last_size) & (move >= 0.5 * last_move)


def is_rounding(residual: Any, scale: Any) -> Any:
    """True where the residual |z − R(z)| is no larger than the rounding of R at the scale of the state."""
    return residual <= ROUNDING * scale + QUANTA


def may_reuse_matrix(size: Any, last_size: Any) -> Any:
    """True where Newton's matrix may be used once more: the correction is small, and far smaller than that before."""
    return (size <= REUSE) & (size <= SHRINKING * last_size)
