"""The record of a hard case (a family of steps that are hard to solve), and helpers that draw its random steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sepv.problem import Array, Description, Problem

# The statuses of a step without a solution, by their names in `sepv.solve.Status`. The status depends on how Newton's
# iteration ends.
REFUSALS = ("NO_CONVERGENCE", "LEFT_DOMAIN", "OVERFLOW", "SINGULAR")


class Sample(NamedTuple):
    """Random steps of a hard case: states y (d, M), one h for all of them, and increments dW (m, M)."""

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
        The problem as data, which can be sent to other processes; its H is evaluated in extended precision.
    sample : (rng, lanes) -> Sample
        Draws `lanes` random steps of the family.
    refusals : tuple of str
        The statuses other than CONVERGED that a step of the family may end in.
    laws : tuple of str
        The laws that hold for every step of the family, with whatever solver.
    structure : callable, optional
        A structure matrix that replaces the one of `data` without a check, for a B that is not quite skew.
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
        """The problem of every step of the family."""
        from sepv.problems import build

        problem = build(self.data)
        if self.structure is None:
            return problem
        return replace(problem, structure=self.structure, name=self.name, data=None, check=False)


def sizes(rng: np.random.Generator, low: float, high: float, shape: int | tuple[int, ...]) -> Array:
    """Random numbers of either sign, whose absolute values are spread evenly over the decades from `low` to `high`."""
    exponents = rng.uniform(np.log10(low), np.log10(high), shape)
    values: Array = rng.choice([-1.0, 1.0], shape) * 10.0**exponents
    return values


def split(
    rng: np.random.Generator, low: float, high: float, lanes: int, c: float = 1.0
) -> tuple[float, Array]:
    """A step size h and increments dW (1, lanes) for random steps Δ = h + c dW of given size.

    Δ has either sign and a size between `low` and `high`. h is `low`/2, so that dW is far out in the tail of the noise.
    """
    h = 0.5 * low
    return h, (sizes(rng, low, high, (1, lanes)) - h) / c


Sampler = Callable[[np.random.Generator, int], Sample]


def steps(
    low: float, high: float, states: Callable[[np.random.Generator, int], Array], c: float = 1.0
) -> Sampler:
    """The sampler of a hard case that takes random states (d, lanes), and random steps Δ as in `split`."""
    return lambda rng, lanes: Sample(states(rng, lanes), *split(rng, low, high, lanes, c))


def box(d: int, low: float, high: float) -> Sampler:
    """The sampler of a hard case that takes states with components in ±1.5, and random steps Δ as in `split`."""
    return steps(low, high, lambda rng, lanes: rng.uniform(-1.5, 1.5, (d, lanes)))
