"""The closed orbit of the flow y′ = B(y)∇H(y) through a given state, with its period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sepv.exact._dense_flow import FlowFailure
from sepv.exact._flow import exact_flow
from sepv.problem import Array, Problem, vector_field

# The number of states along an orbit. They resolve harmonics up to half of this number.
PHASES = 64
# The longest time within which an orbit must close, in units of |y|/|f| with the field f = B∇H.
CLOSING_MAX_TIME = 512.0


@dataclass(frozen=True)
class Orbit:
    """A closed orbit of the flow: its period, and states (d, PHASES)
    that are equally spaced in time.
    """

    period: float
    states: Array


def closed_orbit(problem: Problem, y0: Array) -> Orbit | None:
    """The closed orbit of a problem's flow through y0;
    None if it does not close within CLOSING_MAX_TIME |y0|/|f|.

    The orbit closes when it crosses the plane through y0 normal to f = f(y0), in the direction of f
    and close to y0.
    """
    f = vector_field(problem, y0)
    speed, size = float(np.linalg.norm(f)), float(np.linalg.norm(y0))
    if not speed or not size:
        return None
    reach = 8 * size / speed
    while reach <= CLOSING_MAX_TIME * size / speed:
        times = np.linspace(0, reach, 512)
        try:
            moved = exact_flow(problem, times, y0).y - y0[:, None]
        except FlowFailure:
            return None
        ahead, near = f @ moved, np.linalg.norm(moved, axis=0) < 0.25 * size
        back = np.flatnonzero((ahead[1:-1] < 0) & (ahead[2:] >= 0) & near[2:])
        if back.size:
            first = back[0] + 1
            period = float(times[first]) + _return(problem, y0 + moved[:, first], y0, f, float(times[1]))
            return Orbit(period, exact_flow(problem, period * np.arange(PHASES) / PHASES, y0).y)
        reach *= 2
    return None


def _return(problem: Problem, start: Array, y0: Array, f: Array, longest: float) -> float:
    """The time in [0, longest] at which the flow from `start` crosses the plane through y0 with the
    normal f.

    Newton's method needs few steps, because near y0 the distance f·(y − y0) rises at the rate
    f·f(y) > 0. The iteration stops when a time repeats.
    """
    time, seen = 0.0, set()
    while time not in seen:
        seen.add(time)
        y = exact_flow(problem, time, start).y.reshape(-1)
        time = min(max(time - float(f @ (y - y0) / (f @ vector_field(problem, y))), 0.0), longest)
    return time
