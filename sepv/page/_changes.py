"""The difference between two reports of one scheme, law by law."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from sepv.page._text import name, number, plain
from sepv.page._verdicts import shown_verdict
from sepv.page._views import View

# A defect has changed if it is larger or smaller by this factor, a measured order if by this
# difference. A run with the same seed and the same versions has the same defects to the last digit.
CHANGED_FACTOR, CHANGED_ORDER = 2.0, 0.1


def changes(reports: Sequence[View]) -> list[tuple[str, list[tuple[str, str, str]]]]:
    """Compare each report with the next one of the same scheme:
    (scheme, rows of law, before and after).

    A row stands for a law whose verdict, claim or defect differs, or that one of the reports lacks.
    Reports of a scheme that no other report in the list is about give no entry.
    """
    by_scheme: dict[str, list[View]] = {}
    for report in reports:
        by_scheme.setdefault(str(report["scheme"]["name"]), []).append(report)
    return [
        (name(scheme), _rows(before, after))
        for scheme, of_scheme in by_scheme.items()
        for before, after in pairwise(of_scheme)
    ]


def _rows(before: View, after: View) -> list[tuple[str, str, str]]:
    old, new = ({law["law"]: law for law in report["laws"]} for report in (before, after))
    return [
        (name(law), _words(old.get(law)), _words(new.get(law)))
        for law in dict.fromkeys((*old, *new))
        if law not in old or law not in new or _differs(old[law], new[law])
    ]


def _differs(old: View, new: View) -> bool:
    if any(old[key] != new[key] for key in ("verdict", "claimed", "unit")):
        return True
    if (old["expected"] is None) != (new["expected"] is None):
        return True
    a, b = old["defect"], new["defect"]
    if a is None or b is None:
        return a is not b
    if old["at_least"]:
        return bool(abs(a - b) >= CHANGED_ORDER)
    return bool(max(abs(a), abs(b)) >= CHANGED_FACTOR * min(abs(a), abs(b)) and a != b)


def _words(law: View | None) -> str:
    """The verdict with the defect against the bound, such as: violated,
    2.1e+09 against 34 ulp of H, claimed.
    """
    if law is None:
        return "not measured"
    size = ""
    if law["defect"] is not None and law["bound"] is not None:
        size = f", {number(law['defect'])} against {number(law['bound'])} {plain(law['unit'], 40)}"
    return f"{shown_verdict(law)}{size}" + (", claimed" if law["claimed"] and law["expected"] is None else "")
