"""Systems for tests: random ones as the laws draw them, and one by hand."""

from typing import Any

import numpy as np
from hypothesis import strategies as st

from sepv.problem import Array, PolynomialSystem, Problem, Systems
from sepv.verification import Case
from sepv.verification._cases.classes import CLASSES


def steps(systems: Systems, **where: tuple[str, ...]) -> st.SearchStrategy[Case]:
    """Steps of a class in these strata; axes by name with _ for spaces."""
    named = {axis.replace("_", " "): strata for axis, strata in where.items()}
    space = CLASSES[systems].space
    known = {axis.name: {stratum.name for stratum in axis.strata} for axis in space.axes}
    assert all(set(strata) <= known[axis] for axis, strata in named.items()), known
    return space.part(named).strategy()


def drawn_systems(systems: Systems, **where: tuple[str, ...]) -> st.SearchStrategy[PolynomialSystem]:
    """Systems of a class made for states of size one."""
    return steps(systems, **{**where, "|y|": ("1",), "|Δ|": ("½–1e12",)}).map(_system)


def _system(case: Case) -> PolynomialSystem:
    assert isinstance(case.problem, PolynomialSystem)
    return case.problem


def J(y: Array) -> Array:
    """The structure [[0, −1], [1, 0]] of the plane, component first."""
    return np.array([[0 * y[0], -1 + 0 * y[0]], [1 + 0 * y[0], 0 * y[0]]])


def by_hand(**changes: Any) -> Problem:
    """H = ¼y₁⁴ + ½y₂² in the plane, given by functions, with these changes."""
    parts: dict[str, Any] = {
        "dimension": 2,
        "structure": J,
        "hamiltonian": lambda y: y[0] ** 4 / 4 + y[1] ** 2 / 2,
        "gradient": lambda y: np.array([y[0] ** 3, y[1]]),
    }
    return Problem(**{**parts, **changes})
