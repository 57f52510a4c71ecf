"""The rules by which one benchmark record (head) is worse or better than another (base).

A count of work is worse if it is larger, even by one, because counts have no noise. For an error or
a defect, the ratio head/base is computed on the same paths. Each end of its jackknife interval is
wrong with probability 1e-3. The error is worse if the interval is above 1 and the ratio above a
tolerance. For times, see `sepv.studies._bench.pairs`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sepv._arguments import hex_float
from sepv.errors import UsageError
from sepv.problem import Array
from sepv.statistics import jackknife_half

GATE_ALPHA = 1e-3
# Another order of summation changes an error only by rounding, so a change of one per cent comes
# from the scheme.
ERROR_TOLERANCE = 1.01
# A defect of the size of rounding errors changes by tens of per cent with the order of summation.
DEFECT_TOLERANCE = 1.5
TOLERANCE_OF_KIND = {"error": ERROR_TOLERANCE, "energy": DEFECT_TOLERANCE, "casimir": DEFECT_TOLERANCE}


@dataclass(frozen=True)
class MeasuredChange:
    """The change of one measured number of a case between two records.

    what : the name of the number: a count of work, the error, a defect or a time
    verdict : "same", "better", "worse" or, only for a time, "not settled"
    text : both values, or their ratio with its interval
    """

    target: str
    case: str
    what: str
    verdict: str
    text: str


def check(head: dict[str, Any], base: dict[str, Any]) -> list[MeasuredChange]:
    """List the changes of one target from the record `base` to the record `head`,
    in each case of `base`.

    Raises UsageError if `head` lacks a case of `base`, or has it with other settings.
    """
    ours = {c["case"]["name"]: c for c in head["cases"]}
    checks = []
    for theirs in base["cases"]:
        case = theirs["case"]
        mine = ours.get(case["name"])
        if mine is None or mine["case"] != case:
            raise UsageError(
                expected=f"the case {case['name']} as the other record has it",
                received="another one, or none",
                remedy="measure both with the same cases",
            )
        checks += _counters(head["target"], case["name"], mine["counters"], theirs["counters"])
        checks += [
            _ratio(head["target"], case["name"], kind, mine[kind], theirs[kind]) for kind in TOLERANCE_OF_KIND
        ]
    return checks


def _counters(target: str, case: str, ours: dict[str, Any], theirs: dict[str, Any]) -> list[MeasuredChange]:
    checks = []
    for name in dict.fromkeys((*theirs, *ours)):
        # None means not reported. A newly reported counter cannot be compared.
        mine, other = ours.get(name), theirs.get(name)
        if mine is None or other is None:
            continue
        verdict = "same" if mine == other else "worse" if mine > other else "better"
        text = f"{mine}" if mine == other else f"{other} → {mine} ({mine - other:+d})"
        checks.append(MeasuredChange(target, case, name, verdict, text))
    return checks


def _ratio(target: str, case: str, kind: str, ours: list[str], theirs: list[str]) -> MeasuredChange:
    head, base = (np.array([hex_float(v) for v in groups]) for groups in (ours, theirs))
    if np.array_equal(head, base):
        return MeasuredChange(target, case, kind, "same", f"{rms(ours):.3g}")
    value, low, high = ratio(head, base)
    tolerance = TOLERANCE_OF_KIND[kind]
    verdict = "same"
    if not np.isfinite(value) or (low > 1 and value > tolerance):
        verdict = "worse"
    elif high < 1 and value < 1 / tolerance:
        verdict = "better"
    text = f"{rms(theirs):.3g} → {rms(ours):.3g}, ratio {value:.3f} in [{low:.3f}, {high:.3f}]"
    return MeasuredChange(target, case, kind, verdict, text)


def ratio(head: Array, base: Array) -> tuple[float, float, float]:
    """The ratio √(mean head / mean base) of two rms values,
    and the lower and upper end of its interval.

    `head` and `base` are mean squares over the same groups of paths. Each end is wrong with
    probability GATE_ALPHA.
    """
    with np.errstate(all="ignore"):
        whole = 0.5 * np.log(np.mean(head) / np.mean(base))
        left_out = 0.5 * np.log((np.sum(head) - head) / (np.sum(base) - base))
        width = jackknife_half(left_out, 2 * GATE_ALPHA)
        return float(np.exp(whole)), float(np.exp(whole - width)), float(np.exp(whole + width))


def rms(groups: list[str]) -> float:
    """The rms over all paths, from the mean squares over groups of paths,
    which records hold as hex floats.
    """
    return float(np.sqrt(np.mean([hex_float(v) for v in groups])))
