"""Spaces of test cases: axes divided into strata, forbidden combinations with reasons,
and designs that cover a space.

An axis is a property of cases, such as the dimension d, and a stratum is a range or value of it,
such as d = 4 to 6. A row has one stratum of each axis; a design is a list of rows in which each
possible pair of strata occurs. Each class of systems has a space, and a law uses a part of it
(`Space.part`). `Space.cases` makes a random case inside the strata of each row, by
`sepv.law.cases.random_cases`; `Space.strategy` draws cases for Hypothesis. Laws with the same row
share the case of this row. So a design first takes rows from the design of a larger space, the
pool.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import product
from random import Random
from types import MappingProxyType
from typing import Any, NamedTuple
from zlib import crc32

from hypothesis import assume
from hypothesis import strategies as st

from sepv._kept import kept
from sepv.law.cases.case import Case
from sepv.law.cases.covering import Design, Pair, Partial, Row, pairwise, shown_pairs


class Stratum(NamedTuple):
    """One range or value of a property of cases: its name and, for a number,
    the range from `low` to `high`.

    If there is an `end` beyond the range, some cases lie between the range and this end (`ended`).
    """

    name: str
    low: float = 0.0
    high: float = 0.0
    end: float = 0.0


@dataclass(frozen=True)
class CaseAxis:
    """A property of cases, such as the dimension, divided into strata (ranges or values).

    A law that names no strata of an axis gets the first `usual` strata of the axis, or all if
    `usual` is 0.
    """

    name: str
    strata: tuple[Stratum, ...]
    usual: int = 0


Levels = dict[str, Stratum]
# Names of strata.
Strata = tuple[str, ...]
NO_STRATA: Mapping[str, Strata] = MappingProxyType({})


@dataclass(frozen=True)
class Rule:
    """A rule against combining strata: `forbids` gets one stratum of each of `axes` and is True if
    it forbids these.
    """

    axes: tuple[str, ...]
    forbids: Callable[..., bool]
    reason: str


def _axis(name: str, *strata: tuple[Any, ...] | str, usual: int = 0) -> CaseAxis:
    return CaseAxis(name, tuple(Stratum(s) if isinstance(s, str) else Stratum(*s) for s in strata), usual)


STATE = _axis("state", "anywhere", "∇H = 0", "0", usual=1)
JACOBI_IDENTITY = _axis("Jacobi", "any", "Poisson", usual=1)
CASIMIRS = _axis("Casimirs", "none", "linear", "quadratic", "two")
DIMENSION = _axis("d", ("2", 2, 2), ("3", 3, 3), ("4–6", 4, 6), ("7–9", 7, 9), ("10–40", 10, 12, 40))
DEGREE = _axis("degree of H", ("1–2", 1, 2), ("3–4", 3, 4), ("5–6", 5, 6), ("7–8", 7, 8), ("9–20", 9, 10, 20))
TERMS_OF_H = _axis("terms of H", ("1–2", 1, 2), ("3–9", 3, 9), ("10–19", 10, 19), ("20–30", 20, 30))
STRUCTURE = _axis("degree of B", ("0", 0, 0), ("1", 1, 1), ("2–3", 2, 3), ("4–6", 4, 6))
NOISES = _axis("m", ("0", 0, 0), ("1", 1, 1), ("2", 2, 2), ("3–4", 3, 4), ("5–20", 5, 8, 20))
SIZE = _axis(
    "|y|", ("1", 0.03, 30), ("1e3", 30, 3e4), ("1e6–1e100", 3e4, 2e6, 1e100), ("1e-3", 3e-5, 0.03),
    ("1e-100–1e-6", 5e-7, 3e-5, 1e-100),
)  # fmt: skip
STEP = _axis(
    "|Δ|", ("½–1e12", 0.5, 4.0, 1e12), ("1e-2–½", 1e-2, 0.5), ("1e-5–1e-2", 1e-5, 1e-2),
    ("1e-14–1e-5", 1e-9, 1e-5, 1e-14),
)  # fmt: skip
SIGN = _axis("h", ("> 0", 1, 1), ("< 0", -1, -1))
# Steps as long as the contraction radius allows, and short ones, whose quadrature errors are below
# rounding.
SHARE = _axis("step/radius", ("½–1", 0.5, 1), ("2⁻¹⁰", 2.0**-11, 2.0**-10))
GIVEN = _axis("given as", "data", "functions", "bare functions")
BATCH_SIZE = _axis(
    "batch", "one state", ("2–9", 2, 9), ("33–129", 33, 129), ("500–2000", 500, 2000), ("4097–9000", 4097, 9000),
    usual=1,
)  # fmt: skip
MASS = _axis("mass", "diagonal", "full")
POTENTIAL = _axis("V", "any", "bounded below")
INERTIA = _axis("inertia", "any tensor", "principal axes")
ALGEBRA = _axis("algebra", "so(3)", "sl(2)", "e(2)", "heisenberg", "e(3)")
MATRICES = _axis("matrices", "so(3)", "so(4)", "su(3)")
CHANNEL_STRUCTURES = _axis("structures", "any", "common Casimir", "all are B", usual=2)
CASIMIR_DEGREE = _axis("degree of C", ("1", 1, 1), ("2", 2, 2), ("3–4", 3, 4), ("5–6", 5, 6))
KIND = "kind of step"
# Kinds of steps in which little moves, or in which one part of Δ is nearly all of Δ. Most faults do
# not show in them. So the design has no strata for them; one case of each kind follows the design.
UNEVEN_NOISES, NO_TIME, NO_STEP, NEAR_REST = map(
    Stratum, ("noises 1e-4–1e4 of h", "h = 0", "Δ = 0", "near ∇H = 0")
)
EXTREME_SIZES = Stratum("|y| = 1e-100", 1e-100, 1e-100), Stratum("|y| = 1e100", 1e100, 1e100)
# States with components of one sign. In many dimensions random signs hardly ever agree.
ONE_SIGN = Stratum("all y > 0", 1, 1), Stratum("all y < 0", -1, -1)
STEP_KINDS = (UNEVEN_NOISES, NO_TIME, NO_STEP, NEAR_REST, *EXTREME_SIZES, *ONE_SIGN)
# The largest degree of polynomials in cases in which |y| is 1e±100.
EXTREME_SIZE_MAX_DEGREE = 2
FACTOR = _axis("degree of g", ("0", 0, 0), ("1–2", 1, 2), ("3–4", 3, 4))


_LINEAR_AT_0 = "at y = 0 B is made with constant and linear terms"
_RANK_OF_B = "B of rank 2 at least leaves d − 2 Casimirs at most"
COMBINATION_RULES = (
    Rule(("d", "degree of H", "terms of H"),
         lambda d, degree, terms: monomials(int(d.high), int(degree.high)) < terms.low,
         "there are not so many monomials of this degree in d variables"),
    Rule(("Casimirs", "d"), lambda casimirs, d: d.high < {"none": 2, "two": 4}.get(casimirs.name, 3), _RANK_OF_B),
    Rule(("structures", "d"), lambda kind, d: kind.name == "common Casimir" and d.high < 3, _RANK_OF_B),
    Rule(("Jacobi", "Casimirs"), lambda jacobi, casimirs: jacobi.name == "Poisson" and casimirs.name != "none",
         "Poisson structures are made without a list of their Casimirs"),
    Rule(("Jacobi", "state"), lambda jacobi, state: jacobi.name == "Poisson" and state.name == "0", _LINEAR_AT_0),
    Rule(("Casimirs", "state"), lambda casimirs, state: state.name == "0" and casimirs.name != "none", _LINEAR_AT_0),
    Rule(("structures", "state"), lambda kind, state: state.name == "0" and kind.name != "any", _LINEAR_AT_0),
    Rule(("algebra", "d"), lambda algebra, d: (algebra.name == "e(3)") == (d.high < 6), "the dimension of the algebra"),
    Rule(("mass", "d"), lambda mass, d: mass.name == "full" and d.high < 4, "one degree of freedom has one mass"),
    Rule(("matrices", "d"), lambda matrices, d: {"so(3)": 3, "so(4)": 6, "su(3)": 9}[matrices.name] != d.high,
         "the dimension of the algebra"),
    Rule(("structures", "degree of B"), lambda kind, degree: kind.name == "common Casimir" and degree.high < 1,
         "B = Σ T_ijk v_k with v = Ay is linear at least"),
    Rule(("batch", "d"), lambda batch, d: d.high > {"500–2000": 6, "4097–9000": 3}.get(batch.name, 12),
         "cost: d³ derivatives of B for thousands of states take gigabytes"),
    Rule(("batch", "terms of H"), lambda batch, terms: batch.low > 4096 and terms.low > 9,
         "cost: a step of thousands of states takes seconds"),
    # Only the three strata together are forbidden: each two of them may meet.
    Rule(("batch", "given as", "degree of H"),
         lambda batch, given, degree: given.name == "bare functions"
         and degree.high > {"500–2000": 4, "4097–9000": 2}.get(batch.name, 10),
         "cost: quadrature and Jacobian by many evaluations for thousands of states take seconds"),
)  # fmt: skip
SHORT_STEP = ("step/radius", "2⁻¹⁰")
# In principal axes no product of inertia shows.
IN_AXES = ("inertia", "principal axes")


# In a stratum with an `end`, the share of cases beyond the usual range: smaller for integers like
# d, which cost time.
TAIL_SHARE = {int: 1 / 4, float: 1 / 2}


def ended(stratum: Stratum, random: Random) -> Stratum:
    """Return the stratum or, sometimes, one log-uniform number between its range and its `end`,
    or the `end` itself.
    """
    kind = type(stratum.end)
    if not stratum.end or random.random() >= TAIL_SHARE[kind]:
        return stratum._replace(end=0.0)
    inner = stratum.low if stratum.end < stratum.low else stratum.high
    share = random.random() if kind is int else random.choice([1.0, random.random()])
    # A whole number n stands for [n, n + 1).
    low, high = (math.log(v + (kind is int)) for v in (inner, stratum.end))
    beyond = math.exp(low + share * (high - low))
    beyond = math.floor(beyond) if kind is int else beyond
    return Stratum(stratum.name, beyond, beyond)


def monomials(d: int, degree: int) -> int:
    """The number of monomials of degree 1 to `degree` in d variables."""
    return math.comb(d + degree, degree) - 1


# A function that makes a random case inside the strata, or returns None if the drawn numbers allow
# no case. Its last argument counts attempts; None stands for the random search, which accepts cases
# in which some faults do not show.
Make = Callable[[Levels, Random, int | None], Case | None]


@dataclass(frozen=True)
class Space:
    """A space of cases: axes (properties), and the function that makes a case from a stratum
    (range) of each axis.

    `beside` lists strata, as (axis, stratum), in which some faults cannot show, such as a wrong
    quadrature if H is quadratic. A case in such a stratum does not count as a test of its pairs of
    other strata.
    """

    axes: tuple[CaseAxis, ...]
    make: Make
    rules: tuple[Rule, ...] = COMBINATION_RULES
    beside: frozenset[tuple[str, str]] = frozenset({SHORT_STEP, IN_AXES})
    pool: Space | None = None  # a space whose rows the design reuses, as their cases are made already
    kinds: tuple[Stratum, ...] = ()  # kinds of steps: one case of each kind follows the design

    def part(self, where: Mapping[str, Strata] = NO_STRATA, blind: Mapping[str, Strata] = NO_STRATA) -> Space:
        """The part of the space with the strata that `where` lists for an axis,
        and the usual strata of all other axes.

        `blind` lists strata in which no violation of the law can show. Axes that the space does not
        have are ignored, and strata that occur in no allowed combination are left out.
        """
        axes = []
        for axis in self.axes:
            usual = tuple(s.name for s in axis.strata[: axis.usual or None])
            names = where.get(axis.name, usual)
            axes.append(CaseAxis(axis.name, tuple(s for s in axis.strata if s.name in names), axis.usual))
        beside = {(axis, name) for axis, names in blind.items() for name in names}
        # A law that names states is about these states; other kinds of steps add nothing.
        kinds = () if STATE.name in where else self.kinds
        return replace(self, axes=tuple(possible(axes, self.rules)), beside=self.beside | beside, kinds=kinds)

    def levels(self, row: Row) -> Levels:
        """The strata of a row, by axis."""
        return {axis.name: axis.strata[k] for axis, k in zip(self.axes, row, strict=True)}

    def forbidden(self, row: Partial | Row) -> str:
        """The reason why the chosen strata cannot be combined; empty if they can."""
        for rule, axes, refused in self._refusals:
            if tuple([row[a] for a in axes]) in refused:
                return rule.reason
        return ""

    @cached_property
    def _refusals(self) -> list[tuple[Rule, tuple[int, ...], set[tuple[int, ...]]]]:
        """For each rule whose axes this space has: rule, axis numbers,
        and the forbidden combinations of strata.
        """
        numbers = {axis.name: a for a, axis in enumerate(self.axes)}
        found = []
        for rule in self.rules:
            if all(name in numbers for name in rule.axes):
                axes = tuple(numbers[name] for name in rule.axes)
                levels = product(*(range(len(self.axes[a].strata)) for a in axes))
                strata = [self.axes[a].strata for a in axes]
                named = ((row, [s[k] for s, k in zip(strata, row, strict=True)]) for row in levels)
                found.append((rule, axes, {row for row, own in named if rule.forbids(*own)}))
        return found

    @property
    def hiding(self) -> frozenset[tuple[int, int]]:
        """The strata of `beside`, in which some faults cannot show,
        as (axis number, stratum number).
        """
        numbered = ((a, axis, k, s) for a, axis in enumerate(self.axes) for k, s in enumerate(axis.strata))
        return frozenset((a, k) for a, axis, k, s in numbered if (axis.name, s.name) in self.beside)

    def design(self) -> Design:
        """The design: rows, each with one stratum of each axis,
        in which every possible pair of strata occurs.
        """
        return _design(replace(self, make=_none))

    def cases(self, seed: int) -> list[tuple[Row, Case]]:
        """The rows of the design, each with a random case inside its strata;
        `seed` sets the random numbers.
        """
        return [
            (row, _content(self.make, tuple(self.levels(row).items()), seed)) for row in self.design().rows
        ]

    def further(self, seed: int) -> dict[str, Case]:
        """One case of each kind of step in `kinds`, in the strata of a row of `offered` or else of
        the design.
        """
        found = {}
        for kind in self.kinds:
            of_rows = (
                [levels for row in rows if _fits(kind, levels := self.levels(row))]
                for rows in (self.offered(), self.design().rows)
            )
            if rows := next(filter(None, of_rows), None):
                if kind in ONE_SIGN:
                    most = max(row[DIMENSION.name].low for row in rows)
                    rows = [row for row in rows if row[DIMENSION.name].low == most]
                # The choice is the same for all laws that have this row, whatever its batch.
                keys = [crc32(f"{seed} {kind} {_without_batch(row.items())}".encode()) for row in rows]
                row = rows[keys.index(min(keys))]
                found[kind.name] = _content(self.make, (*row.items(), (KIND, kind)), seed)
        return found

    def strategy(self) -> st.SearchStrategy[Case]:
        """A Hypothesis strategy for cases of the space;
        examples shrink towards the first stratum of each axis.
        """
        return _drawn(self)

    def offered(self) -> list[Row]:
        """The rows of the pool's design that this space has,
        with every stratum of each axis that the pool lacks.
        """
        found: list[Row] = []
        if self.pool is None:
            return found
        for row in self.pool.design().rows:
            levels = self.pool.levels(row)
            # The batch is ignored, because it does not change the content of a case.
            levels = {name: stratum for name, stratum in levels.items() if name != BATCH_SIZE.name}
            numbers = [[k for k, s in enumerate(a.strata) if levels.get(a.name, s) == s] for a in self.axes]
            found += [own for own in product(*numbers) if not self.forbidden(own)]
        return found

    def impossible(self, pair: Pair) -> str:
        """The reason why no case has both strata of the pair."""
        row: Partial = [0 if len(axis.strata) == 1 else None for axis in self.axes]
        for factor, level in pair:
            row[factor] = level
        return self.forbidden(row) or "no other strata go with both"

    def shown(self, row: Row) -> list[Pair]:
        """The pairs of strata that the case of a row tests;
        strata in `hiding` exclude some of its pairs.
        """
        return shown_pairs(row, self.hiding)


def _fits(kind: Stratum, levels: Levels) -> bool:
    """True if cases in the strata `levels` can have a step of this kind.

    For every kind, `levels` must have long steps and a state drawn without a condition such as
    y = 0. For kinds about noises it must have a noise (or two), and for an extreme |y| low
    degrees, so that powers of y do not overflow.
    """
    usual = (
        levels[STATE.name].name == STATE.strata[0].name
        and (SHARE.name, levels[SHARE.name].name) != SHORT_STEP
    )
    least = dict.fromkeys((NEAR_REST, *EXTREME_SIZES, *ONE_SIGN), 0) | {UNEVEN_NOISES: 2}
    noisy = levels[NOISES.name].low >= least.get(kind, 1)
    of_degree = [levels[a.name].high for a in (DEGREE, STRUCTURE, CASIMIR_DEGREE, FACTOR) if a.name in levels]
    return usual and noisy and (kind not in EXTREME_SIZES or max(of_degree) <= EXTREME_SIZE_MAX_DEGREE)


def _without_batch(levels: Iterable[tuple[str, Stratum]]) -> tuple[tuple[str, Stratum], ...]:
    return tuple(own for own in levels if own[0] != BATCH_SIZE.name)


def _none(_levels: Levels, _random: Random, _attempt: int | None) -> Case:
    raise AssertionError("a design has rows only")


@cache
def _design(space: Space) -> Design:
    sizes = [len(axis.strata) for axis in space.axes]
    return pairwise(sizes, lambda row: not space.forbidden(row), space.hiding, space.offered())


@cache
def _content(make: Make, levels: tuple[tuple[str, Stratum], ...], seed: int) -> Case:
    """The random case in these strata for a seed, stored between runs;
    a batch changes only its number of states.
    """
    alone = _without_batch(levels)
    if alone != levels:
        stratum, random = dict(levels)[BATCH_SIZE.name], Random(f"{seed} {levels}")
        batch = random.randint(int(stratum.low), int(stratum.high))
        return replace(_content(make, alone, seed), batch=batch)
    return kept(f"cases-{make.__name__}").get(
        f"{seed} {levels}", lambda: _drawn_until_made(make, levels, seed)
    )


def _drawn_until_made(make: Make, levels: tuple[tuple[str, Stratum], ...], seed: int) -> Case:
    random = Random(f"{seed} {[(axis, stratum.name) for axis, stratum in levels]}")
    # Sizes beyond the usual range are drawn before the attempts; else sizes that show fewer faults
    # would be rarer.
    wanted = {axis: ended(stratum, random) for axis, stratum in levels}
    for attempt in range(MOST_ATTEMPTS):
        if (case := make(dict(wanted), random, attempt)) is not None:
            return case
    raise AssertionError(f"no case of these strata: {[(axis, stratum.name) for axis, stratum in levels]}")


# After this many draws it is concluded that the strata have no case: the rules of the class forbid
# too little.
MOST_ATTEMPTS = 10_000
_CHOICES = [st.integers(0, n) for n in range(4 * len(STEP_KINDS) + 1)]
RANDOM_GENERATORS = st.randoms(use_true_random=False)
# Draws of a random search before another row is drawn.
DRAWS = 4


@st.composite
def _drawn(draw: st.DrawFn, space: Space) -> Case:
    row: Partial = [None] * len(space.axes)
    for a, axis in enumerate(space.axes):
        open_ = [k for k in range(len(axis.strata)) if not space.forbidden([*row[:a], k, *row[a + 1 :]])]
        assume(open_)
        row[a] = open_[draw(_CHOICES[len(open_) - 1])] if len(open_) > 1 else open_[0]
    levels, random = space.levels(tuple(k for k in row if k is not None)), draw(RANDOM_GENERATORS)
    levels = {axis: ended(stratum, random) for axis, stratum in levels.items()}
    kinds = [kind for kind in space.kinds if _fits(kind, levels)]
    if kinds and (kind := draw(_CHOICES[4 * len(kinds)])) > 3 * len(kinds):
        levels[KIND] = kinds[kind - 3 * len(kinds) - 1]
    batch = levels.pop(BATCH_SIZE.name, None)
    case = next(filter(None, (space.make(levels, random, None) for _ in range(DRAWS))), None)
    assume(case is not None)
    assert case is not None
    return replace(case, batch=random.randint(int(batch.low), int(batch.high))) if batch else case


def possible(axes: list[CaseAxis], rules: tuple[Rule, ...]) -> list[CaseAxis]:
    """The axes, from which strata are removed that occur in no combination allowed by the rules."""
    for rule in rules:
        named = [axis for axis in axes if axis.name in rule.axes]
        if len(named) < len(rule.axes):
            continue
        named.sort(key=lambda axis: rule.axes.index(axis.name))
        rows = [row for row in product(*(axis.strata for axis in named)) if not rule.forbids(*row)]
        left = {axis.name: {row[n] for row in rows} for n, axis in enumerate(named)}
        if any(len(left[axis.name]) < len(axis.strata) for axis in named):
            kept = [
                replace(a, strata=tuple(s for s in a.strata if s in left.get(a.name, a.strata))) for a in axes
            ]
            return possible(kept, rules)
    return axes
