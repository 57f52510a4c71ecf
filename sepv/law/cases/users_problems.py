"""Cases from problems that a user names: a scheme is judged on the problems that it is for.

An item is a problem (by name, ``module:attribute``, file, record or data), a family of
`sepv.law.cases.classes`, or a Hypothesis strategy of problems, of their data or of whole cases.
`from_problem` draws cases of an item; `of_law` adapts the cases to each law.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from hypothesis import HealthCheck, Phase, Verbosity, given, settings
from hypothesis import seed as hypothesis_seed
from hypothesis import strategies as st

from sepv import problems as named
from sepv._arguments import did_you_mean
from sepv.errors import UsageError
from sepv.law.cases.case import Case
from sepv.law.cases.classes import NARROW_CLASSES
from sepv.law.cases.ends import in_known_units
from sepv.law.cases.from_problem import describe, of_case, start_of
from sepv.law.cases.strata import Space, Strata
from sepv.problem import NamedProblem, PolynomialSystem, Problem, Systems
from sepv.schemes import load_object, load_problem


@dataclass(frozen=True)
class Item:
    """One problem, family or strategy that a scheme is for."""

    text: str  # the name that a user gave, for commands; empty for an object
    values: st.SearchStrategy[Any]  # gives a Case, a Problem or a problem's data
    problems: tuple[Problem, ...] = ()  # problems with an initial state, for laws about many steps
    fixed: Problem | None = None  # the only problem: a law then needs no draws to see if it applies
    space: Space | None = None  # the space of cases of a family
    any_terms: bool = False  # as of a `SystemsClass`

    def design(self, seed: int, where: Mapping[str, Strata]) -> list[Case]:
        """Cases of a family that cover all pairs of property ranges (strata);
        `where` restricts the ranges.
        """
        part = self.part(where)
        return [] if part is None else [*(case for _, case in part.cases(seed)), *part.further(seed).values()]

    def part(self, where: Mapping[str, Strata]) -> Space | None:
        """The space of the family's cases in the ranges `where`, or in all if none is left;
        None without a family.
        """
        if self.space is None:
            return None
        part = self.space.part(where)
        return part if all(axis.strata for axis in part.axes) else self.space.part()

    def keeps(self, new: Case, old: Case) -> bool:
        """True if `new`, a simpler form of `old`, is a case of the item too.

        Of one problem only the state and the step may change. A case of a family may be in other
        units and have fewer noises, and in some families another H with the same terms or fewer.
        What a strategy draws, no other case can replace.
        """
        if self.space is None:
            return self.fixed is not None and new.problem == old.problem
        if isinstance(old.problem, PolynomialSystem) and new in in_known_units(old):
            return True
        changed = ("noise", "hamiltonian") if self.any_terms else ("noise",)
        return replace(new.problem, **{key: getattr(old.problem, key) for key in changed}) == old.problem

    def meets(self, adapted: Callable[[Case], Case | None], where: Mapping[str, Strata]) -> bool:
        """True if a law applies to the item: to its one problem, a case of its family,
        or one of thirty drawn cases.
        """
        if self.fixed is not None:
            return adapted(start_of(describe(self.fixed, self.text))) is not None
        if self.space is not None:
            return any(adapted(case) is not None for case in self.design(0, where))
        return _meets(self.values, adapted)


class _Met(Exception):
    """Raised to end the trial of a strategy, at the first example to which the law applies."""


def _meets(values: st.SearchStrategy[Any], adapted: Callable[[Case], Case | None]) -> bool:
    def look(case: Case) -> None:
        if adapted(case) is not None:
            raise _Met

    members = settings(
        max_examples=30, database=None, deadline=None, phases=(Phase.generate,), verbosity=Verbosity.quiet,
        suppress_health_check=list(HealthCheck),
    )(given(values.flatmap(of_case))(look))  # fmt: skip
    try:
        hypothesis_seed(0)(members)()
    except _Met:
        return True
    return False


def items(asked: Iterable[Any] | Any) -> tuple[Item, ...]:
    """Read a user's problems, families and strategies; a UsageError for anything else."""
    if isinstance(asked, (str, Problem, st.SearchStrategy, PolynomialSystem, NamedProblem, Item)):
        asked = (asked,)
    try:
        listed = tuple(asked)
    except TypeError:
        listed = (asked,)
    if not listed:
        remedy = "leave it out for every problem"
        raise UsageError(expected="problems, one at least", received="none", remedy=remedy)
    return tuple(_item(entry) for entry in listed)


def _item(asked: Any) -> Item:
    if isinstance(asked, Item):
        return asked
    text = asked if isinstance(asked, str) else ""
    family = text.replace("_", "-")
    if family in NARROW_CLASSES:
        narrow = NARROW_CLASSES[Systems(family)]
        problems = tuple(named.by_name(p) if isinstance(p, str) else p() for p in narrow.problems)
        return Item(text, narrow.space.part().strategy(), problems, None, narrow.space, narrow.any_terms)
    value = load_object(text) if ":" in text and not text.endswith(".json") else asked
    if not isinstance(value, (st.SearchStrategy, Problem)) and callable(value):
        of_hypothesis = getattr(value, "__module__", "").startswith("hypothesis")
        if of_hypothesis or getattr(value, "is_hypothesis_strategy_function", False):
            value = value()
    if isinstance(value, st.SearchStrategy):
        return Item(text, value)
    try:
        problem = load_problem(asked)
    except UsageError as error:
        if text.endswith(".json"):
            raise
        known = [
            *map(str, NARROW_CLASSES),
            *named.PAPER,
            *named.EXTENSIONS,
            *named.SEVERAL,
            *named.HAMILTONIANS,
        ]
        raise UsageError(
            expected=f"{error.expected}; or a family; or a Hypothesis strategy of them",
            received=did_you_mean(text, known) if text and ":" not in text else error.received,
            remedy=f"{error.remedy}. The families are {', '.join(NARROW_CLASSES)}",
        ) from error
    own = (problem,) if problem.initial is not None else ()
    return Item(text, st.just(describe(problem, text)), own, problem)


def sources(scheme: Any) -> tuple[Item, ...]:
    """The problems that a scheme is for, or its family of problems;
    empty if it is for a wide class of systems.
    """
    if scheme.problems:
        return items(scheme.problems)
    return items(scheme.systems) if scheme.systems in NARROW_CLASSES else ()


def objects_of(scheme: Any) -> tuple[Problem, ...]:
    """The problems of a scheme that were given as Python objects,
    so that no command line can name them.
    """
    return tuple(item.fixed for item in sources(scheme) if item.fixed is not None and not item.text)
