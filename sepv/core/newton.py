"""Newton's iteration for z = R(z) of a batch, until corrections stagnate: one loop.

A solver that stops at a tolerance leaves a residual that acts as a force: with a tolerance of 1e-12
the energy drifts linearly. After iteration to stagnation the energy makes only a random walk of
roundings. Each lane (a path of a batch) ends by itself and has its own status, so that convergence
is reported and never assumed.

The loop knows nothing of R but one call, `advance(z, lanes) -> F, correction, flags`: the residual
F = z − R(z), Newton's correction (1 − ∂R/∂z)⁻¹F and three flags. It is written once for arrays,
(n, M), and for Python's numbers, which are several times faster for a single lane. `Arrays` and
`Numbers` have the operations that differ.

**The stop rule.** A correction is measured twice. `move` is its largest component, to be compared
with `scale`, the largest component of the state. `size` is the largest relative change of a
component. A correction must be small in both measures, because one component may be 1 while |y| is
10⁸. Names with `last_` belong to the previous correction. The final correction is applied too, here
and in the compiled engine. If Newton's matrix differs from ∂R/∂z by a rounding, corrections below
half an ulp can have the same sign in every step. To leave them out would act as a force: on the
oscillator the energy would drift by a tenth of a rounding a step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntEnum
from typing import Any, NamedTuple, Self

import numpy as np

from sepv.core.arrays import EPS, TINY, Array, Counts, Flags, Lanes

# The most iterations. Newton's method needs 3 to 5 for usual steps, and more after a damped start.
NEWTON_MAXITER = 40
# The most halvings of a correction that leaves the domain, and how many are tested in one call.
MAX_HALVINGS, HALVINGS_TOGETHER = 40, 8
# The most unknowns of a single lane for which Python's numbers are faster than arrays.
NUMBERS_MOST = 64
# The largest residual that counts as zero: a few of the smallest positive numbers.
ZERO_RESIDUAL = 4 * float(np.finfo(np.float64).smallest_subnormal)
# Corrections of at most √eps of the state that stop shrinking mean rounding, not divergence.
STAGNATION = float(np.sqrt(EPS))
# The largest residual, relative to the state, that counts as rounding: R has a few hundred
# operations, each rounded at the scale of y. Without this bound, corrections that shrink slowly,
# because Newton's matrix is approximate for some H, would count as stagnation.
RESIDUAL_ROUNDING = 256 * EPS
# The largest relative error with which the iteration may stop: 2⁻¹⁰ of a rounding.
STOP_ERROR = 2.0**-62


class Worded(IntEnum):
    """An integer constant with a `text` for messages; arrays hold the integers."""

    text: str

    def __new__(cls, value: int, text: str = "") -> Self:
        member = int.__new__(cls, value)
        member._value_, member.text = value, text
        return member


class Status(Worded):
    """The outcome of solving the equation of a step, for each lane (a path of a batch)."""

    CONVERGED = 0, "converged"
    NO_CONVERGENCE = 1, "no convergence"
    LEFT_DOMAIN = 2, "left the domain of the problem"
    OVERFLOW = 3, "overflow or NaN in B or ∇H"
    SINGULAR = 4, "singular Jacobian"
    QUADRATURE = 5, "the adaptive quadrature of ∇H did not reach rounding"
    UNDEFINED = 6, "a structure is undefined: ∇H_0 vanishes or nearly so, and B∇H_j does not"


class Flagged(NamedTuple):
    """The flags that `advance` returns for each lane: True, False, or an array (M,) of these.

    `quadrature`: a quadrature in R did not reach rounding. `singular`: the correction is not
    finite, although ∂R/∂z is. `left`: z minus the correction belongs to a state outside the domain.
    """

    quadrature: Any = False
    singular: Any = False
    left: Any = False


# The status of a lane while it goes on.
GOES_ON: Any = Status.NO_CONVERGENCE
# (z, lanes) -> F, correction, flags, for the lanes with the numbers `lanes`. z, F and the
# correction are arrays (n, M), or for one lane sequences of n numbers.
Advance = Callable[[Any, Lanes], tuple[Any, Any, Flagged]]
Inside = Callable[[Array, Lanes], Flags]
Rounding = Callable[[Array, Lanes], Array]


class Root(NamedTuple):
    """For each lane: the last z (n, M), the residual |F| before it (M,), iterations, `Status`."""

    value: Array
    residual: Array
    iterations: Counts
    status: Counts


def newton(
    advance: Advance,
    size: Array,
    start: Array,
    lanes: Lanes,
    inside: Inside | None = None,
    rounding: Rounding | None = None,
    most: int = NEWTON_MAXITER,
) -> Root:
    """Newton's iteration for z = R(z) by full steps, shortened only to stay in the domain.

    Each lane is iterated until it has ended, with the same bits whatever the other lanes are. A
    lane with residual zero is solved even if its matrix is singular, as at a rest point.

    Parameters
    ----------
    advance : (z, lanes) -> F, correction, flags
    size : (n, M)
        The size |y_i| of the component to which each unknown is added. Corrections are relative to
        |y| + |z|.
    start : (n, M)
    lanes : (M,)
        The numbers of the M lanes, for the functions.
    inside : (z, lanes) -> (M,) of bool, optional
        True for each lane for which the states that belong to z lie in the domain of the problem. A
        correction that leaves the domain is then shortened; without this function the lane ends.
    rounding : (z, lanes) -> (M,), optional
        The largest residual that the rounding of R explains, if it can exceed that of the state.
    most : int
        The most iterations.
    """
    of: Any = Numbers if start.shape[1] == 1 and len(start) <= NUMBERS_MOST else Arrays
    count = start.shape[1]
    root = Root(
        start.copy(), np.full(count, np.inf), np.zeros(count, dtype=np.int64), np.ones(count, dtype=np.int64)
    )
    active, z, y = np.arange(count), of.state(start), of.state(size)
    last_change: Any = np.inf
    last_move: Any = np.inf
    with np.errstate(all="ignore"):
        for iteration in range(1, most + 1):
            F, correction, flags = advance(z, lanes)
            F, correction = of.state(F), of.state(correction)
            residual, scale, move, change = of.sizes(F, correction, y, z)
            ended = is_last(change, last_change, residual, scale) | is_stuck(
                change, move, scale, last_change, last_move
            )
            if of.any(ended):
                ended = ended & is_rounding(residual, scale, rounding, of.array(z), lanes, ended)
            # `^ True` is the negation of a flag and of an array of flags alike.
            solved, failed = residual <= ZERO_RESIDUAL, (move < np.inf) ^ True
            over, status = ended | solved | failed, GOES_ON
            moved = of.less(z, correction)
            if of.any(flags.left):
                moved, stays = shortened(inside, of.array(z), of.array(correction), lanes, flags.left)
                moved = of.state(moved)
                status = of.where(stays, GOES_ON, Status.LEFT_DOMAIN)
            if of.any(over):
                good = of.where(flags.quadrature, Status.QUADRATURE, Status.CONVERGED)
                bad = of.where(flags.singular & (residual < np.inf), Status.SINGULAR, Status.OVERFLOW)
                status = of.where(over, of.where(ended | solved, good, bad), status)
                moved = of.where(solved | failed, z, moved)
            z, last_change, last_move = moved, change, move
            if iteration == most or of.any(status != GOES_ON):
                at: Any = slice(None) if active.size == count else active
                root.value[:, at], root.residual[at] = of.array(z), residual
                root.iterations[at], root.status[at] = iteration, status
                if iteration == most or not of.any(status == GOES_ON):
                    break
                rest = np.flatnonzero(status == GOES_ON)
                active, lanes, z, y, last_change, last_move = (
                    v.take(rest, axis=-1) for v in (active, lanes, z, y, last_change, last_move)
                )
    return root


class Arrays:
    """The operations of `newton` for lanes in arrays: states (n, M), numbers and flags (M,)."""

    where = staticmethod(np.where)
    any = staticmethod(np.any)
    less = staticmethod(np.subtract)
    state = staticmethod(np.asarray)
    array = staticmethod(np.asarray)

    @staticmethod
    def sizes(F: Array, correction: Array, y: Array, z: Array) -> tuple[Array, Array, Array, Array]:
        """The residual |F|, the state's scale, a correction's largest component and size."""
        magnitude, moves = y + np.abs(z), np.abs(correction)
        scale = magnitude.max(axis=0)
        # A magnitude below a rounding of `scale` counts as a rounding of `scale`.
        size = (moves / (magnitude + (EPS * scale + TINY))).max(axis=0)
        return np.abs(F).max(axis=0), scale, moves.max(axis=0), size


class Numbers:
    """The operations of `newton` for one lane, a list of n numbers; the bits are `Arrays`'."""

    any = bool

    @staticmethod
    def where(condition: Any, a: Any, b: Any) -> Any:
        return a if condition else b

    @staticmethod
    def less(z: list[float], correction: list[float]) -> list[float]:
        return [a - b for a, b in zip(z, correction, strict=True)]

    @staticmethod
    def state(z: Any) -> list[float]:
        numbers: list[float] = z if isinstance(z, list) else np.ravel(z).tolist()
        return numbers

    @staticmethod
    def array(z: list[float]) -> Array:
        return np.array(z)[:, None]

    @staticmethod
    def sizes(
        F: list[float], correction: list[float], y: list[float], z: list[float]
    ) -> tuple[float, float, float, float]:
        magnitude = [a + abs(b) for a, b in zip(y, z, strict=True)]
        scale, move = max(magnitude), largest(correction)
        floor = EPS * scale + TINY
        size = max([abs(a) / (b + floor) for a, b in zip(correction, magnitude, strict=True)])
        return largest(F), scale, move, size if move < math.inf else move


def largest(values: list[float]) -> float:
    """The largest absolute value; NaN if there is a NaN, as in NumPy."""
    if math.isnan(sum(values)) and any(map(math.isnan, values)):
        return math.nan
    return max(map(abs, values))


def is_last(size: Any, last_size: Any, residual: Any, scale: Any) -> Any:
    """True where a correction is the final one, because after it the error is only rounding.

    This holds for a correction below half an ulp of every component. After a larger correction the
    next is at most size²/last_size, because corrections shrink at least as fast as before (E.
    Hairer, G. Wanner, Solving Ordinary Differential Equations II, 1996, IV.8). This bound must be
    far below a rounding, and the residual below a rounding.
    """
    shrinks = (last_size < np.inf) & (size * size <= STOP_ERROR * last_size)
    return (size <= 0.5 * EPS) | shrinks & (residual <= EPS * scale)


def is_stuck(size: Any, move: Any, scale: Any, last_size: Any, last_move: Any) -> Any:
    """True where a small correction is at least half of the one before, in both measures.

    Both measures must have stopped shrinking, because the relative change of a component near zero
    may stay large long before the other components have converged.
    """
    return (move <= STAGNATION * scale) & (size >= 0.5 * last_size) & (move >= 0.5 * last_move)


def is_rounding(
    residual: Any, scale: Any, rounding: Rounding | None, z: Array, lanes: Lanes, closely: Any
) -> Any:
    """True where the residual is rounding of y, or in lanes flagged in `closely` of R."""
    small = residual <= RESIDUAL_ROUNDING * scale + ZERO_RESIDUAL
    larger = np.flatnonzero(closely & (small ^ True))
    if rounding is not None and larger.size:
        small, residual = np.array(small, ndmin=1), np.atleast_1d(residual)
        small[larger] = residual[larger] <= rounding(z[:, larger], lanes[larger])
    return small


def shortened(
    inside: Inside | None, z: Array, correction: Array, lanes: Lanes, left: Any
) -> tuple[Array, Flags]:
    """z minus the correction, shortened if need be, and True for lanes that stay in the domain."""
    if inside is None:
        moved, stays = z - correction, np.logical_not(left)
    else:
        moved, stays = into_domain(inside, z, correction, lanes)
    return np.where(stays, moved, z), stays


def into_domain(inside: Inside | None, z: Array, correction: Array, lanes: Lanes) -> tuple[Array, Flags]:
    """z − λ·correction in the domain, with the largest λ = 2⁻ⁿ; True for lanes with a λ."""
    moved, stays = z - correction, np.ones(z.shape[1], dtype=bool)
    if inside is None or not z.shape[1]:
        return moved, stays
    stays = inside(moved, lanes)
    for first in range(1, MAX_HALVINGS + 1, HALVINGS_TOGETHER):
        outside = np.flatnonzero(~stays)
        if not outside.size:
            break
        # Several λ are tested at once: a domain takes as long for one state as for a few.
        factors = 0.5 ** np.arange(first, min(first + HALVINGS_TOGETHER, MAX_HALVINGS + 1))
        tried = z[:, outside, None] - factors * correction[:, outside, None]
        fits = inside(tried.reshape(len(z), -1), np.repeat(lanes[outside], factors.size))
        fits = fits.reshape(outside.size, factors.size)
        stays[outside] = fits.any(axis=1)
        longest = np.where(stays[outside], np.argmax(fits, axis=1), -1)
        moved[:, outside] = tried[:, np.arange(outside.size), longest]
    return moved, stays
