"""Cases that are measured with every seed: each law that applies to them measures them after its design.

A search with a hundred random examples finds a fault that needs a high degree and a long step with most seeds, but not
with every seed. These few cases are the same in each run. They come after the design, so that a small counterexample
is found first, and they are simple already.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from sepv import problems
from sepv.problem import NamedProblem, PolynomialSystem
from sepv.problems import UNIT3, hat, planes
from sepv.record import Polynomial, poly
from sepv.verification._cases.case import Case
from sepv.verification._contraction import CONTRACTION, contraction_radius

# A state of the pendulum from which the angle moves by 1.5 in a step of ½.
_FAST = (3.0, 1.0)


@cache
def fixed_cases() -> tuple[Case, ...]:
    """Polynomial systems of degree 5 and 6 at their contraction radius, and long steps of the paper's problems."""
    return (*_polynomial(), *_papers())


@cache
def for_energy() -> tuple[Case, ...]:
    """Cases that test one degree of H each, and steps that a scheme may refuse but must not return unsolved."""
    return (*_degrees(), *long_steps())


@cache
def long_steps() -> tuple[Case, ...]:
    """Solvable steps far beyond the contraction radius, for which Newton's method takes six or more iterations."""
    found = []
    for name, y, lengths in (("rigid-body", None, (4.0, 8.0)), ("pendulum", _FAST, (1.0, 2.0))):
        problem = problems.by_name(name)
        assert isinstance(problem.data, NamedProblem)
        start = y or tuple(float(v) for v in np.asarray(problem.initial))
        found += [_split(problem.data, start, length, sign) for length in lengths for sign in (1.0, -1.0)]
    return tuple(found)


def may_be_refused(case: Case) -> bool:
    """True for a step of a named problem that is longer than the longest step that every scheme must take."""
    if not isinstance(case.problem, NamedProblem):
        return False
    problem, _, h, dW = case.build()
    return abs(h) + float(np.abs(problem.c * dW).sum()) > (problem.longest_step or 0.0)


def _polynomial() -> list[Case]:
    found = []
    for degree in (5, 6):
        flat = PolynomialSystem(2, _dominated(2, degree), planes(2), (1.0,))
        sphere = PolynomialSystem(3, _dominated(3, degree), hat(), (1.0, 0.5), (UNIT3,))
        found += [_longest(flat, (1.0, 0.75)), _longest(sphere, (1.0, 0.75, -0.5))]
    # Two uncoupled pairs of components, the second at rest: a nonzero guess for the second pair shows in the result.
    found.append(_longest(PolynomialSystem(4, _dominated(4, 6), planes(4), (1.0,)), (1.0, 0.75, 0.0, 0.0)))
    return [case for pair in found for case in pair]


def _dominated(d: int, degree: int) -> Polynomial:
    """H = ½|y|² + ½ y1^n − ¼ y1 y2^(n−1) for the degree n."""
    first = (degree, *(0,) * (d - 1))
    mixed = (1, degree - 1, *(0,) * (d - 2))
    return poly.add(poly.squares((1.0,) * d), poly.polynomial(d, {first: 0.5, mixed: -0.25}))


def _degrees() -> list[Case]:
    """For each degree n of H, steps on which a quadrature with too few nodes is wrong by thousands of bounds.

    With H = a q^n + p, q changes at a constant rate. It starts at ¼ of |y|, and a is so small that q gets as far as 1
    inside the contraction radius. H without a stated degree has degree 16 or 20. The longest step whose solution is
    proved to exist shows one missing node up to degree 14, three missing nodes for degree 17 and four for degree 20.
    """
    found = []
    for degree, given in (*((n, "data") for n in _DEGREES), *((n, "bare functions") for n in _OPAQUE)):
        slope = degree * (degree - 1) * 1.25 ** (degree - 2)
        H = poly.polynomial(2, {(degree, 0): 2.0 ** np.floor(np.log2(CONTRACTION / slope)), (0, 1): 1.0})
        driven = PolynomialSystem(2, H, planes(2), (1.0,))
        found += [replace(case, given=given) for case in _longest(driven, (0.25, 1.0))]
    return found


_DEGREES, _OPAQUE = (3, 4, 5, 6, 7, 8, 9, 10, 12, 14, 17, 20), (16, 20)


def _longest(data: PolynomialSystem, y: tuple[float, ...]) -> tuple[Case, Case]:
    """Two cases with Δ of either sign and |h| + Σ|c_jΔW_j| up to the contraction radius."""
    radius = contraction_radius(problems.build(data), np.array(y))
    return _split(data, y, radius, 1.0), _split(data, y, radius, -1.0)


def _papers() -> list[Case]:
    found = []
    for name in problems.PAPER:
        problem = problems.by_name(name)
        assert isinstance(problem.data, NamedProblem)
        assert problem.longest_step is not None
        y = tuple(float(v) for v in np.asarray(problem.initial))
        for sign in (1.0, -1.0):
            found.append(_split(problem.data, y, problem.longest_step, sign))
    # A fast pendulum, whose angle moves by 1.5: H is no polynomial, and a quadrature with four nodes is not enough.
    fast = problems.by_name("pendulum").data
    assert isinstance(fast, NamedProblem)
    found += [_split(fast, _FAST, 0.5, sign) for sign in (1.0, -1.0)]
    return found


def _split(data: PolynomialSystem | NamedProblem, y: tuple[float, ...], length: float, sign: float) -> Case:
    """The case with Δ = h + Σ c_jΔW_j = ±7/8 of the length, |h| + Σ|c_jΔW_j| at most the length, and h = |Δ|/16."""
    c = problems.build(data).c
    delta = sign * length * 7 / 8
    h = abs(delta) / 16
    part = (delta - h) / np.count_nonzero(c)
    return Case(data, y, h, tuple(float(part / cj) if cj else 0.0 for cj in c))
