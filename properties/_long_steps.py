"""Cases of the law *energy* that are the same for every seed: cases for single degrees of H,
and long steps.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from sepv import problems
from sepv.law.cases.case import Case
from sepv.law.cases.fixed_cases import FAST_PENDULUM_STATE, longest, split
from sepv.law.tolerance import CONTRACTION
from sepv.problem import NamedProblem, PolynomialSystem
from sepv.problems import planes
from sepv.record import poly


@cache
def for_energy() -> tuple[Case, ...]:
    """Cases that test one degree of H each, and long steps,
    which a scheme may refuse but must not solve wrongly.
    """
    return (*_degrees(), *long_steps())


@cache
def long_steps() -> tuple[Case, ...]:
    """Solvable steps far beyond the contraction radius,
    for which Newton's method takes six or more iterations.

    Two of them start at a small state, from which an iteration with an absolute tolerance stops too
    early.
    """
    found, small = [], tuple(2.0**-20 * v for v in (0.75, 0.5, -0.5))
    long = (
        ("rigid-body", None, (4.0, 8.0)),
        ("pendulum", FAST_PENDULUM_STATE, (1.0, 2.0)),
        ("rigid-body", small, (2.0**22,)),
    )
    for name, y, lengths in long:
        problem = problems.by_name(name)
        assert isinstance(problem.data, NamedProblem)
        start = y or tuple(float(v) for v in np.asarray(problem.initial))
        found += [split(problem.data, start, length, sign) for length in lengths for sign in (1.0, -1.0)]
    return tuple(found)


def _degrees() -> list[Case]:
    """Steps for each degree n of H in which too few quadrature nodes cause thousands of times the
    allowed defect.

    With H = a q^n + p, q changes at a constant rate. It starts at ¼ of |y|, and a is so small
    that q gets as far as 1 inside the contraction radius. The longest step whose solution is
    proved to exist detects one missing node up to n = 14, three missing nodes for n = 17 and four
    for n = 20. More cases for n = 16 and 20 give H as bare functions. The last cases are
    oscillators with H = ½p² + aq^n.
    """
    found = []
    for degree, given in (
        *((n, "data") for n in _KNOWN_DEGREES),
        *((n, "bare functions") for n in _OPAQUE_DEGREES),
    ):
        slope = degree * (degree - 1) * 1.25 ** (degree - 2)
        H = poly.polynomial(2, {(degree, 0): 2.0 ** np.floor(np.log2(CONTRACTION / slope)), (0, 1): 1.0})
        driven = PolynomialSystem(2, H, planes(2), (1.0,))
        found += [replace(case, given=given) for case in longest(driven, (0.25, 1.0))]
    # In an oscillator q is not linear in the time, which matters for a scheme of two stages or
    # more.
    for degree in (3, 4, 6, 8):
        a = 2.0 ** -np.floor(np.log2(degree * (degree - 1)))
        oscillator = PolynomialSystem(2, poly.polynomial(2, {(2, 0): 0.5, (0, degree): a}), planes(2), (1.0,))
        found += longest(oscillator, (1.0, 0.75))
    return found


_KNOWN_DEGREES, _OPAQUE_DEGREES = (3, 4, 5, 6, 7, 8, 9, 10, 12, 14, 17, 20), (16, 20)
