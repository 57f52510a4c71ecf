"""Right methods that carry a state along a path: several steps, momenta at half steps, roundings,
stored forces.

Orders are those of the error at a fixed time. The first step of a two-step method that Euler's rule
starts has a lower order (Hairer, Nørsett and Wanner, *Solving Ordinary Differential Equations I*,
III.1 and III.9).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from sepv.problem import Array, Problem, mechanics, vector_field
from sepv.schemes import PathSolver, Scheme, StatefulStep, Systems, as_lanes, energy_preserving


def _first(state: Any) -> Array:
    return np.asarray(state[0])


def _adams_bashforth(problem: Problem, state: Any, h: float, _dW: Array) -> Any:
    """AB2: y_(n+1) = y_n + h(3f_n − f_(n−1))/2; without f_(n−1) Euler's rule."""
    y, before = state
    f = vector_field(problem, y)
    return y + (h * f if before is None else 0.5 * h * (3 * f - before)), f


def _with_a_step_back(problem: Problem, y: Array, h: float) -> Any:
    """The state of AB2 at y whose f_(n−1) comes from a step −h of Heun's method."""
    f = vector_field(problem, y)
    return y.copy(), vector_field(problem, y - 0.5 * h * (f + vector_field(problem, y - h * f)))


def _adams_bashforth_paths(problem: Problem, y0: Array, h: float, dW: Array) -> Array:
    """Paths of AB2, started by Euler's rule."""
    states = [(np.repeat(y0[:, None], dW.shape[2], axis=1), None)]
    for row in dW:
        states.append(_adams_bashforth(problem, states[-1], h, row))
    return np.array([y for y, _ in states])


def _two_steps(problem: Problem, y: Array, h: float) -> Any:
    """The state (y_n, y_(n−1), 2hf_n) of y_(n+1) = y_(n−1) + 2hf_n, started by Euler's rule."""
    push = h * vector_field(problem, y)
    return y.copy(), y - push, 2 * push


def _over_two(problem: Problem, state: Any, h: float, _dW: Array) -> Any:
    y, before, push = state
    y1 = before + push
    return y1, y, 2 * h * vector_field(problem, y1)


def _two_steps_back(state: Any) -> Any:
    """The same y_n, with y_(n+1) as the state before it and steps −h."""
    y, before, push = state
    return y, before + push, -push


def _staggered(problem: Problem, y: Array, h: float) -> Any:
    """The state (q_n, p_(n−½), hF_n) of the leapfrog with momenta at half steps."""
    system = mechanics(problem)
    q, p = system.split(y)
    push = h * system.force(q)
    return y.copy(), q, p - 0.5 * push, push


def _leap(problem: Problem, state: Any, h: float, _dW: Array) -> Any:
    """p_(n+½) = p_(n−½) + hF_n, q_(n+1) = q_n + hv(p_(n+½)); y has p_n = p_(n−½) + ½hF_n."""
    system, (_, q, p, push) = mechanics(problem), state
    p = p + push
    q = q + h * system.velocity(p)
    push = h * system.force(q)
    return system.join(q, p + 0.5 * push), q, p, push


def _compensated(problem: Problem, state: Any, h: float, dW: Array) -> Any:
    """(2.1) with Kahan's compensated summation: the rounding of each sum is added to the next
    increment.
    """
    y, lost = state
    assert energy_preserving.solve is not None
    lanes, noise = as_lanes(problem, y, h, dW)
    solution = energy_preserving.solve(problem, lanes, h, noise)
    if not np.all(solution.status == 0):
        return energy_preserving.step(problem, y, h, dW), 0 * y  # raises the refusal
    wanted = solution.change.reshape(y.shape) + lost
    y1 = y + wanted
    taken = y1 - y
    return y1, (y - (y1 - taken)) + (wanted - taken)


def _verlet(problem: Problem, state: Any, h: float, _dW: Array) -> Any:
    """Velocity Verlet that stores its force."""
    system, (y, force) = mechanics(problem), state
    q, p = system.split(y)
    p = p + 0.5 * h * force
    q = q + h * system.velocity(p)
    force = system.force(q)
    return system.join(q, p + 0.5 * h * force), force


def _at_rest(problem: Problem, y: Array) -> Any:
    system = mechanics(problem)
    return y.copy(), system.force(system.split(y)[0])


def _signed(state: Any, rho: Array | None) -> Any:
    """The stored force stays as it is if momenta change their signs."""
    y, force = state
    return (y if rho is None else (rho * y.T).T), force


_EULER = StatefulStep(lambda _problem, y: (y.copy(), None), _adams_bashforth, _first)
_MECHANICAL: dict[str, Any] = {"order": 2.0, "systems": Systems.MECHANICAL, "noise": False, "batched": True}
_LEAPFROG_LAWS = (
    "poisson-map:constant",
    "volume",
    "symmetry",
    "reversibility",
    "long-time-energy",
    "reproducibility",
)
SCHEMES_WITH_MEMORY: tuple[Scheme, ...] = (
    Scheme("adams-bashforth-2", _EULER, ("equivariance", "reproducibility"), "AB2 after a step of Euler's rule",
           order=2.0, batched=True),
    Scheme("adams-bashforth-2-by-paths", PathSolver(_adams_bashforth_paths), ("equivariance",),
           "AB2 as a solver of whole paths", order=2.0),
    Scheme("adams-bashforth-2-started-back", StatefulStep(_with_a_step_back, _adams_bashforth, _first),
           ("equivariance", "reproducibility"), "AB2 that starts with a step −h", order=2.0, batched=True),
    Scheme("explicit-midpoint", StatefulStep(_two_steps, _over_two, _first, _two_steps_back),
           ("symmetry", "equivariance", "reproducibility"), "the two-step midpoint rule (GNI XV.1)", order=2.0,
           batched=True),
    Scheme("staggered-leapfrog", StatefulStep(_staggered, _leap, _first), _LEAPFROG_LAWS,
           "leapfrog with momenta at half steps", **_MECHANICAL),
    Scheme("stored-force", StatefulStep(_at_rest, _verlet, _first), _LEAPFROG_LAWS, "velocity Verlet", **_MECHANICAL),
    Scheme("stored-force-reversed", StatefulStep(_at_rest, _verlet, _first, _signed), _LEAPFROG_LAWS, "velocity Verlet",
           **_MECHANICAL),
    replace(energy_preserving, name="compensated", source="(2.1) with compensated summation", solve=None,
            step=StatefulStep(lambda _problem, y: (y.copy(), 0 * y), _compensated, _first)),
)  # fmt: skip
