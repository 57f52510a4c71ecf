"""Faults of schemes for damped systems: each claims what *conformal* claims,
and breaks a law of decay or symmetry.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from sepv.problem import Array, Problem
from sepv.schemes import Scheme, conformal, energy_preserving, midpoint

from .record import Family

FAMILY = Family("damping")


@FAMILY.like(
    conformal,
    "the midpoint rule between the exponentials: Casimirs decay rightly, a quartic energy does not",
    ("invariant:energy",),
)
def damped_midpoint(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return _between(problem, y, h, dW, midpoint)


@FAMILY.like(
    conformal,
    "the factors 1 − γh/2 and 1/(1 + γh/2) in the place of exponentials, the damping of a midpoint rule",
    ("invariant:casimir", "invariant:energy"),
)
def damped_rationally(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    share = 0.5 * h * getattr(problem, "damping", 0.0)
    return _between(problem, y, h, dW, energy_preserving, 1 - share, 1 / (1 + share))


@FAMILY.like(
    replace(conformal, order=2.0),
    "all of the damping comes first: Lie's composition, of order 1 without noise, where 2 is claimed",
    ("symmetry", "deterministic-order"),
)
def damped_at_once(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return _between(problem, y, h, dW, energy_preserving, np.exp(-h * getattr(problem, "damping", 0.0)), 1.0)


def _between(
    problem: Problem, y: Array, h: float, dW: Array, scheme: Scheme, first: float = 0.0, last: float = 0.0
) -> Array:
    """Multiply y by `first` before and `last` after the undamped step; 0 stands for e^(−γh/2)
    with the damping γ.
    """
    conformal.step(problem, y, 0.0, 0 * dW)  # raises for problems that the scheme refuses
    half = float(np.exp(-0.5 * h * getattr(problem, "damping", 0.0)))
    quiet = Problem(**{f.name: getattr(problem, f.name) for f in fields(Problem) if f.init}, check=False)
    return (last or half) * scheme.step(quiet, (first or half) * y, h, dW)
