"""Bodies that attract each other in the plane, H = Σ|p_i|²/2m_i − G Σ_{i<j} m_im_j/|q_i − q_j| with
B = J.

The state is y = (x_1, y_1, x_2, …, p) in an inertial frame, positions first. The total momentum is
zero, and the centre of mass is the origin. The flow keeps the total momentum, the centre of mass
and the angular momentum Σ q_i × p_i.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from sepv.errors import ProblemError
from sepv.problem import Array, Problem, dot
from sepv.problems._common import named
from sepv.problems._kepler import mean_attraction
from sepv.problems._mechanical import positions_first

# The largest number of bodies. Each body has two degrees of freedom, and B and H″ are dense
# matrices.
MOST_BODIES = 16


def planets(
    masses: ArrayLike = (50.0, 1.0, 0.3),
    axes: ArrayLike = (1.0, 1.8),
    eccentricities: ArrayLike = (0.05, 0.1),
    noise: ArrayLike = 1.0,
) -> Problem:
    """A star, whose mass is the first of `masses`, and planets on ellipses about it with the
    semi-major axes `axes`.

    The gravitational constant times the star's mass is 1, so that a light planet of axis 1 has the
    period 2π. Planet k = 0, 1, … starts at its pericentre, in the direction of 2k radians. The unit
    of mass is a planet's mass, so that momenta are of the order of positions. The star is not far
    heavier, so that roundings of its velocity are small.
    """
    m, a, e = (np.atleast_1d(np.asarray(part, dtype=np.float64)) for part in (masses, axes, eccentricities))
    shapes = 2 <= m.size <= MOST_BODIES and m.ndim == 1 and a.shape == e.shape == (m.size - 1,)
    if not (
        shapes
        and np.all(m > 0)
        and np.all(a > 0)
        and np.all((e >= 0) & (e < 1))
        and np.isfinite([*m, *a]).all()
    ):
        raise ProblemError(
            expected=f"2 to {MOST_BODIES} masses > 0, for each but the first an axis > 0 and an eccentricity 0 ≤ e < 1",
            received=f"masses={masses!r:.60}, axes={axes!r:.60}, eccentricities={eccentricities!r:.60}",
            remedy="masses=(50.0, 1.0), axes=(1.0,), eccentricities=(0.05,)",
        )  # fmt: skip
    angle = 2.0 * np.arange(a.size)
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    across = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    speed = np.sqrt((1 + m[1:] / m[0]) / a * (1 + e) / (1 - e))
    q = np.concatenate([np.zeros((1, 2)), (a * (1 - e))[:, None] * direction])
    v = np.concatenate([np.zeros((1, 2)), speed[:, None] * across])
    parameters = {"masses": m.tolist(), "axes": a.tolist(), "eccentricities": e.tolist()}
    return _bodies("planets", parameters, m, q, v, noise, gravity=1 / m[0])


def figure_eight(noise: ArrayLike = 1.0) -> Problem:
    """Three equal masses that follow each other on one curve shaped like an eight,
    with the period 6.32591398.

    The orbit is that of A. Chenciner and R. Montgomery, Annals of Mathematics 152 (2000), from C.
    Simó's initial state.
    """
    x, v = np.array([0.97000436, -0.24308753]), np.array([0.93240737, 0.86473146])
    q, velocities = np.stack([x, -x, 0 * x]), np.stack([v / 2, v / 2, -v])
    return _bodies("figure-eight", {}, np.ones(3), q, velocities, noise, gravity=1.0)


def _bodies(
    name: str, parameters: dict[str, Sequence[float]], m: Array, q: Array, v: Array, noise: ArrayLike, gravity: float
) -> Problem:  # fmt: skip
    """The problem of n bodies with masses m (n,), positions q (n, 2) and velocities v (n, 2).

    Positions and velocities are shifted, so that the centre of mass is at the origin and does not
    move.
    """
    n = m.size
    q, v = q - m @ q / m.sum(), v - m @ v / m.sum()
    inverse = np.repeat(1 / m, 2).tolist()
    pairs = [(i, j, float(gravity * m[i] * m[j])) for i, j in combinations(range(n), 2)]

    def between(y: Array, i: int, j: int) -> Array:
        return np.stack([y[2 * i] - y[2 * j], y[2 * i + 1] - y[2 * j + 1]])

    def distance(y: Array, i: int, j: int) -> Array:
        r: Array = np.sqrt(dot(between(y, i, j), between(y, i, j)))
        return r

    def hamiltonian(y: Array) -> Array:
        kinetic = 0.5 * sum(w * p * p for w, p in zip(inverse, y[2 * n :], strict=True))
        total: Array = kinetic - sum(weight / distance(y, i, j) for i, j, weight in pairs)
        return total

    def mean_gradient(y0: Array, y1: Array) -> Array:
        pulls = np.zeros_like(y0[: 2 * n] + y1[: 2 * n])
        for i, j, weight in pairs:
            pull = weight * mean_attraction(between(y0, i, j), between(y1, i, j))
            pulls[2 * i : 2 * i + 2] += pull
            pulls[2 * j : 2 * j + 2] -= pull
        p0, p1 = y0[2 * n :], y1[2 * n :]
        return np.concatenate([pulls, (np.array(inverse) * (p0 + 0.5 * (p1 - p0)).T).T])

    def turning(y: Array) -> Array:
        q, p = y[: 2 * n], y[2 * n :]
        return np.asarray(sum(q[2 * i] * p[2 * i + 1] - q[2 * i + 1] * p[2 * i] for i in range(n)))

    return named(
        name, noise, parameters, dimension=4 * n, structure=positions_first, hamiltonian=hamiltonian,
        invariants={
            "momentum in x": lambda y: np.asarray(sum(y[2 * n :: 2])),
            "momentum in y": lambda y: np.asarray(sum(y[2 * n + 1 :: 2])),
            "angular momentum": turning,
        },
        mean_gradient=mean_gradient, initial=np.concatenate([q.ravel(), (m[:, None] * v).ravel()]).tolist(),
        domain=lambda y: np.min([distance(y, i, j) for i, j, _ in pairs], axis=0) > 0,
    )  # fmt: skip
