"""Cases that are the same for every seed; each law to which they apply measures them in each run.

Some faults show only for a high degree and a long step. A search with a hundred random examples
finds such a fault with most seeds, but not with all. A law measures the fixed cases after its list
of small random cases (its design), so that the first counterexample found is a small one.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from sepv import problems
from sepv.law.cases.case import Case
from sepv.law.contraction import contraction_radius
from sepv.problem import NamedProblem, PolynomialSystem
from sepv.problems import UNIT3, hat, planes
from sepv.record import Polynomial, poly

# A state of the pendulum from which the angle moves by 1.5 in a step of ½.
FAST_PENDULUM_STATE = (3.0, 1.0)


@cache
def fixed_cases() -> tuple[Case, ...]:
    """Steps up to the contraction radius for polynomial H of degree 5 and 6,
    and long steps of the paper's problems.
    """
    return (*_polynomial(), *_papers())


def may_be_refused(case: Case) -> bool:
    """True if a scheme may refuse the step, because it is longer than the built-in problem's
    `longest_step`.
    """
    if not isinstance(case.problem, NamedProblem):
        return False
    problem, _, h, dW = case.build()
    return abs(h) + float(np.abs(problem.c * dW).sum()) > (problem.longest_step or 0.0)


def _polynomial() -> list[Case]:
    found = []
    for degree in (5, 6):
        flat = PolynomialSystem(2, _dominated(2, degree), planes(2), (1.0,))
        sphere = PolynomialSystem(3, _dominated(3, degree), hat(), (1.0, 0.5), (UNIT3,))
        found += [longest(flat, (1.0, 0.75)), longest(sphere, (1.0, 0.75, -0.5))]
    # Two uncoupled pairs of components, the second at rest: a nonzero guess for the second pair
    # shows in the result.
    found.append(longest(PolynomialSystem(4, _dominated(4, 6), planes(4), (1.0,)), (1.0, 0.75, 0.0, 0.0)))
    return [case for pair in found for case in pair]


def many() -> tuple[Case]:
    """A case with the largest d and m, in which the last components and noises matter as much as
    the others.
    """
    d, m = 40, 20
    H = poly.add(poly.squares((1.0,) * d), poly.polynomial(d, {(*(0,) * (d - 2), 1, 3): 0.25}))
    c = tuple(2.0 ** -(n % 5) for n in range(m))
    return (longest(PolynomialSystem(d, H, planes(d), c), tuple(0.5 + n / 80 for n in range(d)))[0],)


def _dominated(d: int, degree: int) -> Polynomial:
    """The Hamiltonian H = ½|y|² + ½ y1^n − ¼ y1 y2^(n−1) of degree n, where y1,
    y2 are the first components of y.
    """
    first = (degree, *(0,) * (d - 1))
    mixed = (1, degree - 1, *(0,) * (d - 2))
    return poly.add(poly.squares((1.0,) * d), poly.polynomial(d, {first: 0.5, mixed: -0.25}))


def longest(data: PolynomialSystem, y: tuple[float, ...]) -> tuple[Case, Case]:
    """Two cases, with Δ > 0 and Δ < 0, in which |h| + Σ|c_jΔW_j| is nearly the contraction
    radius.
    """
    radius = contraction_radius(problems.build(data), np.array(y))
    return split(data, y, radius, 1.0), split(data, y, radius, -1.0)


def _papers() -> list[Case]:
    found = []
    for name in problems.PAPER:
        problem = problems.by_name(name)
        assert isinstance(problem.data, NamedProblem)
        assert problem.longest_step is not None
        y = tuple(float(v) for v in np.asarray(problem.initial))
        for sign in (1.0, -1.0):
            found.append(split(problem.data, y, problem.longest_step, sign))
    # A fast pendulum, whose angle moves by 1.5: H is no polynomial, and a quadrature with four
    # nodes is not enough.
    fast = problems.by_name("pendulum").data
    assert isinstance(fast, NamedProblem)
    found += [split(fast, FAST_PENDULUM_STATE, 0.5, sign) for sign in (1.0, -1.0)]
    return found


def split(data: PolynomialSystem | NamedProblem, y: tuple[float, ...], length: float, sign: float) -> Case:
    """The case with |h| + Σ|c_jΔW_j| ≤ `length`, h = |Δ|/16 and Δ = h + Σ c_jΔW_j = ±⅞ `length`,
    with this `sign`.
    """
    c = problems.build(data).c
    delta = sign * length * 7 / 8
    h = abs(delta) / 16
    part = (delta - h) / np.count_nonzero(c)
    return Case(data, y, h, tuple(float(part / cj) if cj else 0.0 for cj in c))
