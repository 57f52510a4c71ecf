"""The cases of a law, described once for every class of systems and for users' problems
(`Cases`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from random import Random

from hypothesis import strategies as st

from sepv import problems as named
from sepv.errors import require_one_of
from sepv.law.cases import strata
from sepv.law.cases.case import NO_NOISE, Case, quiet
from sepv.law.cases.classes import CLASSES
from sepv.law.cases.clipped import within
from sepv.law.cases.from_problem import near, of_case, start_of
from sepv.law.cases.single_precision import in_range, single
from sepv.law.cases.strata import Space, Strata
from sepv.law.cases.users_problems import Item
from sepv.problem import (
    Description,
    Fact,
    GivenProblem,
    Problem,
    Systems,
    undamped,
)

# A function that adapts a case to a law: it returns a case to which the law applies, or None.
Adapt = Callable[[Case], Case | None]
Strategy = st.SearchStrategy[Case]
# The reason why laws about H do not apply to several Hamiltonians.
NOT_KEPT = "with several Hamiltonians that do not commute with H_0 the exact flow does not keep H_0"


# The reason why a law does not apply to damped systems, unless it says otherwise.
UNDAMPED = "the law speaks of systems without damping"


def unchanged(case: Case) -> Case:
    """Return the case unchanged; the default of `Cases.adapt`,
    for a law that applies to every case.
    """
    return case


def only(holds: Callable[[Problem], object], *, data: bool = False) -> Adapt:
    """A filter that keeps a case if `holds` is true of its problem;
    `data` also requires a problem stored as data.
    """

    def adapt(case: Case) -> Case | None:
        lacks = data and isinstance(case.problem, GivenProblem)
        return case if not lacks and holds(named.build(case.problem)) else None

    return adapt


@dataclass(frozen=True)
class Question:
    """A law's cases for one scheme: a list that covers all ranges of properties, a random search,
    and fixed cases.
    """

    design: Callable[[int], list[Case]]  # the cases of the design for a seed
    strategy: Strategy
    # True if the first case, a simpler form of the second, is a case of the law too.
    admits: Callable[[Case, Case], bool]
    fixed: tuple[Case, ...] = ()
    of_strategy: bool = False  # True if a user's strategy draws cases, which Hypothesis alone can simplify


@dataclass(frozen=True)
class Cases:
    """The test cases of a law, for a scheme of any class of systems:
    by default all cases of the class.

    Attributes
    ----------
    adapt : case -> case or None
        Changes a case so that the law applies, or returns None if that is impossible. A second call
        changes nothing.
    why : str
        The reason to report if `adapt` returns None for all of a user's problems.
    where : axis -> strata
        For some properties of cases (axes), the values or ranges to which the law
        applies. Classes without such a property are not restricted.
    blind : axis -> strata
        Ranges in which no violation can show. Pairs of other ranges must occur in cases outside
        these ranges.
    needs : fact -> str
        The facts that a system must have (`sepv.problem`), each with the reason why the law does
        not apply without it.
    damped : bool
        True if the law applies to damped systems too; by default it needs `undamped`.
    stays : bool
        True if the law makes steps of the case's problem alone. If False, users' problems are not
        measured.
    instead : class -> class, or () -> strategy
        For schemes for a class, the source of cases that replaces the class: a narrower class, or a
        strategy.
    no_cases_of : class -> str
        The classes that have no cases of the law, though they have the facts that it needs, each
        with the reason.
    fixed : class -> (() -> cases)
        Cases that are measured with every seed, in addition to the fixed cases of the class.
    made : class -> (count, Random -> case)
        The number of cases that replace the design, and a function that makes them and the cases of
        the random search.
    """

    adapt: Adapt = unchanged
    why: str = "the law says nothing about the problems"
    where: Mapping[str, Strata] = field(default_factory=dict)
    blind: Mapping[str, Strata] = field(default_factory=dict)
    needs: Mapping[Fact, str] = field(default_factory=dict)
    damped: bool = False
    stays: bool = True
    instead: Mapping[Systems, Systems | Callable[[], Strategy]] = field(default_factory=dict)
    no_cases_of: Mapping[Systems, str] = field(default_factory=dict)
    fixed: Mapping[Systems, Callable[[], Iterable[Case]]] = field(default_factory=dict)
    made: Mapping[Systems, tuple[int, Callable[[Random], Case]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.damped:
            object.__setattr__(self, "needs", {undamped: UNDAMPED, **self.needs})
        known: dict[str, dict[str, None]] = {}
        for axis in (axis for own in CLASSES.values() for axis in own.space.axes):
            known.setdefault(axis.name, {}).update(dict.fromkeys(s.name for s in axis.strata))
        for name, named_strata in (*self.where.items(), *self.blind.items()):
            require_one_of("an axis of cases", name, known, "see `sepv verify --coverage`")
            for stratum in named_strata:
                require_one_of(f"a stratum of {name}", stratum, known[name], "see `sepv verify --coverage`")

    def space(self, systems: Systems) -> Space | None:
        """The space of the cases that the law measures for a class;
        None if they do not come from a space.
        """
        if self._refuses(systems) or systems in self.made:
            return None
        source = self.instead.get(systems, systems)
        return CLASSES[source].space.part(self.where, self.blind) if isinstance(source, Systems) else None

    def _refuses(self, systems: Systems) -> str:
        """The reason why the law does not apply to a class of systems; empty if it does."""
        source = self.instead.get(systems, systems)
        facts = (source if isinstance(source, Systems) else systems).facts
        lacking = (why for fact, why in self.needs.items() if fact not in facts)
        return self.no_cases_of.get(systems) or next(lacking, "")

    def _lacks(self, problem: Problem) -> str:
        """The reason why the law does not apply to a problem, by the first fact that it lacks."""
        return next((why for fact, why in self.needs.items() if not fact(problem)), "")

    def adapted(self, case: Case) -> Case | None:
        """Change a case so that the law applies (`adapt`);
        None if it does not apply to the case or its system.
        """
        return None if self.needs and self._lacks(named.build(case.problem)) else self.adapt(case)

    def without_noise(self) -> Cases | str:
        """The cases for a scheme without noise, each with h = Δ of the noisy case;
        or the reason why there are none.
        """
        if "0" not in self.where.get(strata.NOISES.name, ("0",)):
            return NO_NOISE
        return replace(self, adapt=partial(_adapted_quietly, self.adapt))

    def in_single_precision(self) -> Cases:
        """The cases whose numbers single precision can hold, and whose B and ∇H it can resolve."""
        return replace(self, adapt=partial(_adapted_and_rounded, self.adapt))

    def within_clip(self, k: int) -> Cases:
        """The cases with increments up to √h A_h, for a scheme that clips at this bound,
        or beyond it, itself.
        """
        return replace(self, adapt=partial(_adapted_within, self.adapt, k))

    def admits(self, case: Case) -> bool:
        """True if the law applies to the case without a change of the case."""
        return self.adapted(case) == case

    def _keeps(self, new: Case, _old: Case) -> bool:
        return self.admits(new)

    def of_class(self, systems: Systems) -> Question | str:
        """The cases for a scheme that accepts all systems of a class,
        or the reason why there are none.
        """
        if why := self._refuses(systems):
            return why
        if systems in self.made:
            count, make = self.made[systems]
            drawn_alone = self._adapting(st.randoms(use_true_random=False).map(make))
            return Question(
                lambda seed: self.all_adapted(make(Random(f"{seed} {n}")) for n in range(count)),
                drawn_alone,
                self._keeps,
            )
        source = self.instead.get(systems, systems)
        if not isinstance(source, Systems):
            return Question(lambda _: [], self._adapting(source()), self._keeps)
        own, space = CLASSES[source], self.space(systems)
        assert space is not None
        if not all(axis.strata for axis in space.axes):
            return "the class has no systems that the law speaks of"
        drawn = [near(d) for d in _data(own.named) if self.adapted(start_of(d)) is not None]
        # Half of the draws are random systems. `one_of` counts the same strategy once.
        drawn += [space.strategy() for _ in range(max(1, len(drawn)))]
        drawn += [_present(st.randoms(use_true_random=False).map(f)) for f in own.more]
        listed = (*own.fixed(), *(self.fixed[systems]() if systems in self.fixed else ()))
        return Question(
            lambda seed: self.all_adapted(
                [*(c for _, c in space.cases(seed)), *space.further(seed).values()]
            ),
            self._adapting(st.one_of(drawn)),
            self._keeps,
            tuple(self.all_adapted(listed)),
        )

    def of_problems(self, items: Sequence[Item]) -> Question | str:
        """The cases of the problems given with a scheme,
        or the reason why the law does not apply to them.
        """
        if not self.stays:
            return "the law leads out of the problems that the scheme is for"
        everything = self.adapt is unchanged and not self.needs
        usable = [item for item in items if everything or item.meets(self.adapted, self.where)]
        if not usable:
            return next((why for item in items for p in item.problems if (why := self._lacks(p))), self.why)
        drawn = st.one_of(*(item.values.flatmap(of_case) for item in usable))
        families = [Systems(item.text) for item in usable if item.space is not None]
        fixed = [case for systems in families if systems in self.fixed for case in self.fixed[systems]()]
        return Question(
            lambda seed: self.all_adapted(case for item in usable for case in item.design(seed, self.where)),
            self._adapting(drawn),
            lambda new, old: self.admits(new) and all(item.keeps(new, old) for item in usable),
            tuple(self.all_adapted(fixed)),
            any(item.space is None and item.fixed is None for item in usable),
        )

    def all_adapted(self, cases: Iterable[Case]) -> list[Case]:
        """Change cases so that the law applies to them (`adapt`),
        and leave out those to which it cannot apply.
        """
        return [adapted for case in cases if (adapted := self.adapted(case)) is not None]

    def _adapting(self, drawn: Strategy) -> Strategy:
        if self.adapt is unchanged and not self.needs:
            return drawn
        return _present(drawn.map(self.adapted))


def _adapted_quietly(adapt: Adapt, case: Case) -> Case | None:
    silent = quiet(case)
    return None if silent is None else adapt(silent)


def _adapted_and_rounded(adapt: Adapt, case: Case) -> Case | None:
    rounded = single(case)
    found = adapt(rounded) if in_range(rounded) else None
    return found if found is not None and single(found) == found and in_range(found) else None


def _adapted_within(adapt: Adapt, k: int, case: Case) -> Case | None:
    shorter = within(case, k)
    found = None if shorter is None else adapt(shorter)
    return found if found is None or within(found, k) == found else None


ALL_CASES = Cases(damped=True)


def _present(drawn: st.SearchStrategy[Case | None]) -> Strategy:
    """The strategy `drawn` without its values None."""
    return drawn.filter(lambda case: case is not None)  # type: ignore[return-value]


@cache
def _data(names: tuple[str, ...]) -> list[Description]:
    return [data for name in names if (data := named.by_name(name).data) is not None]
