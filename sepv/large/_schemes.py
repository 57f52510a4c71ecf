"""Steps of (2.1) and of the midpoint rule (3.4) for one large state y (d,) with the random step Δ."""

from __future__ import annotations

from collections.abc import Callable

from sepv.large._newton import LargeSolution, solve
from sepv.large._problem import LargeProblem
from sepv.problem import Array
from sepv.schemes._energy_preserving import formula as _energy_preserving
from sepv.schemes._midpoint import formula as _midpoint

LargeStep = Callable[[LargeProblem, Array, float], LargeSolution]


def energy_preserving(problem: LargeProblem, y: Array, delta: float) -> LargeSolution:
    """Equation (2.1): see `sepv.schemes.energy_preserving`."""
    return solve(problem, y, _energy_preserving, delta)


def midpoint(problem: LargeProblem, y: Array, delta: float) -> LargeSolution:
    """Equation (3.4): see `sepv.schemes.midpoint`."""
    return solve(problem, y, _midpoint, delta)
