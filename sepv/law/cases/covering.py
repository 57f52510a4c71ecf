"""Pairwise covering designs for test inputs, whose properties (factors)
each have a few values (levels).

A row has one level of each factor. A design is a short list of rows in which every possible pair of
levels occurs. It shows each fault that depends on the levels of at most two factors. The
construction is greedy, with constraints, like that of Cohen, Dalal, Fredman and Patton (IEEE Trans.
Softw. Eng. 23, 1997). The smallest of several designs is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

Row = tuple[int, ...]
Partial = list[int | None]
Level = tuple[int, int]  # a factor and its level
# Two levels of different factors, in the order of the factors.
Pair = tuple[Level, Level]
# The number of ways in which ties are broken.
TIE_BREAKS = 4
# An offered row is taken only if it covers at least this many new pairs; otherwise a newly made row
# covers more.
LEAST_NEW_PAIRS = 4


@dataclass(frozen=True)
class Design:
    """A design: rows with one level (value) of each factor (property),
    and the pairs of levels that no row can have.
    """

    rows: tuple[Row, ...]
    impossible: frozenset[Pair]


def pairwise(
    levels: Sequence[int],
    allowed: Callable[[Partial], bool],
    hiding: frozenset[Level] = frozenset(),
    offered: Sequence[Row] = (),
) -> Design:
    """Find few rows in which all possible pairs of levels occur; factor f has levels[f] levels.

    `allowed` tests a partial row, with None for each level not chosen yet. If it refuses a row, it
    must refuse every completion of this row. A level in `hiding` may hide faults of other factors:
    in a row with such a level, pairs without this level count as not covered, unless no other row
    can have them. The rows `offered`, which must be allowed, cost less than new rows, so those that
    cover many pairs are taken first.
    """
    taken = _Greedy(levels, allowed, hiding, 0).taken(offered)
    designs = [_Greedy(levels, allowed, hiding, shift).design(taken) for shift in range(TIE_BREAKS)]
    return min(designs, key=lambda design: len(design.rows))


def shown_pairs(row: Row, hiding: frozenset[tuple[int, int]] = frozenset()) -> list[Pair]:
    """The pairs of levels that a row covers: all, or if the row has levels in `hiding`,
    the pairs with all of these.
    """
    hidden = {level for level in enumerate(row) if level in hiding}
    return [pair for pair in combinations(enumerate(row), 2) if hidden <= set(pair)]


class _Greedy:
    """One greedy construction of a design. A set of levels is stored as the bits of an integer."""

    def __init__(
        self, levels: Sequence[int], allowed: Callable[[Partial], bool], hiding: frozenset[Level], shift: int
    ) -> None:
        self.levels, self.allowed, self.hiding, self.shift = levels, allowed, hiding, shift
        self.first = [sum(levels[:f]) for f in range(len(levels))]
        everything = (1 << sum(levels)) - 1
        # For each level, the levels of other factors that it has not met yet.
        self.open = [
            [everything & ~(((1 << size) - 1) << self.first[f])] * size for f, size in enumerate(levels)
        ]

    def design(self, taken: Sequence[Row]) -> Design:
        """A design that consists of the rows `taken` and of new rows."""
        rows, impossible = [*taken], set[Pair]()
        for known in taken:
            self._meet(known)
        for pair in combinations([(f, k) for f, size in enumerate(self.levels) for k in range(size)], 2):
            (f, k), second = pair
            if f == second[0] or not self.open[f][k] >> self._number(second) & 1:
                continue
            row = self._row(pair)
            if row is None:
                impossible.add(pair)
                self._close(pair)
                continue
            rows.append(row)
            self._close(pair)
            self._meet(row)
        return Design(tuple(rows), frozenset(impossible))

    def taken(self, offered: Sequence[Row]) -> list[Row]:
        """Choose rows of `offered`, each time the row with the most new pairs,
        while one has LEAST_NEW_PAIRS.
        """
        rows: list[Row] = []
        known = {row: self._partners(row) for row in offered}
        while known:
            best = max(known, key=lambda row: self._gain(known[row]))
            if self._gain(known.pop(best)) < LEAST_NEW_PAIRS:
                break
            rows.append(best)
            self._meet(best)
        return rows

    def _partners(self, row: Row) -> list[tuple[int, int, int]]:
        """For each level of a row: (factor, level, bits of the levels with which it forms a pair of
        `shown_pairs`).
        """
        levels = list(enumerate(row))
        everyone = sum(1 << self._number(level) for level in levels)
        hidden = [level for level in levels if level in self.hiding]
        found = []
        for level in levels:
            others = [other for other in hidden if other != level]
            met = everyone if not others else 1 << self._number(others[0]) if len(others) == 1 else 0
            found.append((*level, met))
        return found

    def _gain(self, partners: list[tuple[int, int, int]]) -> int:
        """The number of new pairs of levels that a row covers; `partners`, from `_partners`,
        has each pair twice.
        """
        return sum([(self.open[f][k] & met).bit_count() for f, k, met in partners]) // 2

    def _number(self, level: tuple[int, int]) -> int:
        return self.first[level[0]] + level[1]

    def _close(self, pair: Pair) -> None:
        for (f, k), other in (pair, pair[::-1]):
            self.open[f][k] &= ~(1 << self._number(other))

    def _meet(self, row: Row) -> None:
        for f, k, met in self._partners(row):
            self.open[f][k] &= ~met

    def _row(self, goal: Pair) -> Row | None:
        """A row with the pair `goal` and, chosen greedily, many pairs not covered yet;
        None if `goal` is impossible.
        """
        # Fixing factors with one level first rules combinations out at once instead of by search.
        row: Partial = [0 if size == 1 else None for size in self.levels]
        for factor, level in goal:
            row[factor] = level
        if not self._open_everywhere(row):
            return None
        chosen = sum(1 << self._number((f, level)) for f, level in enumerate(row) if level is not None)
        return self._fill(list(row), chosen, goal) or self._fill(row, chosen, goal, hidden=True)

    def _open_everywhere(self, row: Partial) -> bool:
        """True if each factor whose level is still None has a level that is allowed beside the
        chosen levels.
        """
        for factor, value in enumerate(row):
            if value is None:
                levels = range(self.levels[factor])
                if not any(self.allowed([*row[:factor], k, *row[factor + 1 :]]) for k in levels):
                    return False
        return True

    def _fill(self, row: Partial, chosen: int, goal: Pair, hidden: bool = False) -> Row | None:
        if not self.allowed(row):
            return None
        best, factor = -1, -1
        for f, value in enumerate(row):
            if value is None:
                gain = max([(met & chosen).bit_count() for met in self.open[f]])
                if gain > best:
                    best, factor = gain, f
        if factor < 0:
            return tuple(v for v in row if v is not None)
        size = self.levels[factor]
        order = sorted(
            (k for k in range(size) if hidden or (factor, k) not in self.hiding),
            key=lambda k: (-(self.open[factor][k] & chosen).bit_count(), (k + self.shift) % size),
        )
        for level in order:
            row[factor] = level
            found = self._fill(row, chosen | 1 << self.first[factor] + level, goal, hidden)
            if found is not None:
                return found
        row[factor] = None
        return None
