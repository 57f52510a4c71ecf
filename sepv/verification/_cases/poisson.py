"""Hypothesis strategies for Poisson structures, which satisfy Jacobi's identity by construction, and for their steps.

- constant skew B, of any dimension and rank;
- b(y)J in dimension two: Jacobi's identity asks nothing there;
- g(y) hat(∇C(y)) in dimension three: w = g∇C has w · curl w = 0 (`sepv.verification._cases.structures.nambu_systems`);
- Lie-Poisson structures, linear in y (`sepv.verification._cases.families.lie_poisson`);
- B_ij = b_ij y_i y_j with b skew: constant in the logarithms of y.
"""

from __future__ import annotations

from itertools import combinations

from hypothesis import strategies as st

from sepv.problem import PolynomialSystem
from sepv.problems._common import planes
from sepv.record import _polynomial as poly
from sepv.verification import strategies as some
from sepv.verification._cases.case import Case
from sepv.verification._cases.families import lie_poisson
from sepv.verification._cases.structures import nambu_systems


@st.composite
def constant_structures(draw: st.DrawFn) -> PolynomialSystem:
    """Constant skew B of dimension 2 to 6, canonical or any. Examples shrink towards the oscillator."""
    d = draw(st.integers(2, 6))
    B = planes(d) if draw(st.booleans()) else draw(some.skew_structures(d, 0))
    return PolynomialSystem(d, draw(some.hamiltonians(d, 6)), B, draw(some.noises()))


@st.composite
def planar_structures(draw: st.DrawFn) -> PolynomialSystem:
    """b(y)J with a polynomial b."""
    b = draw(some.polynomials(2, 3, least=0, terms=3))
    return PolynomialSystem(2, draw(some.hamiltonians(2, 6)), ((0, 1, b),), draw(some.noises()))


@st.composite
def quadratic_structures(draw: st.DrawFn) -> PolynomialSystem:
    """B_ij = b_ij y_i y_j, as that of Lotka-Volterra, of dimension 2 to 5."""
    d = draw(st.integers(2, 5))
    variables = [poly.variable(d, k) for k in range(d)]
    B = tuple(
        (i, j, poly.scale(draw(some.coefficients()), poly.multiply(variables[i], variables[j])))
        for i, j in combinations(range(d), 2)
        if j == i + 1 or draw(st.booleans())
    )
    return PolynomialSystem(d, draw(some.hamiltonians(d, 4)), B, draw(some.noises()))


def poisson_structures() -> st.SearchStrategy[PolynomialSystem]:
    """All kinds of Poisson structures, with any polynomial H."""
    return st.one_of(
        constant_structures(), planar_structures(), nambu_systems(), lie_poisson(), quadratic_structures()
    )


def poisson_steps() -> st.SearchStrategy[Case]:
    """Steps of random Poisson systems and of the paper's problems, all of which are Poisson systems."""
    return st.one_of(some.steps(poisson_structures()).map(some.halved), some.paper_steps())


def constant_structure_steps() -> st.SearchStrategy[Case]:
    """Steps of systems with constant B."""
    return some.steps(constant_structures()).map(some.halved)
