"""The check of the law "poisson-map" and of its conformal kind: Φ′(y0) B(y0) Φ′(y0)ᵀ = B(y1),
with a derived bound.

Φ is one step y0 → y1, with the step size h and the increments ΔW held fixed.
`sepv.problem._poisson` computes Φ′ by central differences, with a bound E of the error of each
entry. A Poisson map's computed defect is at most the sum of

    E|B||Φ′|ᵀ + |Φ′||B|Eᵀ + E|B|Eᵀ,
    |B(y1 + e) − B(y1)| for the error e of y1, and roundings of the products.

Cauchy's estimate gives E from a disc |ζ| ≤ ρ of complex ζ in which |Φ(y0 + ζe_j) − (y0 + ζe_j)|
≤ M. If the problem is polynomial data and |Δ| is at most half the contraction radius, then ρ = M
= r/2 with the radius r of the ball of `sepv.law.contraction.contraction_ball`: states within r/2 of
y0 move by at most r/2 and stay in the ball. For other problems the truncation error of Φ′ is
estimated by the difference of the formulas of order six and four.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sepv.errors import Skipped
from sepv.law import Measurement, amplification
from sepv.law.cases.case import Case
from sepv.law.contraction import contraction_ball
from sepv.law.tolerance import accumulated, operations, step_residual, structure_majorant
from sepv.problem import Array, Problem, damping_of, derivative_of_structure, poisson
from sepv.record import EPS, TINY, PolynomialMap
from sepv.schemes import Scheme, ask

# JACOBIAN_MAX_ERROR is the largest relative error of Φ′ with which a step is judged. Steps with a
# larger error are skipped.
JACOBIAN_MAX_ERROR = 1e-6


class StepSlope(NamedTuple):
    """The derivative Φ′ (d, d) of a step at y0, error bounds of its entries (d, d),
    an error bound of y1, and y1.
    """

    slope: Array
    error: Array
    of_step: float
    y1: Array


def tangent(scheme: Scheme, case: Case) -> StepSlope:
    """Return the derivative of a step with respect to y0, with the increments held fixed.

    Raises
    ------
    Skipped
        If the step is not smooth enough for numerical differentiation.
    """
    problem, y, h, dW = case.build()
    rho = _disc(problem, y, h, dW)
    sizes = (
        [poisson.STENCIL_WIDTH * rho] * y.size if rho else poisson.BLIND_WIDTH * poisson.scales(problem, y)
    )
    # Widths of the differences are rounded down to powers of two, so that multiples of them and
    # divisions are exact.
    widths = np.array([float(2.0 ** np.floor(np.log2(size))) for size in sizes])
    answers = _steps(scheme, problem, poisson.shifted(y, widths), h, dW)
    y1 = answers[:, 0]
    # A state is shifted by at most 3 widths. Inside the contraction radius y1 then moves by at most
    # twice the shift. So the residual at a shifted state is at most twice the residual at y, plus a
    # term for y near 0.
    residual = 2 * step_residual(problem, y, y1, h, dW, scheme)
    shifts = 2 * poisson.STENCIL_POINTS * float(widths.max())
    residual += accumulated(scheme) * scheme.eps * operations(problem, scheme.stages) * shifts
    error = amplification(scheme, case) * float(residual.max())
    slope, doubt = poisson.derivative(answers, widths)
    if not np.all(np.isfinite(slope)):
        raise Skipped("the derivative of the step overflows")
    if rho:
        doubt = np.full_like(slope, poisson.STENCIL_TRUNCATION * float((widths[0] / rho) ** 6))
    elif not np.max(doubt) <= JACOBIAN_MAX_ERROR * max(1.0, float(np.max(np.abs(slope)))):
        raise Skipped("the step is not smooth enough for its derivative to be taken by differences")
    return StepSlope(slope, doubt + poisson.STENCIL_ROUNDING * error / widths, error, y1)


def check(scheme: Scheme, case: Case, factor: float = 1.0) -> Measurement:
    """Measure the entry of Φ′B(y0)Φ′ᵀ − `factor` B(y1) that is largest relative to its bound."""
    problem, y, _, _ = case.build()
    slope, E, error, y1 = tangent(scheme, case)
    B, size = problem.structure(y), structure_majorant(problem, y)
    expected = factor * problem.structure(y1)
    defect = np.abs(slope @ B @ slope.T - expected)
    P = np.abs(slope)
    allowed = E @ size @ P.T + P @ size @ E.T + E @ size @ E.T + structure_error(problem, y1, error)
    rounding = 0.5 * scheme.eps * operations(problem, scheme.stages)
    allowed += rounding * (P @ size @ P.T + max(factor, 1.0) * structure_majorant(problem, y1)) + TINY
    i, j = np.unravel_index(int(np.argmax(defect / allowed)), defect.shape)
    unit = EPS * float(np.max(size)) + TINY
    detail = (
        f"entry {i + 1}{j + 1} of Φ′BΦ′ᵀ is {float((slope @ B @ slope.T)[i, j])!r}, "
        f"of {'B(y1)' if factor == 1 else f'{factor!r} B(y1)'} {float(expected[i, j])!r}, y1 = {y1.tolist()}"
    )
    return Measurement(float(defect[i, j]) / unit, float(allowed[i, j]) / unit, detail)


def _steps(scheme: Scheme, problem: Problem, states: Array, h: float, dW: Array) -> Array:
    """Return one step (d, M) from each of the states (d, M), with the same h and increments."""
    if scheme.batched:
        return ask(scheme, problem, states, h, np.repeat(dW[:, None], states.shape[1], axis=1))
    return np.stack([ask(scheme, problem, y, h, dW) for y in states.T], axis=1)


def _disc(problem: Problem, y: Array, h: float, dW: Array) -> float:
    """Return the radius ρ of the disc for Cauchy's estimate of Φ′, or 0 if it is not known.

    It is not known if H or B is a function, the step is long, or damping moves y too.
    """
    if damping_of(problem) or not (
        isinstance(problem.gradient, PolynomialMap) and isinstance(problem.structure, PolynomialMap)
    ):
        return 0.0
    radius, ball = contraction_ball(problem, y)
    return ball / 2 if abs(h) + float(np.sum(np.abs(problem.c * dW))) <= radius / 2 else 0.0


def structure_error(problem: Problem, y: Array, error: float) -> Array:
    """A first-order bound (d, d) of the entries of |B(y + e)
    − B(y)| for all e with |e|_∞ ≤ `error`.
    """
    return np.asarray(np.sum(np.abs(derivative_of_structure(problem, y)), axis=2) * error)
