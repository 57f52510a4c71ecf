"""Orbits on which a symplectic or reversible method keeps the energy up to O(h^p) over long times.

Systems with one degree of freedom are integrable. A symplectic method has a modified Hamiltonian
H̃ = H + h^p H_{p+1} + …, which it keeps up to exp(−c/h) (Hairer, Lubich and Wanner,
*Geometric Numerical Integration*, IX, Theorem 8.1). For a reversible method, the reversal ρ of
momenta reverses its modified equation. Then a solution that meets p = 0 twice is closed (V.1 and
XI). Both apply to the orbits here: B is constant, ρ reverses the flow, and the momentum changes
sign.

Problems with two degrees of freedom are two such systems in new variables q = S⁻¹Q, p = SᵀP, with a
full mass matrix and a potential that couples the q_i. Runge-Kutta methods and compositions of kicks
and drifts commute with linear maps of q. So both systems stay uncoupled in (Q, P). The golden ratio
of their frequencies excludes a resonance (XIII).

A rigid body or spin, y′ = s y × ∇H(y) with a constant s, is also integrable: y moves on a
sphere, whose dimension is two, and a Poisson map is symplectic there. If H(ρy) = H(y) for a
reflection ρ = 1 − 2vvᵀ, then ρ reverses the flow, because ρ(a × b) = −ρa × ρb. For H = ½ yᵀI⁻¹y
each principal axis is such a v. As with momenta, v·y must change sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache, lru_cache, partial
from random import Random
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sepv.properties._reversal import mirrors, momentum_flip, turning

from sepv import problems
from sepv.errors import Skipped
from sepv.exact import PHASES, closed_orbit
from sepv.law.cases.case import quiet_problem
from sepv.law.cases.families import body
from sepv.problem import (
    Array,
    HamiltoniansProblem,
    PolynomialSystem,
    Problem,
    Systems,
    energy_change,
)
from sepv.problems import canonical, started
from sepv.record import poly

Indices = NDArray[np.signedinteger[Any]]
# Numbers of steps in a period at the largest step size: ωh = 0.42 and 0.45, a fifth of the
# leapfrog's stability limit.
STEPS_IN_PERIOD = (15, 14)
GOLDEN_RATIO = (1 + 5**0.5) / 2
# The largest share of harmonics k of an orbit for which k is at least the number of steps in a
# period. They look slow.
HARMONICS_TAIL = 1e-4
# The largest number of steps in a period of a user's orbit: PHASES states resolve harmonics below
# half their number.
PERIOD_MAX_STEPS = PHASES // 2
# The largest number of times that a body may turn in a period of its orbit.
BODY_MAX_TURNS = 8

# The sign of B, 1 for y = (q, p) and −1 for y = (p, q), and the built-in pendulum in these
# variables.
_PENDULUM_FORMS = {
    Systems.SINGLE: (-1.0, "pendulum"),
    Systems.CANONICAL_SEPARABLE: (-1.0, "pendulum"),
    Systems.MECHANICAL: (1.0, "pendulum-chain"),
}
_WELL_NAMES = ("", "one well", "two coupled wells")


@dataclass(frozen=True, eq=False)
class Orbits:
    """States (d, M) on orbits of a problem, the longest period,
    and its number of steps at the largest step size.
    """

    name: str
    problem: Problem
    states: Array
    period: float
    steps: int
    reversed_axes: Array  # the directions (d, k) whose components the reversal ρ changes in sign

    @property
    def h(self) -> float:
        """The largest step size."""
        return self.period / self.steps

    @property
    def kinetic(self) -> float:
        """The largest kinetic energy on the orbit: the range of H at the orbit's states without the
        reversed part.
        """
        Q = self.reversed_axes
        resting = self.states - Q @ (Q.T @ self.states)
        first = np.broadcast_to(resting[:, :1], resting.shape)
        return float(np.ptp(energy_change(self.problem, first, resting)))

    def of(self, paths: int) -> Array:
        """Return `paths` of the states, (d, paths), spread over the orbit."""
        return self.states[:, :: max(1, self.states.shape[1] // paths)][:, :paths]


class Well(NamedTuple):
    """A Hamiltonian ½μP² + (ω²/μ)(½Q² + aQ³/3 + bQ⁴/4) with one well (a² < 4b),
    and the start P = 0, Q = size.
    """

    frequency: float
    inverse_mass: float
    a: float
    b: float
    size: float


def orbits_of_class(systems: Systems, seed: int) -> tuple[Orbits, ...]:
    """Return orbits for schemes of a class, or () if there are none.

    The orbits are those of a well, the pendulum and two coupled wells, or of two rigid bodies or a
    body and a spin.
    """
    if systems in _BODY_STATES:
        found = (users_orbits(make()) for make in _BODY_STATES[systems])
        several = systems is Systems.MATRIX_HAMILTONIANS
        return tuple(replace(own, problem=_of_fields(own.problem)) if several else own for own in found)
    if systems not in _PENDULUM_FORMS:
        return ()
    sign, name = _PENDULUM_FORMS[systems]
    random = Random(seed)
    first = _well(random, random.choice((0.5, 1.0, 2.0)))
    slow = _well(random, 1.0)
    pair = slow, _well(random, GOLDEN_RATIO)
    shears = ([[1, 0], [1, 1]], [[1, -1], [0, 1]], [[1, 0], [-1, 1]], [[1, 1], [0, 1]])
    many = random.choice(STEPS_IN_PERIOD)
    pendulum = problems.pendulum() if name == "pendulum" else problems.pendulum_chain(links=1)
    return (
        coupled((first,), [[1]], sign, many),
        users_orbits(quiet_problem(pendulum)),
        coupled(pair, random.choice(shears), sign, int(np.ceil(GOLDEN_RATIO * many))),
    )


def _well(random: Random, frequency: float) -> Well:
    a, b = random.choice((0.25, 0.375, 0.5)), random.choice((0.25, 0.375, 0.5))
    inverse_mass = random.choice((0.5, 1.0, 2.0))
    return Well(frequency, inverse_mass, random.choice((a, -a)), b, random.choice((0.625, 0.75, 0.875)))


def coupled(wells: Sequence[Well], S: Sequence[Sequence[int]], sign: float, steps: int) -> Orbits:
    """Couple wells by q = S⁻¹Q, p = SᵀP with an integer S, det S = 1: y = (q, p) for sign 1,
    y = (p, q) for −1.
    """
    n, R = len(wells), np.rint(np.linalg.inv(S))
    zero, H = [0.0] * n, []
    for k, well in enumerate(wells):
        q, p = list(map(float, S[k])), R[:, k].tolist()
        Q, P = (poly.linear([*q, *zero]), poly.linear([*zero, *p])) if sign > 0 else (
            poly.linear([*zero, *q]), poly.linear([*p, *zero]))  # fmt: skip
        square, stiffness = poly.multiply(Q, Q), well.frequency**2 / well.inverse_mass
        H += [
            poly.scale(well.inverse_mass / 2, poly.multiply(P, P)),
            poly.scale(stiffness / 2, square),
            poly.scale(stiffness * well.a / 3, poly.multiply(square, Q)),
            poly.scale(stiffness * well.b / 4, poly.multiply(square, square)),
        ]
    system = PolynomialSystem(2 * n, poly.add(*H), canonical(2 * n, sign), ())
    moved = [_moved(well, (5 * k + (2 * k + 1) * np.arange(PHASES)) % PHASES) for k, well in enumerate(wells)]
    position, momentum = R @ [own[1] for own in moved], np.transpose(S) @ [own[2] for own in moved]
    states = np.concatenate([position, momentum] if sign > 0 else [momentum, position])
    axes = np.eye(2 * n)[:, n:] if sign > 0 else np.eye(2 * n)[:, :n]
    return Orbits(_WELL_NAMES[n], problems.build(system), states, max(own[0] for own in moved), steps, axes)


def _moved(well: Well, phases: Indices) -> tuple[float, Array, Array]:
    """Return a well's period, and Q, P at `phases`, by the orbit with ω = μ = 1 in the time s = ωt:
    P = (ω/μ)dQ/ds.
    """
    period, q, p = _orbit(well.a, well.b, well.size)
    return period / well.frequency, q[phases], well.frequency / well.inverse_mass * p[phases]


@lru_cache(maxsize=64)
def _orbit(a: float, b: float, size: float) -> tuple[float, Array, Array]:
    H = {(2, 0): 0.5, (0, 2): 0.5, (3, 0): a / 3, (4, 0): b / 4}
    problem = problems.build(PolynomialSystem(2, poly.polynomial(2, H), canonical(2, 1.0), ()))
    orbit = closed_orbit(problem, np.array([size, 0.0]))
    assert orbit is not None
    return orbit.period, orbit.states[0], orbit.states[1]


@lru_cache(maxsize=32)
def users_orbits(problem: Problem) -> Orbits:
    """Return the orbit of a problem without noise through its initial state.

    Raise Skipped if the theory does not apply, or if the orbit has too many harmonics.
    """
    flip, found = (momentum_flip(problem) if problem.dimension == 2 else None), mirrors(problem)
    if problem.initial is None or (problem.dimension != 2 and not found):
        raise Skipped(
            "theory speaks of one degree of freedom, or a rigid body or spin with a mirror, from an initial state: "
            "others may be chaotic"
        )
    if flip is None and not found:
        raise Skipped("the reversal of momenta does not reverse the flow: reversible methods may drift")
    start = np.array(problem.initial, dtype=np.float64)
    orbit = closed_orbit(problem, start)
    if orbit is None:
        raise Skipped("no closed orbit was found through the initial state")
    axes = found if flip is None else [row for row, sign in zip(np.eye(2), flip, strict=True) if sign < 0]
    crossing = [v for v in axes if (v @ orbit.states).min() < 0 < (v @ orbit.states).max()]
    if not crossing:
        raise Skipped("the momentum keeps its sign along the orbit: reversible methods may drift")
    if flip is not None and np.ptp(problem.structure(orbit.states), axis=-1).any():
        raise Skipped("B is not constant: symplectic methods keep no modified energy")
    slopes = problem.gradient(orbit.states)
    sizes = np.max(np.abs(np.fft.rfft(slopes, axis=1)), axis=0)
    tails = np.cumsum(sizes[::-1])[::-1] / np.sum(sizes)
    resolved = [n for n in range(STEPS_IN_PERIOD[0], PERIOD_MAX_STEPS + 1) if tails[n - 1] <= HARMONICS_TAIL]
    # A body turns by |s∇H|h in a step, and more often than its orbit closes.
    speed = abs(turning(problem, [start]) or 0.0) if flip is None else 0.0
    turns = speed * float(np.max(np.linalg.norm(slopes, axis=0))) * orbit.period / (2 * np.pi)
    steps = max([*resolved[:1], int(np.ceil(turns * STEPS_IN_PERIOD[0]))])
    if not resolved or steps > BODY_MAX_TURNS * STEPS_IN_PERIOD[0]:
        raise Skipped(
            f"the orbit is too sharp for {PERIOD_MAX_STEPS} steps in a period, or has more than {BODY_MAX_TURNS} turns"
        )
    return Orbits(problem.name, problem, orbit.states, orbit.period, steps, np.stack(crossing[:1], axis=1))


def _body(quaternion: tuple[float, ...], field: float = 0.0) -> Problem:
    """A rigid body without noise, or with a `field` b, H = ½ yᵀI⁻¹y + b y_3,
    a spin in a field normal to two axes.
    """
    data = body((1.0, 0.5, 0.25), quaternion, ())
    if field:
        data = replace(data, hamiltonian=poly.add(data.hamiltonian, poly.linear([0.0, 0.0, field])))
    name = (
        "a spin" if field else "a rigid body" if quaternion[1:] == _AXES[1:] else "a rigid body in other axes"
    )
    return quiet_problem(started(data, name, (0.75, 0.5, 0.25)))


@lru_cache(maxsize=2)
def _of_fields(body: Problem) -> Problem:
    """The body as a problem of several Hamiltonians with no noise,
    for schemes that read the noises' Hamiltonians.
    """
    kept = {f.name: getattr(body, f.name) for f in fields(Problem) if f.init and f.name != "data"}
    return HamiltoniansProblem(**kept, check=False)


# Quaternions of the axes of bodies.
_AXES, _OTHER_AXES = (1.0, 0.0, 0.0, 0.0), (5.0, 1.0, -2.0, 1.0)
_turned, _principal, _spin = (cache(partial(_body, *of)) for of in ((_OTHER_AXES,), (_AXES,), (_AXES, 0.5)))
_BODY_STATES = {
    Systems.RIGID_BODIES: (_principal, _turned),
    Systems.PRINCIPAL_BODIES: (_principal,),
    Systems.LIE_POISSON: (_turned, _spin),
    Systems.MATRIX_HAMILTONIANS: (_turned, _spin),
}
