"""Hypothesis strategies for random skew B(y), polynomial H, systems with Casimirs,
and steps that have a solution.

The laws draw such systems too (`sepv.law.cases.random_cases`). All coefficients are small dyadic
rationals. Products and sums of a few of them are exact in binary64, so that the coefficients of a
Casimir satisfy its definition exactly and a defect is due to the scheme.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from random import Random
from typing import TypeVar

from hypothesis import strategies as st

from sepv import problems
from sepv.law.cases import random_parts as parts
from sepv.law.cases.case import Case
from sepv.law.cases.classes import CLASSES
from sepv.law.cases.from_problem import near
from sepv.law.cases.random_cases import Parts, single
from sepv.law.cases.strata import RANDOM_GENERATORS, Stratum
from sepv.law.tolerance import CONTRACTION
from sepv.problem import NamedProblem, PolynomialSystem, Structure, Systems
from sepv.record import Polynomial

# Strategies for users.
__all__ = [
    "CONTRACTION", "any_steps", "casimir_systems", "coefficients", "hamiltonians", "noises", "paper_problems",
    "paper_steps", "poisson_systems", "polynomials", "skew_structures", "steps",
]  # fmt: skip
T = TypeVar("T")


def __dir__() -> list[str]:
    return __all__


def _made(make: Callable[[Random], T]) -> st.SearchStrategy[T]:
    """Build a value from random numbers that Hypothesis draws and shrinks."""
    return RANDOM_GENERATORS.map(make)


@cache
def coefficients(largest: int = 8) -> st.SearchStrategy[float]:
    """Multiples of 1/4 between ±largest/4, not zero. Examples shrink towards 1/4."""
    return _made(lambda random: random.choice([1.0, -1.0]) * random.randint(1, largest) / 4)


@cache
def polynomials(
    dimension: int, degree: int, *, least: int = 1, terms: int = 5
) -> st.SearchStrategy[Polynomial]:
    """Polynomials of degree `least` to `degree` with one to `terms` terms.
    Examples shrink towards one term.
    """
    return _made(lambda random: parts.polynomial(dimension, least, degree, terms, random))


def hamiltonians(dimension: int, degree: int = 6, *, least: int = 1) -> st.SearchStrategy[Polynomial]:
    """Polynomial Hamiltonians H with one to five terms. Examples shrink towards one term."""
    return polynomials(dimension, degree, least=min(least, degree))


@cache
def skew_structures(dimension: int, degree: int = 3) -> st.SearchStrategy[Structure]:
    """Skew B(y) with polynomial entries of degree 0 to `degree`. Examples shrink towards B = J."""
    return _made(lambda random: parts.skew(dimension, Stratum("", 0, degree), 1.0, random))


@cache
def noises(least: int = 0, most: int = 3) -> st.SearchStrategy[tuple[float, ...]]:
    """From `least` to `most` noise coefficients c_j ≥ 0.
    Examples shrink towards `least` coefficients c_j = 1.
    """
    return _made(
        lambda random: tuple(
            random.choice([1.0, 0.5, 2.0, 0.25, 0.0]) for _ in range(random.randint(least, most))
        )
    )


@cache
def casimir_systems(degree: int = 6, *, largest: int = 6) -> st.SearchStrategy[PolynomialSystem]:
    """Systems with quadratic or linear Casimirs, d = 3 to `largest`, H of degree 1 to `degree`."""

    def make(random: Random) -> PolynomialSystem:
        kind = random.choice(["quadratic", "linear", *["two"] * (largest > 3)])
        return _system(random, kind, 4 if kind == "two" else 3, largest, 1, degree, 3)

    return _made(make)


@cache
def poisson_systems(
    degree: int = 6, *, least: int = 1, largest: int = 6, structure_degree: int = 3
) -> st.SearchStrategy[PolynomialSystem]:
    """Systems of dimension 2 to `largest`, H of degree `least` to `degree`, any skew B(y)
    up to `structure_degree`.
    """
    return _made(lambda random: _system(random, "none", 2, largest, least, degree, structure_degree))


def _system(
    random: Random, casimirs: str, smallest: int, largest: int, least: int, degree: int, structure_degree: int
) -> PolynomialSystem:
    lowest = {"two": random.randint(0, 2)}.get(casimirs, 0)
    levels = {
        "state": Stratum("anywhere"),
        "Jacobi": Stratum("any"),
        "Casimirs": Stratum(casimirs),
        "d": Stratum("", smallest, largest),
        "degree of H": Stratum("", least, degree),
        "terms of H": Stratum("", 1, 5),
        "degree of B": Stratum("", lowest, max(lowest, structure_degree)),
        "m": Stratum("", 0, 3),
        "|y|": Stratum("", 1, 1),
    }
    return single(Parts(levels, random))


@cache
def paper_problems() -> st.SearchStrategy[NamedProblem]:
    """The paper's four problems with the paper's parameters."""
    data = [problems.by_name(name).data for name in problems.PAPER]
    return st.sampled_from([entry for entry in data if isinstance(entry, NamedProblem)])


@cache
def steps(systems: st.SearchStrategy[PolynomialSystem] | None = None) -> st.SearchStrategy[Case]:
    """Cases with a step h > 0 inside the contraction radius,
    so that a solution near y0 exists and is unique.

    If no `systems` are given, the systems are of class (1.1) and of all sizes, as the laws draw
    them.
    """
    if systems is not None:
        return systems.flatmap(near)
    return CLASSES[Systems.SINGLE].space.part({"h": ("> 0",), "given as": ("data",)}).strategy()


@cache
def paper_steps() -> st.SearchStrategy[Case]:
    """A step of one of the paper's problems from near its initial state,
    not above the problem's `longest_step`.
    """
    return paper_problems().flatmap(near)


@cache
def any_steps() -> st.SearchStrategy[Case]:
    """Steps of random polynomial systems, with and without Casimirs, and of the paper's
    problems.
    """
    return st.one_of(steps(), steps(), paper_steps())
