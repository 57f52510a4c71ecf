"""Random steps and systems for tests, as the laws draw them."""

from __future__ import annotations

from hypothesis import strategies as st

from sepv.problem import PolynomialSystem, Systems
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
