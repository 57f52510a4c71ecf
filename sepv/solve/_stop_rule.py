"""When Newton's iteration ends: one rule, written over numbers and over arrays of lanes alike.

`size` is a correction as a share of each component, the largest; `move` its largest component, `scale` that of the
state. Where |y| is 10⁸ and one component is 1, the correction is small when it is so for both.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sepv.record._binary64 import EPS, TINY

# A residual of a few of the smallest numbers there are is none.
QUANTA = 4 * float(np.finfo(np.float64).smallest_subnormal)
# Corrections that stop shrinking are rounding, not divergence, only when they are small: √eps.
STAGNATION = float(np.sqrt(EPS))
# … and when the residual is rounding too: a few hundred operations stand behind R, each rounded at the scale of y.
# Without this, corrections that shrink slowly (Newton's matrix is approximate for some H) pass for stagnation.
ROUNDING = 256 * EPS
# After a correction of so small a share of every component the matrix serves once more: the next one leaves the cube of
# that share, below a rounding.
REUSE = 2.0**-18
# … where corrections shrink by this or faster: else Newton's matrix changes along the way, or is a poor one.
SHRINKING = 2.0**-4


def relative(moves: Any, magnitude: Any, scale: Any) -> Any:
    """A correction beside components of this magnitude; one far below `scale` counts as a rounding of that."""
    return moves / (magnitude + EPS * scale + TINY)


def is_small(size: Any) -> Any:
    """Whether the correction is below half an ulp of every component."""
    return size <= 0.5 * EPS


def is_stuck(size: Any, move: Any, scale: Any, last_size: Any, last_move: Any) -> Any:
    """Whether a small correction is no longer much smaller than the last one.

    Both measures must have stopped shrinking: a component near zero moves by a large share of itself long before the
    others have arrived.
    """
    return (move <= STAGNATION * scale) & (size >= 0.5 * last_size) & (move >= 0.5 * last_move)


def is_rounding(residual: Any, scale: Any) -> Any:
    """Whether a residual is rounding at the scale of y."""
    return residual <= ROUNDING * scale + QUANTA


def may_reuse_matrix(size: Any, last_size: Any) -> Any:
    """Whether Newton's matrix may be taken once more."""
    return (size <= REUSE) & (size <= SHRINKING * last_size)
