"""Newton's method to stagnation for one large state, with a banded or a sparse factorisation.

The rules of `sepv.implicit` for when it has arrived, for one lane; the linear algebra is LAPACK's band solver where
the band is narrow, SuperLU elsewhere. Both are linear in d for the neighbour couplings of a chain.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sepv.implicit import MAX_HALVINGS, MAX_ITERATIONS, ROUNDING, STAGNATION
from sepv.large.problem import LargeProblem, Sparse
from sepv.problem import Array
from sepv.solution import Status

_EPS = float(np.finfo(np.float64).eps)
_TINY = float(np.finfo(np.float64).tiny)
# A band solver touches 2l + u + 1 numbers a row, fill of pivoting included; wider than this, SuperLU is faster.
WIDEST_BAND = 64


@dataclass(frozen=True)
class LargeSolution:
    """y1 (d,) where converged, else the last iterate; largest residual, iterations and how it ended."""

    value: Array
    residual: float
    iterations: int
    status: Status


# (y0, y1) -> R(y0, y1) and, on demand, ∂R/∂y1
Equation = Callable[[Array, Array], tuple[Array, Callable[[], Sparse]]]


def solve(problem: LargeProblem, y0: Array, equation: Equation) -> LargeSolution:
    """Solve y1 = y0 + R(y0, y1); the unknown is y1 − y0, see `sepv.implicit.solve`."""
    delta = np.zeros_like(y0)
    residual, previous = np.inf, (np.inf, np.inf)
    with np.errstate(all="ignore"):
        for iteration in range(1, MAX_ITERATIONS + 1):
            R, slope = equation(y0, y0 + delta)
            F = delta - R
            residual = float(np.abs(F).max())
            if not np.isfinite(residual):
                return LargeSolution(y0 + delta, residual, iteration, Status.OVERFLOW)
            if residual == 0:
                return LargeSolution(y0 + delta, residual, iteration, Status.CONVERGED)
            correction = newton_correction(slope(), F)
            if correction is None or not np.all(np.isfinite(correction)):
                return LargeSolution(y0 + delta, residual, iteration, Status.SINGULAR)
            reach, moves = np.abs(y0) + np.abs(delta), np.abs(correction)
            scale, largest = float(reach.max()), float(moves.max())
            size = float((moves / (reach + _EPS * scale + _TINY)).max())
            small = largest <= STAGNATION * scale and residual <= ROUNDING * scale
            stuck = size >= 0.5 * previous[0] and largest >= 0.5 * previous[1]
            if size <= 0.5 * _EPS or (small and stuck):
                return LargeSolution(y0 + delta, residual, iteration, Status.CONVERGED)
            previous = size, largest
            moved = _into_domain(problem, y0, delta, correction)
            if moved is None:
                return LargeSolution(y0 + delta, residual, iteration, Status.LEFT_DOMAIN)
            delta = moved
    return LargeSolution(y0 + delta, residual, MAX_ITERATIONS, Status.NO_CONVERGENCE)


def newton_correction(K: Sparse, F: Array) -> Array | None:
    """(I − K)⁻¹F, or None where the matrix is singular."""
    entries = K.tocoo()
    lower = int(max((entries.row - entries.col).max(initial=0), 0))
    upper = int(max((entries.col - entries.row).max(initial=0), 0))
    d = F.size
    if 2 * lower + upper + 1 <= WIDEST_BAND:
        from scipy.linalg import LinAlgError, solve_banded

        # Row u + i − j of a band holds A_ij. Entries given twice add up.
        band = np.bincount(
            (upper + entries.row - entries.col) * d + entries.col,
            weights=entries.data,
            minlength=(lower + upper + 1) * d,
        ).reshape(lower + upper + 1, d)
        np.negative(band, out=band)
        band[upper] += 1
        try:
            return np.asarray(solve_banded((lower, upper), band, F, overwrite_ab=True, check_finite=False))
        except LinAlgError:
            return None
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import splu

    try:
        return np.asarray(splu((eye_array(d) - K).tocsc()).solve(F))
    except RuntimeError:  # how SuperLU says "exactly singular"
        return None


def _into_domain(problem: LargeProblem, y0: Array, delta: Array, correction: Array) -> Array | None:
    """delta − λ·correction with the largest λ = 2⁻ⁿ that stays in the domain; None where there is none."""
    for halvings in range(MAX_HALVINGS):
        moved = delta - 0.5**halvings * correction
        if problem.domain is None or problem.domain(y0 + moved):
            return moved
    return None
