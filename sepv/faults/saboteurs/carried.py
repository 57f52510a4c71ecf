"""Faults of schemes that keep a state along a path: single steps are right or nearly so,
but paths are wrong.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from sepv import schemes
from sepv.core.formula import Fields
from sepv.problem import Array, Problem, matvec, mechanics
from sepv.schemes import StatefulStep, Step, as_lanes, energy_preserving, implicit

from .formula import with_structure
from .record import Family, claiming, imitating, middle

FAMILY = Family("carried state")
_right = energy_preserving.step
_midpoint = schemes.midpoint.step
_AVERAGE_LAWS = ("casimir", "reference", "midpoint")


def _begun(_: Problem, y: Array) -> Any:
    return (y.copy(),)


def _shared(buffer: dict[Any, Array]) -> StatefulStep:
    """A step that keeps the states y of all paths in one buffer,
    so that one path overwrites the other's state.
    """

    def init(_: Problem, y: Array) -> Array:
        state = buffer.setdefault(y.shape, np.empty(y.shape))
        state[...] = y
        return state

    def step(problem: Problem, state: Array, h: float, dW: Array) -> Array:
        return init(problem, _right(problem, state, h, dW))

    return StatefulStep(init, step, np.copy)


def _overwritten(problem: Problem, state: Any, h: float, dW: Array) -> Any:
    state[0][...] = _right(problem, state[0], h, dW)
    return state


def _stale(problem: Problem, state: Any, h: float, dW: Array) -> Any:
    """Move by Δ times the rate (y1 − y0)/Δ of the step before;
    the first step of a path uses its own rate.
    """
    y, *before = state
    delta = problem.random_step(h, dW)
    with np.errstate(all="ignore"):
        rate = (_right(problem, y, h, dW) - y) / delta
    if not np.all(np.isfinite(rate)):
        return _right(problem, y, h, dW), *before
    return y + delta * (before[0] if before else rate), rate


def _first(state: Any) -> Array:
    return np.asarray(state[0])


def _once(right: Step, problem: Problem, state: Any, h: float, dW: Array) -> Any:
    """The first step of a path is right, and later ones return their state."""
    y, *stepped = state
    return state if stepped else (right(problem, y, h, dW), True)


def _frozen(right: Step) -> StatefulStep:
    return StatefulStep(_begun, partial(_once, right), _first)


def _later(first: int, wrong: Step, problem: Problem, state: Any, h: float, dW: Array) -> Any:
    """From the step with the number `first` on the step `wrong` is made; steps are numbered
    from 1.
    """
    y, number = state
    return (_right if number < first else wrong)(problem, y, h, dW), number + 1


def _from(first: int, wrong: Step) -> StatefulStep:
    return StatefulStep(lambda _problem, y: (y.copy(), 1), partial(_later, first, wrong), _first)


_B_OFF_THE_MIDDLE = implicit(with_structure(lambda fields, y, z: fields.structure(y + (0.5 + 1e-6) * z)))


def _extrapolated(problem: Problem, state: Any, h: float, dW: Array) -> Any:
    """B is taken at y + ½z, with the increment z of the step before, from the second step on."""
    y, *before = state
    if not before:
        y1 = _right(problem, y, h, dW)
        return y1, y1 - y

    def increment(fields: Fields, y: Any, z: Any, step: Any) -> Any:
        B = problem.structure(
            middle(*as_lanes(problem, state[0], h, dW)[:1], state[1].reshape(len(state[0]), -1))
        )
        return step[0] * matvec(B, fields.mean_gradient(y, z))

    y1 = implicit(increment)(problem, y, h, dW)
    return y1, y1 - y


def _at_start(problem: Problem, y: Array) -> Any:
    system = mechanics(problem)
    return y.copy(), system.force(system.split(y)[0])


def _late_force(problem: Problem, state: Any, h: float, dW: Array) -> Any:
    """Velocity Verlet whose second kick is made with the force at the beginning of the step."""
    system, (y, force), delta = mechanics(problem), state, problem.random_step(h, dW)
    q, p = system.split(y)
    p = p + 0.5 * delta * force
    q = q + delta * system.velocity(p)
    return system.join(q, p + 0.5 * delta * force), system.force(q)


def _kept_for_long(problem: Problem, state: Any, h: float, dW: Array) -> Any:
    """Velocity Verlet that begins each step after the first with the force at the beginning of the
    step before.
    """
    system, (y, force, *stale), delta = mechanics(problem), state, problem.random_step(h, dW)
    q, p = system.split(y)
    p = p + 0.5 * delta * (stale[0] if stale else force)
    q = q + delta * system.velocity(p)
    last = system.force(q)
    return system.join(q, p + 0.5 * delta * last), last, force


def _summed_over_paths(problem: Problem, state: Any, h: float, dW: Array) -> Any:
    """(2.1) with compensated summation, whose lost roundings are added up over all paths of a
    batch.
    """
    y, lost = state
    assert energy_preserving.solve is not None
    solution = energy_preserving.solve(problem, *_lanes(problem, y, h, dW))
    if np.any(solution.status):
        return _right(problem, y, h, dW), lost  # raises the refusal
    wanted = solution.change + lost.reshape(len(y), -1)
    y1 = y + wanted.reshape(y.shape)
    rest = np.sum(wanted.reshape(y.shape) - (y1 - y), axis=-1 if y.ndim == 2 else (), keepdims=True)
    return y1, np.broadcast_to(rest, y.shape)


def _lanes(problem: Problem, y: Array, h: float, dW: Array) -> tuple[Array, float, Array]:
    state, noise = as_lanes(problem, y, h, dW)
    return state, h, noise


FAMILY.rows(
    ("state-of-all-paths", "all paths keep their state in one place", ("contract",),
     lambda: claiming(_shared({}))),
    ("changes-its-state", "the state is changed in place", ("contract",),
     lambda: claiming(StatefulStep(_begun, _overwritten, lambda state: state[0].copy()))),
    ("stale-rate", "from its second step on a path moves by the rate of the step before",
     ("energy", "mean-square-order", "right-limit"),
     lambda: claiming(StatefulStep(_begun, _stale, _first), batched=False)),
    ("midpoint-once", "the second step of a path and all later ones return their state",
     ("midpoint", "mean-square-order", "right-limit"),
     imitating(schemes.midpoint, _frozen(_midpoint), batched=False)),
    ("leapfrog-once", "the second step of a path and all later ones return their state",
     ("deterministic-order",), imitating(schemes.by_name("leapfrog"), _frozen(schemes.by_name("leapfrog").step),
                                         batched=False)),
    ("late-force", "the second kick of a step has the force of the step before",
     ("deterministic-order", "symmetry", "poisson-map:constant", "volume"),
     imitating(schemes.by_name("leapfrog"), StatefulStep(_at_start, _late_force, _first))),
    ("force-kept-too-long", "from its second step on a path begins a step with the force of the step before",
     ("deterministic-order", "poisson-map:constant"),
     imitating(schemes.by_name("leapfrog"), StatefulStep(_at_start, _kept_for_long, _first), batched=False)),
    ("extrapolated-middle", "from its second step on a path has B at an extrapolated midpoint", _AVERAGE_LAWS,
     lambda: claiming(StatefulStep(_begun, _extrapolated, _first), batched=False)),
    ("off-the-middle-later", "from its fifth step on a path has B off the middle by 1e-6", _AVERAGE_LAWS,
     lambda: claiming(_from(5, _B_OFF_THE_MIDDLE))),
    ("roundings-of-all-paths", "compensated summation adds up the roundings of all paths", ("reproducibility",),
     lambda: claiming(StatefulStep(lambda _, y: (y.copy(), 0 * y), _summed_over_paths, _first))),
)  # fmt: skip
