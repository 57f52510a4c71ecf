"""The space of cases: axes, the strata of each, what cannot be combined and why, and designs that cover it.

A law has the space that it speaks of; `Space.cases` are its cases by design: each possible pair of strata occurs,
with random content inside. What a stratum means is in `sepv.verification._cases.random_cases`, which makes the
cases: once for all laws that ask for the same strata. So that many do, a design may take its rows from
another one, its pool.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import product
from typing import NamedTuple

from sepv.verification._cases.case import Case
from sepv.verification._cases.covering import Design, Pair, Partial, Row, pairwise, shown_pairs


class Stratum(NamedTuple):
    """A part of an axis: its name, and for numbers the range that it stands for."""

    name: str
    low: float = 0.0
    high: float = 0.0


@dataclass(frozen=True)
class Axis:
    """A property of cases, divided into strata."""

    name: str
    strata: tuple[Stratum, ...]


Levels = dict[str, Stratum]


@dataclass(frozen=True)
class Rule:
    """What cannot be: `forbids` is asked once strata of all its axes are chosen."""

    axes: tuple[str, ...]
    forbids: Callable[..., bool]
    reason: str


def _axis(name: str, *strata: tuple[str, float, float] | str) -> Axis:
    return Axis(name, tuple(Stratum(s) if isinstance(s, str) else Stratum(*s) for s in strata))


CASIMIRS = _axis("Casimirs", "none", "linear", "quadratic", "two")
DIMENSION = _axis("d", ("2", 2, 2), ("3", 3, 3), ("4–6", 4, 6), ("7–9", 7, 9), ("10–12", 10, 12))
DEGREE = _axis("degree of H", ("1–2", 1, 2), ("3–4", 3, 4), ("5–6", 5, 6), ("7–8", 7, 8), ("9–10", 9, 10))
TERMS = _axis("terms of H", ("1–2", 1, 2), ("3–9", 3, 9), ("10–19", 10, 19), ("20–30", 20, 30))
STRUCTURE = _axis("degree of B", ("0", 0, 0), ("1", 1, 1), ("2–3", 2, 3), ("4–6", 4, 6))
NOISES = _axis("m", ("0", 0, 0), ("1", 1, 1), ("2", 2, 2), ("3–4", 3, 4), ("5–8", 5, 8))
SIZE = _axis(
    "|y|", ("1", 0.5, 2), ("1e3", 5e2, 2e3), ("1e6", 5e5, 2e6), ("1e-3", 5e-4, 2e-3), ("1e-6", 5e-7, 2e-6)
)
STEP = _axis(
    "|Δ|", ("½–4", 0.5, 4), ("1e-2–½", 1e-2, 0.5), ("1e-5–1e-2", 1e-5, 1e-2), ("1e-9–1e-5", 1e-9, 1e-5)
)
SIGN = _axis("h", ("> 0", 1, 1), ("< 0", -1, -1))
# Steps as long as the contraction radius allows, and short ones: there errors of quadrature are below rounding.
SHARE = _axis("step/radius", ("½–1", 0.5, 1), ("2⁻¹⁰", 2.0**-11, 2.0**-10))
GIVEN = _axis("given as", "data", "functions", "bare functions")
BATCH = _axis("batch", ("2–9", 2, 9), ("33–129", 33, 129), ("500–2000", 500, 2000), ("4097–9000", 4097, 9000))
STRUCTURES = _axis("structures", "any", "common Casimir")
WHY = _axis("why", "Δ = 0", "∇H = 0")
REDUCED = _axis("reduced", "constant B", "c = 0")
CASIMIR_DEGREE = _axis("degree of C", ("1", 1, 1), ("2", 2, 2), ("3–4", 3, 4), ("5–6", 5, 6))
FACTOR = _axis("degree of g", ("0", 0, 0), ("1–2", 1, 2), ("3–4", 3, 4))


def _is_varied(reduced: Stratum, degree: Stratum, most: int) -> bool:
    return reduced.name == "constant B" and degree.high > most


_RANK = "B of rank 2 at least leaves d − 2 Casimirs at most"
RULES = (
    Rule(("d", "degree of H", "terms of H"),
         lambda d, degree, terms: monomials(int(d.high), int(degree.high)) < terms.low,
         "there are not so many monomials of this degree in d variables"),
    Rule(("Casimirs", "d"), lambda casimirs, d: d.high < {"none": 2, "two": 4}.get(casimirs.name, 3), _RANK),
    Rule(("structures", "d"), lambda kind, d: kind.name == "common Casimir" and d.high < 3, _RANK),
    Rule(("why", "degree of H"), lambda why, degree: why.name == "∇H = 0" and degree.high < 2,
         "a linear H has no point at rest"),
    Rule(("structures", "degree of B"), lambda kind, degree: kind.name == "common Casimir" and degree.high < 1,
         "B = Σ T_ijk v_k with v = Ay is linear at least"),
    Rule(("reduced", "degree of C"), lambda reduced, C: _is_varied(reduced, C, 1), "B is constant"),
    Rule(("reduced", "degree of g"), lambda reduced, g: _is_varied(reduced, g, 0), "B is constant"),
    Rule(("reduced", "degree of B"), lambda reduced, B: _is_varied(reduced, B, 0), "B is constant"),
    Rule(("reduced", "m"), lambda reduced, m: reduced.name == "constant B" and m.high < 1,
         "without noise it is the deterministic method, whatever B is"),
    Rule(("batch", "d"), lambda batch, d: d.high > {"500–2000": 6, "4097–9000": 3}.get(batch.name, 12),
         "cost: d³ derivatives of B for thousands of states take gigabytes"),
    Rule(("batch", "terms of H"), lambda batch, terms: batch.low > 4096 and terms.low > 9,
         "cost: a step of thousands of states takes seconds"),
    # Three strata together: each two of them still meet.
    Rule(("batch", "given as", "degree of H"),
         lambda batch, given, degree: given.name == "bare functions"
         and degree.high > {"500–2000": 4, "4097–9000": 2}.get(batch.name, 10),
         "cost: quadrature and Jacobian by many evaluations for thousands of states take seconds"),
)  # fmt: skip
HIDING = ("step/radius", "2⁻¹⁰")


def monomials(d: int, degree: int) -> int:
    """How many monomials of degree 1 to `degree` there are in d variables."""
    return math.comb(d + degree, degree) - 1


@dataclass(frozen=True)
class Space:
    """Axes, and how a case with a stratum of each is made.

    `beside` are (axis, stratum) beside which a fault of other axes may not show: of what the law is about nothing can
    be wrong there, such as the quadrature where H is quadratic. What is met there only is not met.
    """

    axes: tuple[Axis, ...]
    make: Callable[
        [Levels, int], Case
    ]  # a case inside the strata, random otherwise: the same for the same seed
    rules: tuple[Rule, ...] = RULES
    beside: frozenset[tuple[str, str]] = frozenset({HIDING})
    pool: Space | None = (
        None  # one whose rows the design takes where they serve: their content is made already
    )

    def restricted(self, **strata: tuple[str, ...]) -> Space:
        """The part with these strata only; axes by name with _ for spaces."""
        wanted = {name.replace("_", " "): names for name, names in strata.items()}
        unknown = set(wanted) - {axis.name for axis in self.axes}
        if unknown:
            raise KeyError(f"no axis {unknown}")
        left = {
            a.name: tuple(s for s in a.strata if s.name in wanted.get(a.name, (s.name,))) for a in self.axes
        }
        return replace(self, axes=tuple(Axis(name, strata) for name, strata in left.items()))

    def without_faults(self, **strata: tuple[str, ...]) -> Space:
        """The space where no fault shows in these strata; axes by name with _ for spaces."""
        named = {(axis.replace("_", " "), name) for axis, names in strata.items() for name in names}
        unknown = named - {(axis.name, s.name) for axis in self.axes for s in axis.strata}
        if unknown:
            raise KeyError(f"no strata {unknown}")
        return replace(self, beside=self.beside | named)

    def levels(self, row: Row) -> Levels:
        """The strata of a row, by axis."""
        return {axis.name: axis.strata[k] for axis, k in zip(self.axes, row, strict=True)}

    def forbidden(self, row: Partial | Row) -> str:
        """Why the strata chosen so far cannot go together; empty where they can."""
        for rule, axes, refused in self._refusals:
            if tuple([row[a] for a in axes]) in refused:
                return rule.reason
        return ""

    @cached_property
    def _refusals(self) -> list[tuple[Rule, tuple[int, ...], set[tuple[int, ...]]]]:
        """For each rule about these axes their numbers, and the strata that it forbids together."""
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
        """The strata beside which a fault of other axes may not show."""
        numbered = ((a, axis, k, s) for a, axis in enumerate(self.axes) for k, s in enumerate(axis.strata))
        return frozenset((a, k) for a, axis, k, s in numbered if (axis.name, s.name) in self.beside)

    def design(self) -> Design:
        """Rows in which every possible pair of strata occurs."""
        return _design(replace(self, make=_none))

    def cases(self, seed: int) -> list[tuple[Row, Case]]:
        """A case for each row of the design; another seed gives other content in the same strata."""
        return _cases(self, seed)

    def offered(self) -> list[Row]:
        """The rows of the pool's design that have their strata here, with any of the axes that the pool lacks."""
        found: list[Row] = []
        if self.pool is None:
            return found
        for row in self.pool.design().rows:
            levels = self.pool.levels(row)
            numbers = [[k for k, s in enumerate(a.strata) if levels.get(a.name, s) == s] for a in self.axes]
            found += [own for own in product(*numbers) if not self.forbidden(own)]
        return found

    def impossible(self, pair: Pair) -> str:
        """Why no case has both strata."""
        row: Partial = [0 if len(axis.strata) == 1 else None for axis in self.axes]
        for factor, level in pair:
            row[factor] = level
        return self.forbidden(row) or "no other strata go with both"

    def shown(self, row: Row) -> list[Pair]:
        """The pairs of strata that are met in a row of the design."""
        return shown_pairs(row, self.hiding)


def _none(_levels: Levels, _seed: int) -> Case:
    raise AssertionError("a design has rows only")


@cache
def _design(space: Space) -> Design:
    sizes = [len(axis.strata) for axis in space.axes]
    return pairwise(sizes, lambda row: not space.forbidden(row), space.hiding, space.offered())


@cache
def _cases(space: Space, seed: int) -> list[tuple[Row, Case]]:
    return [(row, space.make(space.levels(row), seed)) for row in space.design().rows]
