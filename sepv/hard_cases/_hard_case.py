"""The class of hard cases, which are families of steps that are hard to solve,
and helpers to draw such steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sepv.problem import Array, Description, Problem

# The statuses of a step without a solution, by their names in `sepv.core.newton.Status`. The status
# depends on how Newton's iteration ends.
REFUSAL_STATUSES = ("NO_CONVERGENCE", "LEFT_DOMAIN", "OVERFLOW", "SINGULAR")


class Sample(NamedTuple):
    """Random steps of a hard case: M states y (d, M), a step size h for all,
    and increments dW (m, M).
    """

    y: Array
    h: float
    dW: Array


@dataclass(frozen=True, eq=False)
class HardCase:
    """A family of steps that are hard for one stated reason.

    Attributes
    ----------
    name : str
    reason : str
        The difficulty.
    expected : str
        The behaviour of a right solver, and why.
    data : PolynomialSystem or NamedProblem
        The problem as data, which can be sent to other processes; its H is evaluated in extended
        precision.
    sample : (rng, lanes) -> Sample
        Draws M = `lanes` random steps of the family.
    refusals : tuple of str
        The statuses other than CONVERGED that a step of the family may end in.
    laws : tuple of str
        The laws that must hold for every step of the family if the scheme claims them.
    structure : callable, optional
        A structure matrix that replaces that of `data` without a check: it may be not quite skew.
    skewness : float
        The size of the symmetric part of `structure`, which moves H by |Δ| skewness |∇H|².
    """

    name: str
    reason: str
    expected: str
    data: Description
    sample: Callable[[np.random.Generator, int], Sample]
    refusals: tuple[str, ...] = ()
    laws: tuple[str, ...] = ("energy",)
    structure: Callable[[Array], Array] | None = None
    skewness: float = 0.0

    @cached_property
    def problem(self) -> Problem:
        """The problem on which all steps of the hard case are taken."""
        from sepv.problems import build

        problem = build(self.data)
        if self.structure is None:
            return problem
        return replace(problem, structure=self.structure, name=self.name, data=None, check=False)


def sizes(rng: np.random.Generator, low: float, high: float, shape: int | tuple[int, ...]) -> Array:
    """Random numbers of either sign, whose absolute values have a uniform logarithm between `low`
    and `high`.
    """
    exponents = rng.uniform(np.log10(low), np.log10(high), shape)
    values: Array = rng.choice([-1.0, 1.0], shape) * 10.0**exponents
    return values


def split(
    rng: np.random.Generator, low: float, high: float, lanes: int, c: float = 1.0
) -> tuple[float, Array]:
    """A step size h and increments dW (1, lanes) that give random steps Δ = h + c dW with `low`
    ≤ |Δ| ≤ `high`.

    Δ has either sign. As h = `low`/2, a large |Δ| needs an increment dW far in the tail of the
    normal distribution.
    """
    h = 0.5 * low
    return h, (sizes(rng, low, high, (1, lanes)) - h) / c


Sampler = Callable[[np.random.Generator, int], Sample]


def steps(
    low: float, high: float, states: Callable[[np.random.Generator, int], Array], c: float = 1.0
) -> Sampler:
    """Make a sampler: it draws `lanes` states (d, lanes) by `states`,
    and Δ with `low` ≤ |Δ| ≤ `high` by `split`.
    """
    return lambda rng, lanes: Sample(states(rng, lanes), *split(rng, low, high, lanes, c))


def box(d: int, low: float, high: float) -> Sampler:
    """Make a sampler: it draws components of y between −1.5 and 1.5,
    and Δ with `low` ≤ |Δ| ≤ `high` by `split`.
    """
    return steps(low, high, lambda rng, lanes: rng.uniform(-1.5, 1.5, (d, lanes)))
