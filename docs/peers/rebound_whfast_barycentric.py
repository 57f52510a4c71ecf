"""rebound whfast, coordinates=barycentric: it is symplectic with one planet, but not with two.

The script computes the derivative Φ′ of one step by differences of order four, and prints the largest entry of Φ′JΦ′ᵀ −
J (J: canonical structure). With barycentric coordinates and two planets this defect falls like h³. In the other cases
it is the error of the differences. Positions Q_i and velocities V_j relative to the centre of mass have the Poisson
brackets {Q_i, V_j} = δ_ij/m_i − 1/M, with the total mass M. The Kepler step moves each planet separately, which
preserves only δ_ij/m_i. The step is still reversible, and of order 2.

Exit code 1 while this is so, 0 where the step with two planets is symplectic.
"""

import sys

import numpy as np
import rebound

NOTES = [
    (
        "documentation of the integrator WHFAST, 5.2.2 (github.com/hannorein/rebound)",
        "2026-11-23",
        "WHFast is an implementation of the symplectic [Wisdom & Holman (1991)] integrator. … The user can choose "
        "between Jacobi, Democratic Heliocentric, WHDS, and barycentric coordinates.",
    ),
    (
        "pull request 804, which added barycentric coordinates",
        "2024-11-08",
        "something similar to Jacobi coordinates, where the first coordinate points to the center of mass and the "
        "other coordinates are calculated relative to it.",
    ),
    (
        "pull request 822; no issue that we found names it",
        "2025-03-13",
        "the energy error is lower than WHDS and Democratic Heliocentric coordinates",
    ),
]


def step(z, m, h, coordinates):
    """(q, p) after one step, in the plane."""
    simulation = rebound.Simulation()
    simulation.integrator, simulation.dt = "whfast", h
    simulation.integrator.coordinates = coordinates
    q, v = z.reshape(2, -1, 2)[0], z.reshape(2, -1, 2)[1] / m[:, None]
    for mass, x, u in zip(m, q, v, strict=True):
        simulation.add(m=mass, x=x[0], y=x[1], vx=u[0], vy=u[1])
    simulation.steps(1)
    ends = [(a.x, a.y, a.m * a.vx, a.m * a.vy) for a in simulation.particles]
    return np.array(ends).reshape(-1, 2, 2).transpose(1, 0, 2).ravel()


def defect(m, h, coordinates):
    """The largest entry of Φ′JΦ′ᵀ − J."""
    n, angle = m.size, np.array([0.0, 0.3, 2.0])[: m.size]
    q = np.array([0.0, 1.0, 1.8])[:n, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    v = np.array([0.0, 1.05, 0.78])[:n, None] * np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    z = np.concatenate([q.ravel(), (m[:, None] * v).ravel()])
    widths = 1e-3 * np.concatenate([np.ones(2 * n), np.repeat(m, 2)])

    def difference(k, width):
        e = width * np.eye(4 * n)[k]
        return (step(z + e, m, h, coordinates) - step(z - e, m, h, coordinates)) / (2 * width)

    slopes = [(4 * difference(k, w / 2) - difference(k, w)) / 3 for k, w in enumerate(widths)]
    derivative, J = np.stack(slopes, axis=1), np.kron([[0.0, 1.0], [-1.0, 0.0]], np.eye(2 * n))
    return np.abs(derivative @ J @ derivative.T - J).max()


print(f"rebound {rebound.__version__} whfast: coordinates, masses, and the defect for h = 0.08, 0.04, 0.02")
for name in ("jacobi", "democraticheliocentric", "whds", "barycentric"):
    for m in (np.array([1.0, 0.1]), np.array([1.0, 0.001, 0.0003])):
        found = [defect(m, h, name) for h in (0.08, 0.04, 0.02)]
        values = ", ".join(f"{value:.0e}" for value in found)
        print(f"{name:22} {m.tolist()!s:20} {values}")
sys.exit(bool(found[0] > 1e-6))
