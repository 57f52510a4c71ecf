"""The check of the laws "poisson-map" and "symplecticity": Φ′(y0) B(y0) Φ′(y0)ᵀ = B(y1), with a derived bound.

`sepv.problem._poisson` has the derivative Φ′ and its error E, entry by entry. The error of (P) is then bounded by

    E|B||Φ′|ᵀ + |Φ′||B|Eᵀ + E|B|Eᵀ,    |B(y1 + e) − B(y1)| for the error e of y1,    and roundings of the products.

For polynomial data inside half the contraction radius the disc of Cauchy's estimate is known: with r the ball of
`sepv.verification._contraction.contraction_ball`, every y0 + ζe_j, |ζ| ≤ r/2, moves by at most r/2 and stays
in the ball, so that ρ = M = r/2. For other problems the formula of order four stands for what that of order
six may be off by.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sepv.errors import Skipped
from sepv.problem import Array, Problem, poisson
from sepv.record import EPS, TINY, PolynomialMap
from sepv.schemes import Scheme, ask
from sepv.verification._amplification import amplification
from sepv.verification._cases.case import Case
from sepv.verification._contraction import contraction_ball
from sepv.verification._law import Measurement
from sepv.verification._tolerance import operations, step_residual, structure_majorant

# The largest relative error of a derivative that can decide about the structure.
ROUGH = 1e-6


class StepSlope(NamedTuple):
    """Φ′ at y0 (d, d), its error entry by entry, the step's own error, and y1."""

    slope: Array
    error: Array
    of_step: float
    y1: Array


def tangent(scheme: Scheme, case: Case) -> StepSlope:
    """The derivative of a step with the increments held fixed.

    Raises
    ------
    Skipped
        Where the step is not smooth enough for differences.
    """
    problem, y, h, dW = case.build()
    rho = _disc(problem, y, h, dW)
    sizes = [poisson.WIDTH * rho] * y.size if rho else poisson.BLIND_WIDTH * poisson.scales(problem, y)
    # Powers of two no larger than these: multiples are exact, and so is a division by one.
    widths = np.array([float(2.0 ** np.floor(np.log2(size))) for size in sizes])
    answers = _steps(scheme, problem, poisson.shifted(y, widths), h, dW)
    y1 = answers[:, 0]
    # Majorants at the shifted states are larger by far less than a factor of two, and near y = 0 by what the shifts
    # are: 3w, and as much again for y1 and the flow inside the contraction radius.
    residual = 2 * step_residual(problem, y, y1, h, dW, scheme)
    residual += scheme.eps * operations(problem, scheme.stages) * 2 * poisson.POINTS * float(widths.max())
    error = amplification(scheme, case) * float(residual.max())
    slope, doubt = poisson.derivative(answers, widths)
    if not np.all(np.isfinite(slope)):
        raise Skipped("the derivative of the step overflows")
    if rho:
        doubt = np.full_like(slope, poisson.TRUNCATION * float((widths[0] / rho) ** 6))
    elif not np.max(doubt) <= ROUGH * max(1.0, float(np.max(np.abs(slope)))):
        raise Skipped("the step is not smooth enough for its derivative to be taken by differences")
    return StepSlope(slope, doubt + poisson.ROUNDING * error / widths, error, y1)


def check(scheme: Scheme, case: Case) -> Measurement:
    """The largest entry of Φ′BΦ′ᵀ − B(y1) relative to its bound."""
    problem, y, _, _ = case.build()
    slope, E, error, y1 = tangent(scheme, case)
    B, size = problem.structure(y), structure_majorant(problem, y)
    defect = np.abs(slope @ B @ slope.T - problem.structure(y1))
    P = np.abs(slope)
    allowed = E @ size @ P.T + P @ size @ E.T + E @ size @ E.T + poisson.structure_error(problem, y1, error)
    rounding = 0.5 * scheme.eps * operations(problem, scheme.stages)
    allowed += rounding * (P @ size @ P.T + structure_majorant(problem, y1)) + TINY
    i, j = np.unravel_index(int(np.argmax(defect / allowed)), defect.shape)
    unit = EPS * float(np.max(size)) + TINY
    detail = (
        f"entry {i + 1}{j + 1} of Φ′BΦ′ᵀ is {float((slope @ B @ slope.T)[i, j])!r}, "
        f"of B(y1) {float(problem.structure(y1)[i, j])!r}, y1 = {y1.tolist()}"
    )
    return Measurement(float(defect[i, j]) / unit, float(allowed[i, j]) / unit, detail)


def _steps(scheme: Scheme, problem: Problem, states: Array, h: float, dW: Array) -> Array:
    """Step each of the states (d, M), with the same h and increments."""
    if scheme.batched:
        return ask(scheme, problem, states, h, np.repeat(dW[:, None], states.shape[1], axis=1))
    return np.stack([ask(scheme, problem, y, h, dW) for y in states.T], axis=1)


def _disc(problem: Problem, y: Array, h: float, dW: Array) -> float:
    """The radius ρ, or 0 if none is known."""
    if not (isinstance(problem.gradient, PolynomialMap) and isinstance(problem.structure, PolynomialMap)):
        return 0.0
    radius, ball = contraction_ball(problem, y)
    return ball / 2 if abs(h) + float(np.sum(np.abs(problem.c * dW))) <= radius / 2 else 0.0
