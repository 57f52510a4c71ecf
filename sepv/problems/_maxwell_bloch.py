"""The Maxwell-Bloch equations of laser-matter dynamics for real fields, a polynomial system with two invariants.

y1′ = y2, y2′ = y1y3, y3′ = −y1y2 is ∇C × ∇H with H = ½y1² + y3 and C = ½(y2² + y3²): B(y)v = −v × ∇C(y). D. David
and D. Holm, Multiple Lie-Poisson structures, reductions, and geometric phases for the Maxwell-Bloch travelling wave
equations (J. Nonlinear Sci. 2, 1992).
"""

from __future__ import annotations

from collections.abc import Sequence

from sepv.problem import Problem
from sepv.problems._nambu_system import nambu_system
from sepv.problems._polynomial_system import started
from sepv.record import _polynomial as poly


def maxwell_bloch(noise: Sequence[float] = (0.5,)) -> Problem:
    """The system from (1, 0.5, 0.5)."""
    H, C = poly.add(poly.squares((1, 0, 0)), poly.variable(3, 2)), poly.squares((0, 1, 1))
    data = nambu_system(H, poly.constant(3, -1.0), C, tuple(noise))
    return started(data, "maxwell-bloch", (1.0, 0.5, 0.5))
