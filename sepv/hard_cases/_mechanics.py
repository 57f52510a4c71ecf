"""Hard cases of the state y: separatrices, extreme inertia, large angles, chaos, collisions,
steep walls.

The last two cases are of the Lotka-Volterra system (§4.4): states next to the axes, steps that may
have no solution.
"""

from __future__ import annotations

import numpy as np

from sepv.hard_cases._hard_case import REFUSAL_STATUSES, HardCase, sizes, steps
from sepv.problem import Array, NamedProblem, PolynomialSystem
from sepv.problems import canonical
from sepv.record import add_polynomials as add
from sepv.record import polynomial, squares

_HENON = PolynomialSystem(
    4, add(squares((1.0,) * 4), polynomial(4, {(0, 0, 2, 1): 1.0, (0, 0, 0, 3): -1 / 3})), canonical(4)
)
_LOTKA_VOLTERRA = NamedProblem(
    "lotka-volterra",
    (("a", (-2.0,)), ("b", (-1.0,)), ("d", (-0.5,)), ("nu", (1.0,)), ("mu", (2.0,)), ("noise", (0.5,))),
)


def _rigid(inertia: tuple[float, float, float]) -> NamedProblem:
    return NamedProblem("rigid-body", (("inertia", inertia), ("noise", (1.0,))))


def _middle_axis(rng: np.random.Generator, lanes: int) -> Array:
    """Rigid-body states next to the unstable rotation about the middle axis,
    at distances from 1e-16 to 0.1.
    """
    signs = [-1.0, 1.0]
    return np.stack([sizes(rng, 1e-16, 0.1, lanes), rng.choice(signs, lanes), sizes(rng, 1e-16, 0.1, lanes)])


def _spread_inertia(rng: np.random.Generator, lanes: int) -> Array:
    y = rng.standard_normal((3, lanes))
    return np.asarray(y / np.sqrt((y * y).sum(axis=0)))


def _separatrix(rng: np.random.Generator, lanes: int) -> Array:
    """Pendulum states with H = 1, the separatrix: p = ±2 cos(q/2),
    with q down to 1e-16 from the upper equilibrium.
    """
    q = rng.choice([-1.0, 1.0], lanes) * (np.pi - np.abs(sizes(rng, 1e-16, np.pi, lanes)))
    p = 2 * np.cos(q / 2) * rng.choice([-1.0, 1.0], lanes)
    return np.stack([p, q])


def _chaos(rng: np.random.Generator, lanes: int) -> Array:
    """Chaotic states of Hénon-Heiles: H between 1/8 and 1/6,
    inside the triangle that bounds the motion.
    """
    radius, angle = 0.3 * np.sqrt(rng.random(lanes)), rng.uniform(0, 2 * np.pi, lanes)
    q = np.stack([radius * np.cos(angle), radius * np.sin(angle)])
    potential = 0.5 * (q * q).sum(axis=0) + q[0] * q[0] * q[1] - q[1] ** 3 / 3
    speed = np.sqrt(2 * (rng.uniform(1 / 8, 1 / 6, lanes) - potential))
    turn = rng.uniform(0, 2 * np.pi, lanes)
    return np.concatenate([np.stack([speed * np.cos(turn), speed * np.sin(turn)]), q])


def _eccentric(rng: np.random.Generator, lanes: int) -> Array:
    """States on a Kepler orbit of eccentricity 0.99, half of them next to the pericentre."""
    e = 0.99
    anywhere, angle = rng.random(lanes) < 0.5, rng.uniform(-np.pi, np.pi, lanes)
    anomaly = np.where(anywhere, angle, sizes(rng, 1e-6, 0.3, lanes))
    root, radius = np.sqrt(1 - e * e), 1 - e * np.cos(anomaly)
    p = np.stack([-np.sin(anomaly), root * np.cos(anomaly)]) / radius
    q = np.stack([np.cos(anomaly) - e, root * np.sin(anomaly)])
    return np.concatenate([p, q])


def _collision(rng: np.random.Generator, lanes: int) -> Array:
    """Kepler states that nearly collide: the segment from q0 to q1 passes the centre at a distance
    of 1e-12 to 1e-2.
    """
    y = np.zeros((4, lanes))
    y[2], y[3] = rng.uniform(0.05, 0.5, lanes), sizes(rng, 1e-12, 1e-2, lanes)
    y[0] = -np.sqrt(2 / y[2])
    return y


def _steep(rng: np.random.Generator, lanes: int) -> Array:
    """Toda states: forces exp(q_i − q_{i+1}) from e^−300 to e^300,
    and momenta for which Newton's method overshoots.
    """
    y = np.zeros((6, lanes))
    y[:3] = sizes(rng, 1e-2, 1e3, (3, lanes))
    gaps = rng.uniform(-300, 10, (2, lanes))
    high = rng.random(lanes) < 0.3
    gaps[0, high] = rng.uniform(10, 300, int(high.sum()))
    y[4], y[5] = -gaps[0], -gaps[0] - gaps[1]
    return y


def _axes(rng: np.random.Generator, lanes: int) -> Array:
    """States of Lotka-Volterra near the axes: each component is about 1, or tiny, down to
    1e-150.
    """
    small, size = rng.random((3, lanes)) < 0.5, np.abs(sizes(rng, 1e-150, 1e-3, (3, lanes)))
    return np.where(small, size, rng.uniform(0.3, 2, (3, lanes)))


def _coarse(rng: np.random.Generator, lanes: int) -> Array:
    return np.array([[1.0], [1.9], [0.5]]) * rng.uniform(0.5, 2.0, (3, lanes))


MECHANICS_CASES = (
    HardCase(
        "rigid-body-middle-axis", "next to the unstable middle axis, on its separatrix to 1e-16",
        "solved: |y1| = |y0| bounds every solution, so that one exists for every Δ",
        _rigid((0.345, 0.653, 1.0)), steps(1e-3, 1.0, _middle_axis), laws=("energy", "casimir", "symmetry"),
    ),
    HardCase(
        "rigid-body-inertia-1e6",
        "moments of inertia 1 : 10^6, |Δ| up to a hundred periods of the fastest rotation",
        "a solution exists for every Δ (|y1| = |y0|), but the branch from y0 may turn back before; "
        "Newton finds one or says that it does not",
        _rigid((1e-3, 1.0, 1e3)), steps(1e-6, 1e-1, _spread_inertia), refusals=("NO_CONVERGENCE", "SINGULAR"),
        laws=("energy", "casimir"),
    ),
    HardCase(
        "pendulum-separatrix", "H = 1, down to 1e-16 from the upper equilibrium, where all terms of H cancel",
        "solved; the equilibrium itself is a state at rest",
        NamedProblem("pendulum", (("noise", (1.0,)),)), steps(1e-3, 1.0, _separatrix),
        laws=("energy", "symmetry"),
    ),
    HardCase(
        "pendulum-far-angles", "angles of 10^6 to 10^8: an ulp of q is up to 1.5e-8 and moves H by as much",
        "solved; the defect is an ulp of q times sin q, which is what the unit |∇H||y| eps says",
        NamedProblem("pendulum", (("noise", (1.0,)),)),
        steps(1e-3, 1.0, lambda rng, n: np.stack([rng.uniform(-3, 3, n), sizes(rng, 1e6, 1e8, n)])),
    ),
    HardCase(
        "henon-heiles", "energies from 1/8 to 1/6: chaotic, at the edge of the unbounded region",
        "solved where the branch from y0 reaches; large steps may end at a fold",
        _HENON, steps(1e-2, 1.0, _chaos), refusals=("NO_CONVERGENCE", "SINGULAR"),
    ),
    HardCase(
        "kepler-0.99",
        "eccentricity 0.99: ∇H varies by 10^4 along the orbit, next to the pericentre within a step",
        "solved for steps shorter than the passage; beyond, Newton finds a solution or says not",
        NamedProblem("kepler", (("eccentricity", (0.99,)), ("noise", (1.0,)))), steps(1e-5, 1e-1, _eccentric),
        refusals=REFUSAL_STATUSES, laws=(),
    ),
    HardCase(
        "kepler-collision",
        "the segment from q0 to q1 passes the centre by 1e-12 to 1e-2, where ∫∇H dτ is singular",
        "solved short of the centre; a step over it is refused or solves (2.1) on the other side",
        NamedProblem("kepler", (("eccentricity", (0.99,)), ("noise", (1.0,)))), steps(1e-3, 1.0, _collision),
        refusals=REFUSAL_STATUSES, laws=(),
    ),
    HardCase(
        "toda-steep",
        "exponentials from e^-300 to e^300 and momenta up to 10^3: iterates overflow long before y1 does",
        "solved where damping brings the iterates back; never an overflow that passes for a value",
        NamedProblem("toda", (("particles", (3.0,)), ("noise", (1.0,)))), steps(1e-4, 1.0, _steep),
        refusals=REFUSAL_STATUSES, laws=(),
    ),
    HardCase(
        "lotka-volterra-axes", "components down to 1e-150: ∇H up to 1e150 meets B that vanishes as fast",
        "solved; damped into y > 0 where a full Newton step leaves it",
        _LOTKA_VOLTERRA, steps(1e-4, 2.0**-5, _axes, c=0.5),
    ),
    HardCase(
        "lotka-volterra-coarse", "|Δ| from 0.1 to 4: the branch of solutions from y0 ends at a fold",
        "solved before the fold, refused beyond: no energy level is bounded, and no solution need exist",
        _LOTKA_VOLTERRA, steps(0.1, 4.0, _coarse, c=0.5), refusals=REFUSAL_STATUSES,
    ),
)  # fmt: skip
