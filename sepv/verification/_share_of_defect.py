"""The part of a step that makes most of its defect: the term in h, in one c_jΔW_j, or in the product of two of them.

Each part is asked alone, all with the same size, and so is each pair. A fault of one term shows with its part alone and
with no other. A product shows with its pair alone, and halves with each of the two. What is neither is not named.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np

from sepv import problems
from sepv.verification._cases.case import Case
from sepv.verification._law import Measurement

Parts = dict[int, float]
# A term is named where it makes this share of all defects of single parts; a product where single parts make less than
# the second share of it, and where half of a part leaves half of it, to a tenth.
MOST, LEAST, HALF = 0.95, 1e-3, (0.45, 0.55)
# The most parts of a step of which pairs are asked.
PARTS = 5


def largest_share(case: Case, measured: Callable[[Case], Measurement | None]) -> str:
    """The line that names the largest share of a violation, or nothing where none is clear.

    `measured` is the law's measurement of another case, None where it cannot be made.
    """
    c = problems.build(case.problem).c
    loud: list[int] = [0, *(np.flatnonzero(c) + 1).tolist()] if case.h else []
    if not 2 <= len(loud) <= PARTS:
        return ""
    size = float(min(abs(case.h), *np.abs(c * case.dW)[c != 0])) or abs(case.h) / len(loud)

    def found(parts: Parts) -> Measurement:
        dW = tuple(parts.get(j + 1, 0.0) * size / cj if cj else 0.0 for j, cj in enumerate(c))
        other = measured(replace(case, h=float(np.copysign(parts.get(0, 0.0) * size, case.h)), dW=dW))
        return Measurement(float("nan"), 0.0) if other is None else other

    alone = {j: found({j: 1.0}) for j in loud}
    total = sum(m.defect for m in alone.values())
    first = max(alone, key=lambda j: alone[j].defect)
    if alone[first].violates and alone[first].defect >= MOST * total:
        return f"\nnearly all of it is in {_name(first)}: alone it makes {_defects(alone)}"
    for j, k in combinations(loud, 2):
        both = found({j: 1.0, k: 1.0})
        halves = [
            found({j: a, k: b}).defect / both.defect for a, b in ((0.5, 1.0), (1.0, 0.5)) if both.defect
        ]
        least = max(alone[j].defect, alone[k].defect) <= LEAST * both.defect
        if both.violates and least and halves and all(HALF[0] <= share <= HALF[1] for share in halves):
            return f"\nnearly all of it is in the product of {_name(j)} and {_name(k)}, each of which alone makes none"
    return ""


def _name(j: int) -> str:
    return "h" if j == 0 else f"c{j} ΔW{j}"


def _defects(alone: dict[int, Measurement]) -> str:
    return ", ".join(f"{m.defect:.2g} with {_name(j)}" for j, m in alone.items())
