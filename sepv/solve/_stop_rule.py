"""The stop rule of Newton's iteration for z = R(z), written for numbers and for arrays of lanes alike.

A correction is measured twice. `move` is its largest component, to be compared with `scale`, that of the state. `size`
is the largest share of a component by which that component moves. It must be small in both measures, because one
component may be 1 where |y| is 10⁸. Names with `last_` belong to the correction before.

The last correction is applied as well, here and in the compiled engine. Where Newton's matrix differs from the slope of
R by a rounding, a correction below half an ulp can have one sign in every step. Left out, it would act as a force.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sepv.record import EPS, TINY

# The largest residual that counts as zero: a few of the smallest positive numbers.
QUANTA = 4 * float(np.finfo(np.float64).smallest_subnormal)
# The largest correction, relative to the state, whose failure to shrink is rounding and not divergence: √eps.
STAGNATION = float(np.sqrt(EPS))
# The largest residual, relative to the state, that is rounding: R has a few hundred operations, each rounded at the
# scale of y. Without this, corrections that shrink slowly (Newton's matrix is approximate for some H) pass for
# stagnation.
ROUNDING = 256 * EPS
# The largest error that a correction may leave, relative to the state: 2⁻¹⁰ of a rounding.
LEFT = 2.0**-62
# The largest `size` of a correction after which Newton's matrix is used once more: the next correction leaves the cube
# of that share, below a rounding. The corrections must shrink by the factor SHRINKING or faster. Otherwise the matrix
# changes along the way, or is a poor one.
REUSE, SHRINKING = 2.0**-18, 2.0**-4


def relative(moves: Any, magnitude: Any, scale: Any) -> Any:
    """The share of a component by which a correction moves it, `moves` over its magnitude.

    A magnitude below a rounding of `scale` counts as that rounding.
    """
    return moves / (magnitude + EPS * scale + TINY)


def is_last(size: Any, last_size: Any, residual: Any, scale: Any) -> Any:
    """True where a correction is the last one: nothing but rounding is left once it is applied.

    That is so for a correction below half an ulp of every component. A larger one is followed by one of at most
    size²/last_size, because corrections shrink at least as fast as before (E. Hairer, G. Wanner, Solving Ordinary
    Differential Equations II, 1996, IV.8). That must be far below a rounding, and the residual below one.
    """
    shrinks = (last_size < np.inf) & (size * size <= LEFT * last_size)
    return (size <= 0.5 * EPS) | shrinks & (residual <= EPS * scale)


def is_stuck(size: Any, move: Any, scale: Any, last_size: Any, last_move: Any) -> Any:
    """True where corrections stagnate: a small one is no longer much smaller than the one before, in both measures.

    Both must have stopped shrinking, because a component near zero moves by a large share of itself long before the
    others have arrived.
    """
    return (move <= STAGNATION * scale) & (size >= 0.5 * last_size) & (move >= 0.5 * last_move)


def is_rounding(residual: Any, scale: Any) -> Any:
    """True where the residual z − R(z) is no larger than the rounding of R at the scale of the state."""
    return residual <= ROUNDING * scale + QUANTA


def may_reuse_matrix(size: Any, last_size: Any) -> Any:
    """True where Newton's matrix may be used once more: the correction is small, and much smaller than the last one."""
    return (size <= REUSE) & (size <= SHRINKING * last_size)
