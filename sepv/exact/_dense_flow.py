"""A solution of y′ = f(y) as a function of time, accurate to rounding at every time:
Gauss collocation in panels.

The time is divided into panels. On each panel the collocation polynomial is stored as a Legendre
series, whose last coefficients measure whether the panel is short enough. Each evaluation at a time
is one short sum. Continuous extensions of explicit Runge-Kutta pairs are less accurate between
their steps, by an order of magnitude.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from sepv.errors import SepvError
from sepv.problem import Array
from sepv.record import EPS, gauss_legendre, legendre_values

_MAX_PANELS = 50_000
_PICARD = 60


@dataclass(frozen=True)
class DenseSolution:
    """A solution of y′ = f(y) as a function of time: a Legendre series of f with s terms on each of
    P panels.

    The panels have edges (P+1,), states at their left ends (d, P), and Legendre coefficients of f
    (d, s, P).
    """

    edges: Array
    starts: Array
    coefficients: Array

    def __call__(self, t: Array) -> Array:
        """The states (d, M) at times t (M,) between edges[0] and edges[-1]."""
        panel = np.clip(np.searchsorted(self.edges, t, side="right") - 1, 0, self.edges.size - 2)
        width = self.edges[panel + 1] - self.edges[panel]
        x = 2 * (t - self.edges[panel]) / width - 1
        stages = self.coefficients.shape[1]
        P = legendre_values(x, stages + 1)
        total = np.zeros((self.starts.shape[0], t.size))
        for k in range(stages - 1, -1, -1):  # smallest terms first
            basis = P[k + 1] - P[k - 1] if k else P[1] + 1
            total += self.coefficients[:, k, panel] * (basis / (2 * (2 * k + 1)))
        return self.starts[:, panel] + width * total


class FlowFailure(SepvError, ArithmeticError):
    """The flow cannot be followed to the given time, because the solution leaves the domain or
    blows up.
    """


@lru_cache(maxsize=8)
def _tables(stages: int) -> tuple[Array, Array, Array]:
    """Three arrays for s Gauss nodes on [0, 1]: integrals of Lagrange polynomials, weights (s,),
    and a transform.

    The last array, the transform (s, s), maps values at the nodes to Legendre coefficients.
    """
    c, w = gauss_legendre(stages)
    P = np.stack(legendre_values(2 * c - 1, stages))
    to_series = (2 * np.arange(stages) + 1)[:, None] * P[:stages] * w
    integrals = np.stack([(P[k + 1] - (P[k - 1] if k else -1.0)) / (2 * (2 * k + 1)) for k in range(stages)])
    return integrals.T @ to_series, w, to_series


def solve_dense(
    f: Callable[[Array], Array], y0: Array, end: float, stages: int, shrink: float = 1.0
) -> DenseSolution:
    """The solution of y′ = f(y), y(0) = y0, on [0, end] or [end, 0].

    Parameters
    ----------
    f : (d, s) -> (d, s)
    stages : int
        The number s of Gauss nodes on a panel, one interval of time. A panel is halved until its
        Legendre series decays to rounding; if it decays faster, the next is longer. The first has
        the length shrink · min(½, ½(1 + |y|)/|f|).
    shrink : float
        A factor of the first panel's length. Two solutions with different factors have different
        panels.

    Raises
    ------
    FlowFailure
    """
    A, w, to_series = _tables(stages)
    sign = 1.0 if end >= 0 else -1.0
    t, y, low = 0.0, y0, np.zeros(len(y0))
    slope = float(np.max(np.abs(f(y[:, None])))) + EPS
    width = shrink * min(0.5, 0.5 * (1 + float(np.max(np.abs(y)))) / slope)
    edges, starts, series = [0.0], [], []
    while abs(t) < abs(end):
        H = sign * min(width, abs(end) - abs(t))
        F, decayed = _panel(f, y, H, A, to_series)
        if not decayed:
            width *= 0.5
            if width < 1e-13 * (1 + abs(t)) or len(edges) > _MAX_PANELS:
                raise FlowFailure(
                    f"The exact flow was followed to θ = {t!r} of {end!r} and no further: the solution "
                    "leaves the domain or blows up there. Remedy: a smaller θ or another initial state."
                )
            continue
        starts.append(y)
        series.append(F @ to_series.T)
        # With compensated summation, hundreds of panels have no more rounding than one.
        low = low + H * (F @ w)
        y, low = y + low, low - ((y + low) - y)
        t = end if abs(H) < width else t + H
        edges.append(t)
        width *= 1.2 if decayed > 1 else 1.0
        if len(starts) > _MAX_PANELS or edges[-1] == edges[-2]:
            raise FlowFailure(
                f"{len(starts)} panels led to θ = {t!r} of {end!r} and no further: the solution blows up there, or "
                "moves too fast to be followed. Remedy: a smaller θ or another initial state."
            )
    return _oriented(np.array(edges), np.stack(starts, axis=1), np.stack(series, axis=2), y, sign)


def _panel(f: Callable[[Array], Array], y: Array, H: float, A: Array, to_series: Array) -> tuple[Array, int]:
    """The values f(y) (d, s) at the nodes of a panel of length H from the state y,
    by Picard iteration, and a grade.

    The grade is 0 if the iteration failed or the panel is too long, 1 if the panel is short enough,
    and 2 if the next panel may be longer.
    """
    F = np.repeat(f(y[:, None]), len(A), axis=1)
    previous = np.inf
    with np.errstate(all="ignore"):
        for _ in range(_PICARD):
            new = f(y[:, None] + H * (F @ A.T))
            change = float(np.max(np.abs(new - F)))
            size = float(np.max(np.abs(new)))
            F = new
            if not np.isfinite(size):
                return F, 0
            if change <= 4 * EPS * size or (change >= previous and change <= 1e-12 * size):
                break
            previous = change
        else:
            return F, 0
    # Coefficient k of f contributes to y with the factor 1/(2(2k + 1)), from the integral of
    # Legendre's P_k.
    weights = 1 / (2 * (2 * np.arange(len(A))[-3:] + 1))
    tail = np.max(np.abs(F @ to_series[-3:].T) * weights) * abs(H)
    # The largest component on the panel, which is not zero if the flow starts at the origin and
    # leaves it.
    scale = max(float(np.max(np.abs(y))), abs(H) * size)
    if tail <= 1e-3 * EPS * scale:
        return F, 2
    return F, int(tail <= 4 * EPS * scale)


def _oriented(edges: Array, starts: Array, series: Array, end_state: Array, sign: float) -> DenseSolution:
    """The solution with panels in increasing time; panels computed towards negative times are
    reversed.
    """
    if sign > 0:
        return DenseSolution(edges, starts, series)
    lefts = np.concatenate([starts[:, 1:], end_state[:, None]], axis=1)
    parity = (-1.0) ** np.arange(series.shape[1])
    return DenseSolution(edges[::-1], lefts[:, ::-1], (series * parity[None, :, None])[:, :, ::-1])
