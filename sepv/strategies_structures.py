"""Hypothesis strategies for the other classes of systems, and from which of them each law draws its cases.

Random Nambu systems g(y), C(y), H(y) in dimension three. Coefficients are small dyadic rationals, as in
`sepv.strategies`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from hypothesis import strategies as st

from sepv import polynomial as poly
from sepv import problems
from sepv.case import Case
from sepv.polynomial import Polynomial
from sepv.problem import NamedProblem, PolynomialSystem
from sepv.strategies import (
    coefficients,
    components,
    contraction_ball,
    hamiltonians,
    noises,
    paper_steps,
    polynomials,
    steps,
)

# As the law "expansion" has it: Δ as a share of the radius inside which y1(Δ) is analytic.
SHARE = 2.0**-9
Cases = Callable[[], st.SearchStrategy[Case]]


def sphere() -> Polynomial:
    """½|y|² in three variables."""
    return poly.polynomial(3, {tuple(2 * int(i == k) for i in range(3)): 0.5 for k in range(3)})


@st.composite
def factors(draw: st.DrawFn) -> Polynomial:
    """g of degree 0 to 2. Examples shrink towards 1."""
    if draw(st.booleans()):
        return draw(polynomials(3, 2, least=0, terms=2))
    return poly.constant(3, 1.0)


@st.composite
def nambu_systems(
    draw: st.DrawFn,
    *,
    degree: int = 6,
    casimirs: st.SearchStrategy[Polynomial] | None = None,
    factor: st.SearchStrategy[Polynomial] | None = None,
    noise: st.SearchStrategy[tuple[float, ...]] | None = None,
) -> PolynomialSystem:
    """B(y)v = g(y)(v × ∇C(y)), H of degree 1 to `degree`, C of degree 1 to 4 by default.

    Examples shrink towards H = C = ½|y|² and g = 1.
    """
    C = draw(hamiltonians(3, 4) if casimirs is None else casimirs)
    g = draw(factors() if factor is None else factor)
    return problems.nambu_system(draw(hamiltonians(3, degree)), g, C, draw(noise or noises()))


def quadratic_casimirs() -> st.SearchStrategy[Polynomial]:
    """Homogeneous quadratic C, which (2.1) keeps too. Examples shrink towards ½|y|²."""
    more = polynomials(3, 2, least=2)
    return st.one_of(
        st.just(sphere()), more, more.map(lambda p: poly.add(sphere(), p)).filter(lambda p: p.terms)
    )


def linear_casimirs() -> st.SearchStrategy[Polynomial]:
    """C = bᵀy: a constant B where g is one."""
    return polynomials(3, 1, least=1)


def nambu_paper_steps() -> st.SearchStrategy[Case]:
    """Steps of the rigid body and of Lotka-Volterra."""
    names = ("rigid-body", "lotka-volterra")
    return paper_steps().filter(lambda c: isinstance(c.problem, NamedProblem) and c.problem.name in names)


def nambu_steps() -> st.SearchStrategy[Case]:
    """Steps of random Nambu systems and of the paper's two."""
    return st.one_of(steps(nambu_systems()), nambu_paper_steps())


def _noisy() -> st.SearchStrategy[Case]:
    """With c_1 = 1, as the way back of the law "symmetry" needs."""
    first = noises(least=1).map(lambda c: (1.0, *c[1:]))
    return st.one_of(steps(nambu_systems(noise=first)), nambu_paper_steps())


@st.composite
def _no_step(draw: st.DrawFn) -> Case:
    """Noise that cancels h exactly: Δ = h + c ΔW = 0."""
    case = draw(steps(nambu_systems(noise=st.just((0.5,)))))
    return Case(case.problem, case.y, case.h, (-2 * case.h,))


@st.composite
def _at_rest(draw: st.DrawFn) -> Case:
    """∇H(0) = 0: H has terms of degree ≥ 2 only."""
    H = draw(hamiltonians(3, 5, least=2))
    system = problems.nambu_system(H, draw(factors()), draw(hamiltonians(3, 4)))
    return Case(system, (0.0, 0.0, 0.0), draw(st.sampled_from([1.0, 0.25])), (draw(components()),))


@st.composite
def _at_origin(draw: st.DrawFn) -> Case:
    """y0 = 0, with the linear and quadratic terms of H and C and the constant and linear ones of g."""

    def function() -> Polynomial:
        linear = [(tuple(int(i == k) for i in range(3)), draw(coefficients())) for k in range(3)]
        more = draw(polynomials(3, 4, least=2)) if draw(st.booleans()) else poly.polynomial(3, {})
        return poly.add(poly.polynomial(3, linear), sphere(), more)

    g = poly.add(poly.constant(3, 1.0), draw(polynomials(3, 2, least=1, terms=3)))
    system = problems.nambu_system(function(), g, function())
    radius = contraction_ball(problems.build(system), np.zeros(3))[0]
    step = SHARE * min(radius, 1.0)
    return Case(system, (0.0, 0.0, 0.0), step, (draw(st.sampled_from([0.0, 0.5, -0.25])) * step,))


def _constant_structure() -> st.SearchStrategy[Case]:
    """Constant B with noise; any B with noise of size zero."""
    one = st.just(poly.constant(3, 1.0))
    constant = nambu_systems(casimirs=linear_casimirs(), factor=one, noise=noises(least=1))
    return st.one_of(steps(constant), steps(nambu_systems(noise=st.just((0.0, 0.0)))))


def _several_noises() -> st.SearchStrategy[Case]:
    return steps(nambu_systems(noise=noises(least=1, most=2).map(lambda c: (1.0, *c))))


def _small() -> st.SearchStrategy[Case]:
    """Small enough that a substitution stays readable."""
    return steps(nambu_systems(degree=4, casimirs=hamiltonians(3, 3)))


NAMBU: dict[str, Cases] = {
    **dict.fromkeys(("contract", "reproducibility", "energy", "reference"), nambu_steps),
    "casimir": lambda: steps(nambu_systems(casimirs=st.one_of(quadratic_casimirs(), linear_casimirs()))),
    "any-casimir": nambu_steps,
    "identity": lambda: st.one_of(_no_step(), _at_rest()),
    "midpoint": lambda: steps(nambu_systems(degree=2, casimirs=quadratic_casimirs())),
    "reduction": _constant_structure,
    "noise-sum": _several_noises,
    "expansion": _at_origin,
    "symmetry": _noisy,
    "equivariance": _small,
}

# For each class of systems other than all of (1.1): where a law draws its cases.
CASES: dict[str, dict[str, Cases]] = {"nambu": NAMBU}
