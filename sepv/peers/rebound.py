"""REBOUND's integrators: some for the forces of any mechanical problem,
others for planets under REBOUND's gravity.

They need the extra ``simulators``. Integrators for planets split the motion into Kepler's motion
and the rest. So they support only gravity, V = −G Σ m_im_j/|q_i − q_j| in the plane or in space
with the heaviest body first, such as `sepv.problems.planets`. A step is one of REBOUND's with its
default `safe_mode=1`: synchronized at the end.

JANUS computes with integers of 64 bits, x/scale and v/scale, and its documentation asks for a
scale. Here the scale is 2⁻⁵⁶ times a power of two above the state and its change in a step. This is
below the rounding of binary64.
"""

from __future__ import annotations

import warnings
from functools import lru_cache, partial
from itertools import combinations
from typing import Any

import numpy as np
import rebound

from sepv.errors import Skipped
from sepv.peers._integrator import REVERSIBLE, SYMPLECTIC, integrator, masses
from sepv.peers.peer import Peer
from sepv.problem import Array, Mechanics, sample_states
from sepv.schemes import Scheme


def _advance(
    name: str, order: int | None, system: Mechanics, q: Array, p: Array, h: float
) -> tuple[Array, Array]:
    simulation, mass = rebound.Simulation(), masses(system)
    simulation.gravity, simulation.integrator, simulation.dt = "none", name, h
    if order is not None:
        simulation.integrator.order = order
    if name == "janus":
        simulation.integrator.scale_pos = _scale(q, h * p / mass)
        simulation.integrator.scale_vel = _scale(p / mass, h * system.force(q) / mass)
    for m, x, v in zip(mass, q, p / mass, strict=True):
        simulation.add(m=m, x=x, vx=v)
    particles = simulation.particles

    def forces(_simulation: Any) -> None:
        with np.errstate(over="ignore", invalid="ignore"):
            acceleration = system.force(np.array([a.x for a in particles])) / mass
        for particle, a in zip(particles, acceleration, strict=True):
            particle.ax += a

    simulation.additional_forces = forces
    if order is None:  # the integrator chooses its steps; a least size ends them where a solution ends
        simulation.integrator.min_dt = abs(h) / 1000
        simulation.integrate(h)
    else:
        simulation.steps(1)
    return _finite(name, np.array([a.x for a in particles]), mass * np.array([a.vx for a in particles]))


def _finite(name: str, q: Array, p: Array) -> tuple[Array, Array]:
    if not np.all(np.isfinite([q, p])):
        raise ArithmeticError(f"{name} came to values that are not finite")
    return q, p


def _scale(values: Array, changes: Array) -> float:
    return float(2.0 ** (np.frexp(max(np.abs(values).max(), np.abs(changes).max()))[1] - 56))


def _gravitate(
    name: str, options: dict[str, Any], system: Mechanics, q: Array, p: Array, h: float
) -> tuple[Array, Array]:
    """One step of planets under REBOUND's own gravity, by the integrator `name` with `options`."""
    gravity, mass, space = _gravity(system)
    simulation = rebound.Simulation()
    simulation.G, simulation.integrator, simulation.dt = gravity, name, h
    for key, value in options.items():
        setattr(simulation.integrator, key, value)
    for m, x, v in zip(mass, _in_space(q, space), _in_space(p, space) / mass[:, None], strict=True):
        simulation.add(m=m, **dict(zip(("x", "y", "z", "vx", "vy", "vz"), (*x, *v), strict=True)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of steps longer than a period: laws see them
        simulation.steps(1)
    ends = [(a.xyz[:space], a.vxyz[:space]) for a in simulation.particles]
    q1, v1 = (np.array(part) for part in zip(*ends, strict=True))
    return _finite(name, q1.ravel(), (mass[:, None] * v1).ravel())


def _in_space(values: Array, space: int) -> Array:
    """The coordinates (n·space,) of n bodies as points (n, 3), in the plane with z = 0."""
    return np.pad(values.reshape(-1, space), ((0, 0), (0, 3 - space)))


@lru_cache(maxsize=64)
def _gravity(system: Mechanics) -> tuple[float, Array, int]:
    """G, the masses of the bodies, and the dimension 2 or 3.
    Raises Skipped for a system without Newton's gravity.
    """
    mass, places = masses(system), [system.split(y)[0] for y in sample_states(system.problem)]
    for space in (2, 3):
        bodies = mass[::space]
        if bodies.size < 2 or mass.size % space or not np.array_equal(np.repeat(bodies, space), mass):
            continue
        found = [-system.potential(q) / _attraction(bodies, q.reshape(-1, space)) for q in places]
        if found[0] > 0 and np.ptp(found) <= 1e-12 * found[0]:  # roundings of sums of few terms
            return float(np.median(found)), bodies, space
    raise Skipped("not bodies under gravity alone, V = −G Σ m_im_j/|q_i − q_j|")


def _attraction(mass: Array, q: Array) -> float:
    """The sum Σ m_im_j/|q_i − q_j| over pairs of bodies at q, (n, 2 or 3)."""
    pairs = combinations(range(mass.size), 2)
    return float(sum(mass[i] * mass[j] / np.linalg.norm(q[i] - q[j]) for i, j in pairs))


def _scheme(name: str, order: int | None, source: str, note: str = "") -> Scheme:
    claims = () if order is None else SYMPLECTIC + REVERSIBLE
    advance = partial(_advance, name, order)
    return integrator(
        f"rebound {name}{note}", advance, order=order, claims=claims, source=f"REBOUND, {source}"
    )


_LEAPFROG = 'LEAPFROG: "It is symplectic. By default it is second order … Higher orders of 4, 6, and 8".'
leapfrog = _scheme("leapfrog", 2, _LEAPFROG)
leapfrog4, leapfrog6, leapfrog8 = (_scheme("leapfrog", k, _LEAPFROG, f", order {k}") for k in (4, 6, 8))
ias15 = _scheme("ias15", None, 'IAS15: "non-symplectic", "in most cases accurate down to machine precision".')
janus = _scheme(
    "janus",
    6,
    'JANUS: "a bit-wise time-reversible high-order symplectic integrator"; its default order is 6.',
)


def _planetary(name: str, order: int | None, claims: tuple[str, ...], source: str, **options: Any) -> Scheme:
    note, advance = (
        "".join(f", {key}={value}" for key, value in options.items()),
        partial(_gravitate, name, options),
    )
    return integrator(
        f"rebound {name}{note}", advance, order=order, claims=claims, source=f"REBOUND, {source}", problems=("planets",)
    )  # fmt: skip


_WHFAST = 'WHFAST: "an implementation of the symplectic [Wisdom & Holman (1991)] integrator", "2nd order WH kernel".'
_SABA = 'SABA: "symplectic integrators".'

PEER = Peer(
    "rebound",
    integrators={
        "leapfrog": leapfrog, "leapfrog4": leapfrog4, "leapfrog6": leapfrog6, "leapfrog8": leapfrog8, "ias15": ias15,
        "janus": janus,
        "whfast": _planetary("whfast", 2, SYMPLECTIC, _WHFAST),
        "whfast-corrected": _planetary("whfast", 2, SYMPLECTIC, _WHFAST, corrector=17),
        "whfast-heliocentric": _planetary("whfast", 2, SYMPLECTIC, _WHFAST, coordinates="democraticheliocentric"),
        "whfast-whds": _planetary("whfast", 2, SYMPLECTIC, _WHFAST, coordinates="whds"),
        "whfast-barycentric": _planetary("whfast", 2, SYMPLECTIC, _WHFAST, coordinates="barycentric"),
        "whfast-lazy": _planetary("whfast", 2, SYMPLECTIC, _WHFAST, kernel="lazy", corrector=17),
        "saba": _planetary("saba", None, SYMPLECTIC, _SABA),
        # MERCURIUS and TRACE change between two integrators. EOS does not, and its source was not
        # read. Nothing is claimed of the three.
        "mercurius": _planetary("mercurius", None, (), 'MERCURIUS: "a hybrid symplectic integrator".'),
        "trace": _planetary("trace", None, (), 'TRACE: "a hybrid (almost) time-reversible integrator".'),
        "eos": _planetary("eos", None, (), "EOS"),
    },
)  # fmt: skip
