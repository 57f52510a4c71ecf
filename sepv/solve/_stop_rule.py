"""The stop rule of Newton's iteration, written for numbers and for arrays of lanes alike.

The last correction is applied as well, here and in the compiled engine. Where Newton's matrix differs from the slope of
R by a rounding, a correction below half an ulp can have one sign in every step: left out, it acts as a force.

`size` is the largest share of a component that a correction moves; `move` is its largest component, `scale` that of the
state. Where |y| is 10⁸ and one component is 1, a correction must be small in both measures.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sepv.record import EPS, TINY

# Residuals of a few of the smallest positive numbers count as zero.
QUANTA = 4 * float(np.finfo(np.float64).smallest_subnormal)
# The largest correction, relative to the state, whose failure to shrink is rounding and not divergence: √eps.
STAGNATION = float(np.sqrt(EPS))
# The largest residual, relative to the state, that is rounding: R has a few hundred operations, each rounded at the
# scale of y. Without this, corrections that shrink slowly (Newton's matrix is approximate for some H) pass for
# stagnation.
ROUNDING = 256 * EPS
# The largest error that a correction may leave, relative to the state: 2⁻¹⁰ of a rounding.
LEFT = 2.0**-62
# After a correction by so small a share of every component the matrix is used once more: the next correction leaves the
# cube of that share, below a rounding.
REUSE = 2.0**-18
# … if corrections shrink by this factor or faster: else Newton's matrix changes along the way, or is a poor one.
SHRINKING = 2.0**-4


def relative(moves: Any, magnitude: Any, scale: Any) -> Any:
    """A correction beside components of this magnitude; one far below `scale` counts as a rounding of that."""
    return moves / (magnitude + EPS * scale + TINY)


def is_last(size: Any, last_size: Any, residual: Any, scale: Any) -> Any:
    """True where nothing but rounding is left once the correction is applied.

    That is so for a correction below half an ulp of every component. Larger ones are followed by one of at most
    size²/last_size, because corrections shrink at least as fast as they did (E. Hairer, G. Wanner, Solving Ordinary
    Differential Equations II, 1996, IV.8): that must be far below a rounding, and the residual below one.
    """
    shrinks = (last_size < np.inf) & (size * size <= LEFT * last_size)
    return (size <= 0.5 * EPS) | shrinks & (residual <= EPS * scale)


def is_stuck(size: Any, move: Any, scale: Any, last_size: Any, last_move: Any) -> Any:
    """True where a small correction is no longer much smaller than the last one.

    Both measures must have stopped shrinking: a component near zero moves by a large share of itself long before the
    others have arrived.
    """
    return (move <= STAGNATION * scale) & (size >= 0.5 * last_size) & (move >= 0.5 * last_move)


def is_rounding(residual: Any, scale: Any) -> Any:
    """True where a residual is rounding at the scale of y."""
    return residual <= ROUNDING * scale + QUANTA


def may_reuse_matrix(size: Any, last_size: Any) -> Any:
    """True where Newton's matrix may be used once more."""
    return (size <= REUSE) & (size <= SHRINKING * last_size)
