"""Cases for a scheme that clips its increments itself: no increment exceeds √h A_h,
A_h = √(2k|ln h|) (Remark 2.1).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from sepv.errors import SepvError
from sepv.law.cases.case import Case, with_noise
from sepv.law.cases.ends import in_other_units
from sepv.law.units import units_of
from sepv.problem import Array, PolynomialSystem, Problem
from sepv.schemes import Scheme, ask
from sepv.simulate import truncation_bound

# A probe's h, relative to ΔW²: its increments are 10⁶ √h, beyond √h A_h for every k that a scheme
# could state.
PROBE_STEP_RATIO = 2.0**-40
# The number of cases that are probed for a response.
PROBES = 3
_CLIPPING: WeakKeyDictionary[Scheme, bool] = WeakKeyDictionary()


def longest_increment(problem: Problem, h: float, k: int) -> float:
    """The bound √h A_h of |ΔW_j|, or 0 if |h| is not between 0 and 1, where Remark 2.1 has no rule.

    A problem given by functions has a unit of time τ, and a scheme may use h or h/τ: then it is the
    lesser bound.
    """
    sizes = [abs(h)] if problem.data is not None else [abs(h), abs(h) / units_of(problem).time]
    if not all(0 < size < 1 for size in sizes):
        return 0.0
    return min(truncation_bound(size, k) for size in sizes) * math.sqrt(abs(h))


def fits(problem: Problem, h: float, dW: Array, k: int) -> bool:
    """True if no increment that acts exceeds √h A_h."""
    acting = np.abs(dW[problem.c != 0])
    return not acting.any() or bool(acting.max() <= longest_increment(problem, h, k))


def within(case: Case, k: int) -> Case | None:
    """The case with increments up to √h A_h, or None if h = 0,
    or if |h| ≥ 1 for a problem that is not data.

    Of data the unit of time becomes larger until |h| ≤ ½. Then c_j 2ⁿ and ΔW_j 2⁻ⁿ replace c_j and
    ΔW_j, so that every c_jΔW_j keeps its bits. Other problems keep their c_j, and ΔW_j 2⁻ⁿ alone
    makes the step shorter.
    """
    problem, _, h, dW = case.build()
    if fits(problem, h, dW, k):
        return case
    data = isinstance(case.problem, PolynomialSystem)
    if data and abs(h) > 0.5:
        case = in_other_units(case, 0, -math.ceil(math.log2(2 * abs(h)) / 2))
        problem, _, h, dW = case.build()
    most, largest = longest_increment(problem, h, k), float(np.abs(dW[problem.c != 0]).max())
    if not most:
        return None
    share = 2.0 ** -max(0, math.ceil(math.log2(largest / most)))
    shorter = tuple(share * w for w in case.dW)
    return (
        with_noise(case, tuple(float(c / share) for c in problem.c), shorter)
        if data
        else replace(case, dW=shorter)
    )


def clips(scheme: Scheme, cases: Iterable[Case] = ()) -> bool:
    """True if the scheme clips increments itself: ΔW and ΔW/2 give the same y1 ≠ y if both are far
    beyond √h A_h.

    Up to PROBES cases are tried until one has y1 ≠ y. The answer is kept for later calls without
    cases.
    """
    if scheme.truncation is None or scheme in _CLIPPING:
        return _CLIPPING.get(scheme, False)
    acting = (case for case in cases if np.any(case.build()[0].c * np.array(case.dW)))
    for case, _ in zip(acting, range(PROBES), strict=False):
        problem, y, _, dW = case.build()
        h = min(PROBE_STEP_RATIO * float(np.min(dW[problem.c * dW != 0] ** 2)), PROBE_STEP_RATIO)
        with suppress(SepvError):
            whole, half = ask(scheme, problem, y, h, dW), ask(scheme, problem, y, h, dW / 2)
            if not np.array_equal(whole, y):
                _CLIPPING[scheme] = np.array_equal(whole, half)
                return _CLIPPING[scheme]
    return False
