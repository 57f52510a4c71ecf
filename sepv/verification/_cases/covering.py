"""Pairwise covering designs: few rows in which every possible pair of levels of two factors occurs.

A fault that shows where one factor has one level, or two factors have two, is then met for certain and not with some
probability. The construction is greedy, as that of Cohen, Dalal, Fredman and Patton (IEEE Trans. Softw. Eng. 23, 1997),
with constraints; ties are broken in several fixed ways and the smallest design is kept. The same factors give the same
design.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

Row = tuple[int, ...]
Partial = list[int | None]
Level = tuple[int, int]  # of a factor
# In the order of factors.
Pair = tuple[Level, Level]
# Ways of breaking ties.
ATTEMPTS = 4
# Open pairs that a row must meet to be taken because it is offered: where fewer are left, one row made for them meets
# more of them.
LEAST = 4


@dataclass(frozen=True)
class Design:
    """Rows, one level of each factor in each, and the pairs of levels that no row can have."""

    rows: tuple[Row, ...]
    impossible: frozenset[Pair]


def pairwise(
    levels: Sequence[int],
    allowed: Callable[[Partial], bool],
    hiding: frozenset[Level] = frozenset(),
    offered: Sequence[Row] = (),
) -> Design:
    """A design for factors with so many levels each.

    `allowed` says whether a row may go on from here, with None for a level that is still open: what is refused stays
    refused whatever is filled in. Beside the levels `hiding` a fault of other factors may not show: pairs of others are
    not met in such a row, unless they are possible in no other. Of the rows `offered`, which are allowed and cheaper
    than others, those that meet many pairs are taken first.
    """
    taken = _Greedy(levels, allowed, hiding, 0).taken(offered)
    designs = [_Greedy(levels, allowed, hiding, shift).design(taken) for shift in range(ATTEMPTS)]
    return min(designs, key=lambda design: len(design.rows))


def shown_pairs(row: Row, hiding: frozenset[tuple[int, int]] = frozenset()) -> list[Pair]:
    """The pairs of levels that are met in a row: all, but beside a level that hides only those with it."""
    hidden = {level for level in enumerate(row) if level in hiding}
    return [pair for pair in combinations(enumerate(row), 2) if hidden <= set(pair)]


class _Greedy:
    """One attempt. Levels have numbers through all factors, and sets of levels are bits of an integer."""

    def __init__(
        self, levels: Sequence[int], allowed: Callable[[Partial], bool], hiding: frozenset[Level], shift: int
    ) -> None:
        self.levels, self.allowed, self.hiding, self.shift = levels, allowed, hiding, shift
        self.first = [sum(levels[:f]) for f in range(len(levels))]
        everything = (1 << sum(levels)) - 1
        # For each level, those of other factors that it was not yet met with.
        self.open = [
            [everything & ~(((1 << size) - 1) << self.first[f])] * size for f, size in enumerate(levels)
        ]

    def design(self, taken: Sequence[Row]) -> Design:
        """`taken` and the rows that it lacks."""
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
        """Of the rows offered those that meet the most open pairs each, down to LEAST."""
        rows: list[Row] = []
        known = {row: self._partners(row) for row in offered}
        while known:
            best = max(known, key=lambda row: self._gain(known[row]))
            if self._gain(known.pop(best)) < LEAST:
                break
            rows.append(best)
            self._meet(best)
        return rows

    def _partners(self, row: Row) -> list[tuple[int, int, int]]:
        """The levels of a row as (factor, level), each with those that it meets there, as in `shown_pairs`."""
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
        """How many open pairs are met in a row, each of which is counted from both sides."""
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
        """A row with the pair `goal` and many other open pairs, by a greedy choice; None where there is none."""
        # A factor with one level has it: what that rules out is then seen at once, and not by trying all else.
        row: Partial = [0 if size == 1 else None for size in self.levels]
        for factor, level in goal:
            row[factor] = level
        if not self._open_everywhere(row):
            return None
        chosen = sum(1 << self._number((f, level)) for f, level in enumerate(row) if level is not None)
        return self._fill(list(row), chosen, goal) or self._fill(row, chosen, goal, hidden=True)

    def _open_everywhere(self, row: Partial) -> bool:
        """Whether each factor that is still open has a level that goes with what is chosen."""
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
