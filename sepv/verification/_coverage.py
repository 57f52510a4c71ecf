"""Coverage by the laws' lists of cases (designs): the number of cases in each range,
and the pairs of ranges met.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from rich.console import Console

from sepv.console import Table, columns, fits, print_table
from sepv.law import Law, corpus
from sepv.law.cases.strata import KIND, Space
from sepv.law.cases.users_problems import sources
from sepv.schemes import Scheme


def pairs(space: Space) -> tuple[int, int]:
    """Count the pairs of property ranges (strata): those that a case of the design has,
    and those that are possible.
    """
    design = space.design()
    sizes = [len(axis.strata) for axis in space.axes]
    every = (sum(sizes) ** 2 - sum(n * n for n in sizes)) // 2
    met = {pair for row in design.rows for pair in space.shown(row)}
    return len(met), every - len(design.impossible)


def cases_by_stratum(space: Space) -> dict[tuple[str, str], int]:
    """The number of a space's listed cases in each stratum (range), by the names of axis (property)
    and stratum.
    """
    counts = Counter(
        (axis, stratum.name) for row in space.design().rows for axis, stratum in space.levels(row).items()
    )
    return counts + Counter((KIND, kind) for kind in space.further(0))


def impossible(space: Space) -> dict[str, list[str]]:
    """For each reason, the pairs of strata (property ranges) that no case can have."""
    by_axis: dict[str, list[str]] = {}
    for pair in sorted(space.design().impossible):
        names = [f"{space.axes[f].name} {space.axes[f].strata[k].name}" for f, k in pair]
        by_axis.setdefault(space.impossible(pair), []).append(" and ".join(names))
    return by_axis


def show(laws: Iterable[Law], scheme: Scheme, out: Console) -> None:
    """Print how many cases of each stratum (property range) these laws measure for a scheme:
    of its class or problems.

    A problem that is no family has no design: its cases are drawn near its initial state.
    """
    asked = list(laws)
    if not scheme.problems:
        own = {law.name: law.cases.space(scheme.systems) if law.cases else None for law in asked}
        witnesses = {name: len(corpus.cases(name, scheme.systems)) for name in own}
        _show(own, witnesses, out)
    for item in sources(scheme):
        named = item.text or getattr(item.fixed, "name", "") or "a strategy"
        if item.space is None:
            out.print(
                f"{named}: no design; cases are drawn near its initial state, with steps of all lengths"
            )
            continue
        out.print(f"{named}:")
        usable = [law for law in asked if law.cases and item.meets(law.cases.adapted, law.cases.where)]
        own = {law.name: item.part(law.cases.where) if law in usable and law.cases else None for law in asked}
        _show(own, dict.fromkeys(own, 0), out)


def _show(chosen: dict[str, Space | None], witnesses: dict[str, int], out: Console) -> None:
    """Print the tables of `show` for the space of each law; None for a law without a design."""
    spaces = {name: space for name, space in chosen.items() if space is not None}
    order = list(spaces)
    counts = {name: cases_by_stratum(spaces[name]) for name in order}
    rows: list[list[str]] = []
    for name in order:
        met, possible = pairs(spaces[name])
        design = spaces[name].design()
        numbers = (witnesses[name], len(design.rows), met, possible, len(design.impossible))
        rows.append([name, *map(str, numbers)])
    heads = columns(["law"], ["witnesses", "cases", "pairs met", "possible", "impossible"])
    title = "Cases by design, and pairs of strata that they meet"
    print_table(Table(heads, rows, title, ruled=True), out)
    out.print("witnesses: cases that caught a fault once (docs/vectors.md), asked before the design")
    shown = (axis for name in order for axis in spaces[name].axes)
    seen = dict.fromkeys((axis.name, stratum.name) for axis in shown for stratum in axis.strata)
    seen |= dict.fromkeys((KIND, kind.name) for name in order for kind in spaces[name].kinds)
    axes = list(dict.fromkeys(axis for axis, _ in seen))
    keys = sorted(seen, key=lambda key: axes.index(key[0]))

    def strata(laws: list[str]) -> Table:
        rows: list[list[str]] = []
        for number, key in enumerate(keys):
            cells = [counts[name].get(key, 0) for name in laws]
            axis = "" if number and keys[number - 1][0] == key[0] else key[0]
            every = sum(counts[name].get(key, 0) for name in order)
            rows.append([axis, key[1], str(every), *(str(n) if n else "·" for n in cells)])
        heads = columns(["axis", "stratum"], ["all", *(name[:5] for name in laws)])
        return Table(heads, rows, "Cases in each stratum", ruled=True)

    left = order
    while left:  # print as many columns of laws as fit on the terminal
        count = next((n for n in range(len(left), 1, -1) if fits(strata(left[:n]), out)), 1)
        print_table(strata(left[:count]), out)
        left = left[count:]
    reasons: dict[str, dict[str, None]] = {}
    for name in order:
        for reason, listed in impossible(spaces[name]).items():
            reasons.setdefault(reason, {}).update(dict.fromkeys(listed))
    for reason, which in reasons.items():
        out.print(f"impossible, {reason}: {'; '.join(which)}", soft_wrap=True)
    others = [name for name in chosen if name not in spaces]
    out.print(f"without a design: {', '.join(others) or 'none'}", soft_wrap=True)
