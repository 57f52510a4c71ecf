"""Faults of schemes that keep a state along a path: single steps are right or nearly so, but paths are wrong."""

from __future__ import annotations

from typing import Any

import numpy as np

from sepv.problem import Array, Problem
from sepv.schemes import energy_preserving
from sepv.schemes._stateful import StatefulStep

from .record import Family, claiming

SABOTEURS = Family("carried state")
_right = energy_preserving.step


def _begun(_: Problem, y: Array) -> Any:
    return (y.copy(),)


def _shared(buffer: dict[Any, Array]) -> StatefulStep:
    """A step that keeps the states y of all paths in one buffer, so that one path overwrites the other's state."""

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
    """Move by Δ times the rate (y1 − y0)/Δ of the step before; the first step of a path uses its own rate."""
    y, *before = state
    delta = problem.random_step(h, dW)
    with np.errstate(all="ignore"):
        rate = (_right(problem, y, h, dW) - y) / delta
    if not np.all(np.isfinite(rate)):
        return _right(problem, y, h, dW), *before
    return y + delta * (before[0] if before else rate), rate


def _first(state: Any) -> Array:
    return np.asarray(state[0])


SABOTEURS.rows(
    ("state-of-all-paths", "all paths keep their state in one place", ("contract",),
     lambda: claiming(_shared({}))),
    ("changes-its-state", "the state is changed in place", ("contract",),
     lambda: claiming(StatefulStep(_begun, _overwritten, lambda state: state[0].copy()))),
    ("stale-rate", "from its second step on a path moves by the rate of the step before",
     ("energy", "mean-square-order", "right-limit"),
     lambda: claiming(StatefulStep(_begun, _stale, _first), batched=False)),
)  # fmt: skip
