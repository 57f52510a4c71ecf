"""The contraction radius of a problem: a bound of |h| + Σ|c_jΔW_j| under which implicit steps are contractions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sepv._kept import kept, key_of
from sepv.problem import Array, HamiltoniansProblem, PolynomialSystem, Problem, matmul, matvec
from sepv.problems import build
from sepv.record import PolynomialMap
from sepv.verification._cases.case import Case
from sepv.verification._tolerance import majorants, pushes

# With the contraction factor 1/4, every scheme that evaluates B and ∇H between y0 and y1 has a unique solution near y0.
# If its equation is y1 = y0 + R, then |(I − ∂R/∂y1)⁻¹| is at most 4/3.
CONTRACTION = 0.25


def has_majorants(case: Case) -> bool:
    """True if a case's radius is derived: for polynomial data, unless every noise has an H_j that commutes with H_0."""
    data = case.problem
    if not isinstance(data, PolynomialSystem):
        return False
    return not data.noise_hamiltonians or isinstance(build(data), HamiltoniansProblem)


def shortened(case: Case) -> Case:
    """Shorten a step by a power of two to at most half its contraction radius; without polynomial data, do nothing.

    The law poisson-map needs this, because its Cauchy estimate takes the step from all states in a ball around y.
    """
    problem, y, h, dW = case.build()
    if not isinstance(problem.gradient, PolynomialMap):
        return case
    length, most = abs(h) + float(np.sum(np.abs(problem.c * dW))), contraction_radius(problem, y) / 2
    if length <= most:
        return case
    share = 2.0 ** np.floor(np.log2(most / length))
    return replace(case, h=float(share * h), dW=tuple(float(share * w) for w in dW))


def contraction_radius(problem: Problem, y: Array) -> float:
    """A radius for |h| + Σ|c_jΔW_j| inside which every implicit scheme's step from y is a contraction.

    Let y1 = y0 + R(y1) be the step's equation, |Δ| = |h| + Σ|c_jΔW_j|, and M_B ≥ |B| and M_g ≥ |∇H| bounds on the ball
    |y1 − y0|_∞ ≤ r. There |R| ≤ |Δ| G with G = |M_B M_g|_∞. R has the Lipschitz constant |Δ| L with
    L = |B′|M_g + M_B|H″|. A discrete gradient with coordinate increments needs this L; for (2.1) half of it suffices.
    If |Δ| ≤ min(r/G, CONTRACTION/L), y0 + R maps the ball into itself. `problem` must be polynomial data.
    """
    return contraction_ball(problem, y)[0]


def contraction_ball(problem: Problem, y: Array) -> tuple[float, float]:
    """A pair (radius, r): for |Δ| ≤ radius, Δ real or complex, the solution stays within r of y.

    Each r > 0 gives a radius, and the largest radius is returned. The values tried for r are |y|, the scale of the
    system near y, and for states at or near the origin 1 + |y|, each multiplied by powers of two.
    """
    return kept("balls").get(key_of(problem.data, y), lambda: _ball(problem, y))


def _ball(problem: Problem, y: Array) -> tuple[float, float]:
    largest = float(np.max(np.abs(y)))
    sizes = [(1 + largest) * 2.0**-k for k in range(6)] + [largest * 2.0**-k for k in range(-1, 6) if largest]
    balls = np.array(sizes)
    reach = np.abs(y)[:, None] + balls
    with np.errstate(all="ignore"):
        B, g, dB, H = majorants(problem, reach)
        field = np.max(np.maximum(matvec(B, g), pushes(problem)[:, None]), axis=0)
        slope = np.max(np.sum(matvec(dB, g) + matmul(B, H), axis=1), axis=0)
        # If the fields vanish, every step is short enough. If majorants overflow, no step is.
        radii = np.minimum(
            np.where(field > 0, balls / field, np.inf), np.where(slope > 0, CONTRACTION / slope, np.inf)
        )
    best = int(np.argmax(np.nan_to_num(radii, nan=0.0, posinf=np.inf)))
    return float(radii[best]), float(balls[best])
