"""Near-preservation: the power of h with which the defect of a violated invariant or structure
falls.

Many schemes keep an invariant or a structure up to a power of h. For a violation the power is
measured at the counterexample, and at the first violation that was found: in a simplified case,
terms of low powers may vanish. The smaller power is reported. h is halved again and again, and
each ΔW is divided by √2, so that it stays a typical increment of a step h. If the defect is C h^p
(1 + O(√h)), the slopes p_k = log₂(defect(h_k)/defect(h_k/2)) converge to p. With noise, p may be a
multiple of ½: a defect O(Δ³) is O(h^{3/2}), because Δ = h + Σ c_jΔW_j is O(√h).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise

from sepv.law._law import Measurement
from sepv.law.cases.case import Case

# The most halvings of h. Defects of at most DEFECT_FLOOR times their bound are not used, because
# rounding may change them.
MAX_HALVINGS_OF_H, DEFECT_FLOOR = 16, 2.0
# The power is clear if the last SLOPES slopes differ by at most SLOPES_MAX_APART. For p = 1 and p =
# 3/2 slopes differ by ½.
SLOPES, SLOPES_MAX_APART = 2, 0.2


Again = Callable[[Case], Measurement | None]


def least_power(violations: Iterable[tuple[Case, Measurement] | None], again: Again) -> float | None:
    """The smallest power of h at these violations, as `power_of_h` measures it;
    None if it is clear at none.
    """
    known = dict.fromkeys(violation for violation in violations if violation is not None)
    powers = [power_of_h(case, measured, again) for case, measured in known]
    return min((p for p in powers if p is not None), default=None)


def power_of_h(case: Case, measured: Measurement, again: Again) -> float | None:
    """The power p of h in the defect of a `case` with the measurement `measured`;
    None if no power is clear.

    `again` measures another case by the violated law; it returns None if that fails.
    """
    defects = [measured.defect]
    for k in range(1, MAX_HALVINGS_OF_H + 1):
        share = 2.0**-k
        shorter = again(replace(case, h=share * case.h, dW=tuple(math.sqrt(share) * w for w in case.dW)))
        if shorter is None or not DEFECT_FLOOR * shorter.bound < shorter.defect < math.inf:
            break
        defects.append(shorter.defect)
    if not 0 < defects[0] < math.inf:
        return None
    slopes = [math.log2(long / short) for long, short in pairwise(defects)][-SLOPES:]
    if len(slopes) < SLOPES or max(slopes) - min(slopes) > SLOPES_MAX_APART:
        return None
    return slopes[-1]


def words(power: float | None) -> str:
    """The line of a message about the power of h."""
    if power is None:
        return "with which power of h the defect falls is not clear"
    if abs(power) <= SLOPES_MAX_APART:
        return "the defect does not fall with h"
    whole = round(2 * power) / 2  # powers are multiples of ½
    shown = f"{whole:g}" if abs(power - whole) <= SLOPES_MAX_APART / 2 else f"{power:.1f}"
    return f"the defect {'falls' if power > 0 else 'grows'} like h^{shown} (h halved, ΔW ~ √h)"
