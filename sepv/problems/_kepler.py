"""The planar Kepler problem, H = |p|²/2 − 1/|q|, with B = J⁻¹ as in (1.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sepv._arguments import is_number
from sepv.errors import ProblemError
from sepv.problem import Array, Problem
from sepv.problems._common import named, structure


def kepler(eccentricity: float = 0.6, noise: ArrayLike = 1.0) -> Problem:
    """The planar Kepler problem for y = (p1, p2, q1, q2), q ≠ 0,
    from the pericentre of an orbit of semi-major axis 1.

    The average of ∂H/∂q = q/|q|³ over a segment from q0 to q1 is, up to its sign, the
    field at the origin of a uniform charge on this segment. It equals 2u/(|q0||q1||u|²)
    with u = q0/|q0| + q1/|q1|, so that no digits cancel as q1 → q0. For a segment near
    the origin it grows like 1/|u|. Only its component along the segment enters the change
    of H.
    """
    if not is_number(eccentricity) or not 0 <= eccentricity < 1:
        raise ProblemError(
            expected="an eccentricity 0 ≤ e < 1",
            received=repr(eccentricity),
            remedy="an ellipse, such as 0.6",
        )
    e = float(eccentricity)
    return named(
        "kepler",
        noise,
        {"eccentricity": (e,)},
        dimension=4,
        structure=structure,
        hamiltonian=lambda y: 0.5 * (y[0] * y[0] + y[1] * y[1]) - 1 / _radius(y),
        # |q| is not affine in y, so that no rule of `sepv.record` derives the averaged gradient.
        mean_gradient=_mean_gradient,
        domain=lambda y: _radius(y) > 0,
        initial=(0.0, np.sqrt((1 + e) / (1 - e)), 1 - e, 0.0),
    )


def _radius(y: Array) -> Array:
    radius: Array = np.sqrt(y[2] * y[2] + y[3] * y[3])
    return radius


def _mean_gradient(y0: Array, y1: Array) -> Array:
    return np.concatenate([y0[:2] + 0.5 * (y1[:2] - y0[:2]), mean_attraction(y0[2:], y1[2:])])


def mean_attraction(q0: Array, q1: Array) -> Array:
    """The average of q/|q|³ along the segment from q0 to q1 in the plane, (2, ...)."""
    r0, r1 = np.sqrt(q0[0] * q0[0] + q0[1] * q0[1]), np.sqrt(q1[0] * q1[0] + q1[1] * q1[1])
    u = np.stack([q0[0] / r0 + q1[0] / r1, q0[1] / r0 + q1[1] / r1])
    opening = u[0] * u[0] + u[1] * u[1]  # 2(1 + cos φ) for the angle φ between q0 and q1
    force = 2 * u / (r0 * r1 * opening)
    # If φ exceeds 120°, digits of u cancel. The part along b = q1 − q0 is then computed from 1/r0
    # − 1/r1. The other part is perpendicular to b in every digit, so that it does no work, however
    # inaccurate it is.
    b, middle = q1 - q0, q1 + q0
    square = np.where(opening < 1, b[0] * b[0] + b[1] * b[1], 1.0)
    along = (b[0] * middle[0] + b[1] * middle[1]) / (r0 * r1 * (r0 + r1)) / square
    area = q0[0] * q1[1] - q0[1] * q1[0]
    across = 2 * area * (r0 + r1) / ((r0 * r1) ** 2 * np.where(opening > 0, opening, 1.0)) / square
    split = np.stack([along * b[0] + across * b[1], along * b[1] - across * b[0]])
    mean: Array = np.where((opening < 1) & (opening > 0), split, force)
    return mean
