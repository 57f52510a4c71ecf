"""Hard states of mechanics: separatrices, extreme inertia, large angles, chaos, collisions, steep walls."""

from __future__ import annotations

import numpy as np

from sepv.problem import NamedProblem, PolynomialSystem
from sepv.problems._canonical import canonical
from sepv.problems.hard._hard_case import REFUSALS, HardCase, Sample, sizes, split
from sepv.record._polynomial import add, polynomial, squares

_SPREAD = (1e-3, 1.0, 1e3)
_HENON = PolynomialSystem(
    4, add(squares((1.0,) * 4), polynomial(4, {(0, 0, 2, 1): 1.0, (0, 0, 0, 3): -1 / 3})), canonical(4)
)


def _rigid(inertia: tuple[float, float, float]) -> NamedProblem:
    return NamedProblem("rigid-body", (("inertia", inertia), ("noise", (1.0,))))


def _middle_axis(rng: np.random.Generator, lanes: int) -> Sample:
    y = np.stack(
        [sizes(rng, 1e-16, 0.1, lanes), rng.choice([-1.0, 1.0], lanes), sizes(rng, 1e-16, 0.1, lanes)]
    )
    return Sample(y, *split(rng, 1e-3, 1.0, lanes))


def _spread_inertia(rng: np.random.Generator, lanes: int) -> Sample:
    y = rng.standard_normal((3, lanes))
    return Sample(y / np.sqrt((y * y).sum(axis=0)), *split(rng, 1e-6, 1e-1, lanes))


def _separatrix(rng: np.random.Generator, lanes: int) -> Sample:
    """H = 1: p = ±2 cos(q/2), with q down to 1e-16 from the upper equilibrium."""
    q = rng.choice([-1.0, 1.0], lanes) * (np.pi - np.abs(sizes(rng, 1e-16, np.pi, lanes)))
    p = 2 * np.cos(q / 2) * rng.choice([-1.0, 1.0], lanes)
    return Sample(np.stack([p, q]), *split(rng, 1e-3, 1.0, lanes))


def _far_angles(rng: np.random.Generator, lanes: int) -> Sample:
    y = np.stack([rng.uniform(-3, 3, lanes), sizes(rng, 1e6, 1e8, lanes)])
    return Sample(y, *split(rng, 1e-3, 1.0, lanes))


def _chaos(rng: np.random.Generator, lanes: int) -> Sample:
    """H between 1/8 and 1/6, inside the triangle that bounds the motion: the chaotic range."""
    radius, angle = 0.3 * np.sqrt(rng.random(lanes)), rng.uniform(0, 2 * np.pi, lanes)
    q = np.stack([radius * np.cos(angle), radius * np.sin(angle)])
    potential = 0.5 * (q * q).sum(axis=0) + q[0] * q[0] * q[1] - q[1] ** 3 / 3
    speed, turn = (
        np.sqrt(2 * (rng.uniform(1 / 8, 1 / 6, lanes) - potential)),
        rng.uniform(0, 2 * np.pi, lanes),
    )
    return Sample(
        np.concatenate([np.stack([speed * np.cos(turn), speed * np.sin(turn)]), q]),
        *split(rng, 1e-2, 1.0, lanes),
    )


def _eccentric(rng: np.random.Generator, lanes: int) -> Sample:
    """All of an orbit of eccentricity 0.99, half of the states next to the pericentre."""
    e = 0.99
    anomaly = np.where(
        rng.random(lanes) < 0.5, rng.uniform(-np.pi, np.pi, lanes), sizes(rng, 1e-6, 0.3, lanes)
    )
    root, radius = np.sqrt(1 - e * e), 1 - e * np.cos(anomaly)
    p = np.stack([-np.sin(anomaly), root * np.cos(anomaly)]) / radius
    q = np.stack([np.cos(anomaly) - e, root * np.sin(anomaly)])
    return Sample(np.concatenate([p, q]), *split(rng, 1e-5, 1e-1, lanes))


def _collision(rng: np.random.Generator, lanes: int) -> Sample:
    """Straight at the centre, missing it by 1e-12 to 1e-2: the segment from q0 to q1 passes next to it."""
    y = np.zeros((4, lanes))
    y[2], y[3] = rng.uniform(0.05, 0.5, lanes), sizes(rng, 1e-12, 1e-2, lanes)
    y[0] = -np.sqrt(2 / y[2])
    return Sample(y, *split(rng, 1e-3, 1.0, lanes))


def _steep(rng: np.random.Generator, lanes: int) -> Sample:
    """Links exp(q_i − q_{i+1}) from e^−300 to e^300, and momenta that shoot Newton's first step far up the wall."""
    y = np.zeros((6, lanes))
    y[:3] = sizes(rng, 1e-2, 1e3, (3, lanes))
    gaps = rng.uniform(-300, 10, (2, lanes))
    high = rng.random(lanes) < 0.3
    gaps[0, high] = rng.uniform(10, 300, int(high.sum()))
    y[4], y[5] = -gaps[0], -gaps[0] - gaps[1]
    return Sample(y, *split(rng, 1e-4, 1.0, lanes))


CASES = (
    HardCase(
        name="rigid-body-middle-axis",
        reason="next to the unstable middle axis, on its separatrix to 1e-16",
        expected="solved: |y1| = |y0| bounds every solution, so that one exists for every Δ",
        data=_rigid((0.345, 0.653, 1.0)),
        sample=_middle_axis,
        laws=("energy", "casimir", "symmetry"),
    ),
    HardCase(
        name="rigid-body-inertia-1e6",
        reason="moments of inertia 1 : 10^6, |Δ| up to a hundred periods of the fastest rotation",
        expected="a solution exists for every Δ (|y1| = |y0|), but the branch from y0 may turn back before; "
        "Newton finds one or says that it does not",
        data=_rigid(_SPREAD),
        sample=_spread_inertia,
        refusals=("NO_CONVERGENCE", "SINGULAR"),
        laws=("energy", "casimir"),
    ),
    HardCase(
        name="pendulum-separatrix",
        reason="H = 1, down to 1e-16 from the upper equilibrium, where all terms of H cancel",
        expected="solved; the equilibrium itself is a state at rest",
        data=NamedProblem("pendulum", (("noise", (1.0,)),)),
        sample=_separatrix,
        laws=("energy", "symmetry"),
    ),
    HardCase(
        name="pendulum-far-angles",
        reason="angles of 10^6 to 10^8: an ulp of q is up to 1.5e-8 and moves H by as much",
        expected="solved; the defect is an ulp of q times sin q, which is what the unit |∇H||y| eps says",
        data=NamedProblem("pendulum", (("noise", (1.0,)),)),
        sample=_far_angles,
    ),
    HardCase(
        name="henon-heiles",
        reason="energies from 1/8 to 1/6: chaotic, at the edge of the unbounded region",
        expected="solved where the branch from y0 reaches; large steps may end at a fold",
        data=_HENON,
        sample=_chaos,
        refusals=("NO_CONVERGENCE", "SINGULAR"),
    ),
    HardCase(
        name="kepler-0.99",
        reason="eccentricity 0.99: ∇H varies by 10^4 along the orbit, next to the pericentre within a step",
        expected="solved for steps shorter than the passage; beyond, Newton finds a solution or says not",
        data=NamedProblem("kepler", (("eccentricity", (0.99,)), ("noise", (1.0,)))),
        sample=_eccentric,
        refusals=REFUSALS,
        laws=(),
    ),
    HardCase(
        name="kepler-collision",
        reason="the segment from q0 to q1 passes the centre by 1e-12 to 1e-2, where ∫∇H dτ is singular",
        expected="solved short of the centre; a step over it is refused or solves (2.1) on the other side",
        data=NamedProblem("kepler", (("eccentricity", (0.99,)), ("noise", (1.0,)))),
        sample=_collision,
        refusals=REFUSALS,
        laws=(),
    ),
    HardCase(
        name="toda-steep",
        reason="exponentials from e^-300 to e^300 and momenta up to 10^3: iterates overflow long before y1 does",
        expected="solved where damping brings the iterates back; never an overflow that passes for a value",
        data=NamedProblem("toda", (("particles", (3.0,)), ("noise", (1.0,)))),
        sample=_steep,
        refusals=REFUSALS,
        laws=(),
    ),
)
