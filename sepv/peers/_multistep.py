"""Solvers that hand state from one step to the next: one step alone is not the solver, so whole paths are measured.

Their first step is a `Scheme` beside them, for the laws about one step; the order is that of whole paths.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from sepv.problem import Array, Problem

# (problem, y0 (d,), h, dW (N, m, M)) -> states (N + 1, d, M)
Path = Callable[[Problem, Array, float, Array], Array]


@dataclass(frozen=True)
class PathSolver:
    """A solver of whole paths, and the order that its documentation states for noise that commutes."""

    name: str
    path: Path
    mean_square_order: float
    source: str = ""
