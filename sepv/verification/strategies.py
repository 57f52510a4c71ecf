"""Hypothesis strategies: random skew B(y), polynomial H, Casimirs by construction, and steps with a solution.

All coefficients are small dyadic rationals: products and sums of a few of them are exact in binary64, so
that a Casimir holds exactly as data and a defect is the scheme's. Everything shrinks towards
H = ½|y|², B = J or hat(y), c = (1), h = 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from itertools import combinations, permutations

import numpy as np
from hypothesis import strategies as st

from sepv import problems
from sepv.problem import Description, NamedProblem, PolynomialSystem
from sepv.problem._problem import Matrix, Structure
from sepv.problems._common import planes
from sepv.record import Polynomial
from sepv.record import _polynomial as poly
from sepv.verification._cases.case import Case
from sepv.verification._contraction import CONTRACTION, contraction_ball, contraction_radius

# What a user draws from; the parts below serve the strategies of other classes of systems.
__all__ = [
    "CONTRACTION", "any_steps", "casimir_systems", "coefficients", "hamiltonians", "noises", "paper_problems",
    "paper_steps", "poisson_systems", "polynomials", "skew_structures", "steps",
]  # fmt: skip


def __dir__() -> list[str]:
    return __all__


# As the law "expansion" has it: Δ as a share of the radius inside which y1(Δ) is analytic.
ORIGIN_SHARE = 2.0**-9
# Strategies are made once: Hypothesis validates each that is made anew, which costs as much as its draws.
_SIGNS = st.sampled_from([1.0, -1.0])
_KINDS = st.sampled_from(["kinetic", *["kinetic and more", "any"] * 2])
_STRUCTURES = st.sampled_from(["canonical", "any", "any"])
_SMALL = st.integers(-2, 2)
_WEIGHTS = st.sampled_from([1.0, 0.0, -1.0, 2.0])
_PERTURBED, _AWAY = st.floats(0.5, 1.5), st.sampled_from([0.0, 0.1, 0.3])
# Every fourth step or so is short: what is right for long steps may be cut short for those.
_LENGTHS = st.sampled_from([1.0, 1.0, 1.0, 2.0**-10])
# A quadrature error grows like the length to the power of the degree: half of all parts are whole.
_PARTS = st.one_of(st.just(1.0), st.floats(0, 1 - 2.0**-10).map(lambda x: 1 - x))


@cache
def coefficients(largest: int = 8) -> st.SearchStrategy[float]:
    """Multiples of 1/4 between ±largest/4, not zero. Examples shrink towards 1."""
    magnitudes = st.integers(0, largest - 1).map(lambda k: ((k + 3) % largest + 1) / 4)
    return st.builds(lambda sign, size: sign * size, _SIGNS, magnitudes)


@cache
def components(bound: float = 2.0) -> st.SearchStrategy[float]:
    """Components of a state in ±bound; below 1e-6 they are zero. Examples shrink towards 1 and 0.

    States of extreme size are a matter of their own: a law about rounding is best searched at scale 1.
    """
    spread = st.floats(-bound, bound).map(lambda x: x if abs(x) >= 1e-6 else 0.0)
    return st.one_of(st.sampled_from([1.0, 0.0, -1.0]), spread)


@cache
def _states(dimension: int) -> st.SearchStrategy[list[float]]:
    return st.lists(components(), min_size=dimension, max_size=dimension)


@cache
def _indices(dimension: int) -> st.SearchStrategy[int]:
    return st.integers(0, dimension - 1)


@cache
def _pairs(dimension: int) -> st.SearchStrategy[list[tuple[int, int]]]:
    every = list(combinations(range(dimension), 2))
    return st.lists(st.sampled_from(every), min_size=1, max_size=len(every), unique=True)


@cache
def _places(dimension: int) -> st.SearchStrategy[list[tuple[int, int]]]:
    return st.lists(st.tuples(_indices(dimension), _indices(dimension)), max_size=4)


@cache
def dimensions(least: int, most: int) -> st.SearchStrategy[int]:
    """Dimensions, half of them one of the two smallest: steps there are longest within their radius."""
    return st.one_of(st.integers(least, min(least + 1, most)), st.integers(least, most))


@cache
def _degrees(least: int, degree: int) -> st.SearchStrategy[int]:
    return st.one_of(st.integers(least, degree), st.just(degree))


@cache
@st.composite
def monomials(draw: st.DrawFn, dimension: int, degree: int, *, least: int = 1) -> tuple[int, ...]:
    """Exponents of total degree between `least` and `degree`, often the highest. Examples shrink towards y1^least."""
    exponents, index = [0] * dimension, _indices(dimension)
    for _ in range(draw(_degrees(least, degree))):
        exponents[draw(index)] += 1
    return tuple(exponents)


@cache
def _terms(
    dimension: int, degree: int, least: int, most: int
) -> st.SearchStrategy[list[tuple[tuple[int, ...], float]]]:
    term = st.tuples(monomials(dimension, degree, least=least), coefficients())
    return st.lists(term, min_size=1, max_size=most)


@cache
@st.composite
def polynomials(
    draw: st.DrawFn, dimension: int, degree: int, *, least: int = 1, terms: int = 5
) -> Polynomial:
    """Polynomials with one to `terms` terms. Examples shrink towards y1^least."""
    return poly.polynomial(dimension, draw(_terms(dimension, degree, least, terms)))


@cache
@st.composite
def hamiltonians(draw: st.DrawFn, dimension: int, degree: int = 6, *, least: int = 1) -> Polynomial:
    """Polynomial H. Examples shrink towards ½|y|² (towards y1 for degree 1)."""
    kinetic = poly.squares((1.0,) * dimension)
    if degree < 2:
        return draw(polynomials(dimension, degree, least=min(least, degree)))
    kind = draw(_KINDS)
    if kind == "kinetic":
        return kinetic
    more = draw(polynomials(dimension, degree, least=least))
    total = poly.add(kinetic, more) if kind == "kinetic and more" else more
    return total if total.terms else kinetic


@cache
@st.composite
def skew_structures(draw: st.DrawFn, dimension: int, degree: int = 3) -> Structure:
    """Skew B(y) with polynomial entries of degree 0 to `degree`. Examples shrink towards B = J."""
    if draw(_STRUCTURES) == "canonical":
        return planes(dimension)
    pairs, entries = draw(_pairs(dimension)), polynomials(dimension, degree, least=0, terms=3)
    return tuple((i, j, draw(entries)) for i, j in sorted(pairs))


@cache
@st.composite
def symmetric_matrices(draw: st.DrawFn, dimension: int) -> Matrix:
    """Symmetric integer matrices, not zero. Examples shrink towards the identity."""
    A = np.eye(dimension)
    for i, j in draw(_places(dimension)):
        A[i, j] = A[j, i] = draw(_SMALL)
    if not A.any():
        A[0, 0] = 1.0
    return tuple(map(tuple, A.tolist()))


@st.composite
def casimir_systems(draw: st.DrawFn, degree: int = 6, *, largest: int = 6) -> PolynomialSystem:
    """Systems with quadratic or linear Casimirs, d = 3 to `largest`. Examples shrink towards B = hat(y), H = ½|y|².

    Three constructions: B_ij = g Σ_k T_ijk v_k with T totally antisymmetric; B = |v|²S + v(Sv)ᵀ − (Sv)vᵀ with S
    skew, v = Ay; and, for two Casimirs, B_ij = Σ_kl T_ijkl v_k w_l.
    """
    d = draw(dimensions(3, largest))
    kind = draw(st.sampled_from(["tensor", "linear", "skew", *["two"] * (d > 3)]))
    A = draw(symmetric_matrices(d))
    v = linear_forms(A)
    quadratic: tuple[Matrix, ...] = (A,)
    linear: Matrix = ()
    if kind == "skew":
        B = _skew_family(draw, d, v)
    elif kind == "two":
        second = draw(symmetric_matrices(d))
        B, quadratic = contracted(draw, d, [v, linear_forms(second)]), (A, second)
    elif kind == "linear":
        b = tuple(draw(st.lists(_SMALL.map(float), min_size=d, max_size=d).filter(any)))
        B, quadratic, linear = contracted(draw, d, [[poly.constant(d, x) for x in b]]), (), (b,)
    else:
        B = contracted(draw, d, [v])
    return PolynomialSystem(d, draw(hamiltonians(d, degree)), B, draw(noises()), quadratic, linear)


@cache
def noises(least: int = 0, most: int = 3) -> st.SearchStrategy[tuple[float, ...]]:
    """Noise coefficients c_j ≥ 0. Examples shrink towards (1)."""
    sizes = st.sampled_from([1.0, 0.5, 2.0, 0.25, 0.0])
    some = st.lists(sizes, min_size=max(least, 1), max_size=most).map(tuple)
    return some if least > 0 else st.one_of(some, st.just(()))


@st.composite
def poisson_systems(
    draw: st.DrawFn, degree: int = 6, *, least: int = 1, largest: int = 6, structure_degree: int = 3
) -> PolynomialSystem:
    """Systems of dimension 2 to `largest` with H of degree 1 to `degree`. Examples shrink towards the oscillator."""
    d = draw(dimensions(2, largest))
    H = draw(hamiltonians(d, degree, least=least))
    return PolynomialSystem(d, H, draw(skew_structures(d, structure_degree)), draw(noises()))


@cache
def paper_problems() -> st.SearchStrategy[NamedProblem]:
    """The paper's four problems with its parameters."""
    data = [problems.by_name(name).data for name in problems.PAPER]
    return st.sampled_from([entry for entry in data if isinstance(entry, NamedProblem)])


@st.composite
def steps(draw: st.DrawFn, systems: st.SearchStrategy[PolynomialSystem] | None = None) -> Case:
    """A state and a step inside the contraction radius, so that a solution near y0 exists and is unique there.

    Examples shrink towards y = (1, …, 1) and h = 1, or the largest h that the radius allows.
    """
    data = draw(poisson_systems() if systems is None else systems)
    y = tuple(draw(_states(data.dimension)))
    radius = contraction_radius(problems.build(data), np.array(y))
    return draw(steps_within(data, y, min(radius, 4.0)))


@st.composite
def paper_steps(draw: st.DrawFn) -> Case:
    """A step of one of the paper's problems near its initial state, with h and the increments of §4."""
    data = draw(paper_problems())
    problem = problems.build(data)
    initial, longest = np.asarray(problem.initial), problem.longest_step
    assert longest is not None
    y = tuple(float(a) * draw(_PERTURBED) + draw(_AWAY) for a in initial)
    return draw(steps_within(data, y, draw(st.sampled_from([longest, longest / 2, longest / 4, 2.0**-7]))))


@cache
def any_steps() -> st.SearchStrategy[Case]:
    """Steps of random polynomial systems, with and without Casimirs, and of the paper's problems."""
    return st.one_of(steps(), steps(casimir_systems()), paper_steps())


@st.composite
def steps_within(draw: st.DrawFn, data: Description, y: tuple[float, ...], radius: float) -> Case:
    """|h| + Σ|c_j ΔW_j| ≤ radius, each part a share of it."""
    c = problems.build(data).c
    length = radius * draw(_LENGTHS)
    share = length / (1 + np.count_nonzero(c))
    h = min(1.0, share * draw(_PARTS))
    dW = tuple(float(draw(_SIGNS) * draw(_PARTS) * (share / cj if cj else 1.0)) for cj in c)
    return Case(data, y, float(h), dW)


def halved(case: Case) -> Case:
    """Half the step: what a bound from Cauchy's estimate needs for all states around y (law poisson-map)."""
    return replace(case, h=case.h / 2, dW=tuple(v / 2 for v in case.dW))


def in_the_mean(case: Case) -> Case:
    """h with h + 4√h Σ c_j inside the contraction radius, and no increments."""
    problem, y, _, _ = case.build()
    radius, noise = min(contraction_ball(problem, y)[0], 1.0), 4 * float(problem.c.sum())
    root = (-noise + (noise * noise + 4 * radius) ** 0.5) / 2
    return replace(case, h=root * root, dW=(0.0,) * problem.noises)


def linear_forms(A: Matrix) -> list[Polynomial]:
    """The components of Ay."""
    return [poly.linear(row) for row in A]


def tensor_terms(
    d: int, indices: Sequence[int], weight: float, forms: list[list[Polynomial]]
) -> Iterator[tuple[tuple[int, int], Polynomial]]:
    """What the entry `weight` of a totally antisymmetric tensor at these indices adds to each B_ij, i < j."""
    for i, j, *others in permutations(indices):
        if i < j:
            parity = (-1) ** sum(a > b for a, b in combinations((i, j, *others), 2))
            product = poly.constant(d, weight * parity)
            for form, k in zip(forms, others, strict=True):
                product = poly.multiply(product, form[k])
            yield (i, j), product


def contracted(draw: st.DrawFn, d: int, forms: list[list[Polynomial]]) -> Structure:
    """B_ij = g Σ T_{ij k…} v_k …, T totally antisymmetric of rank 2 + len(forms), g a polynomial for d = 3."""
    entries: dict[tuple[int, int], list[Polynomial]] = {}
    for indices in combinations(range(d), 2 + len(forms)):
        weight = 1.0 if d == 3 else draw(_WEIGHTS)
        if not weight:
            continue
        for place, factor in tensor_terms(d, indices, weight, forms):
            entries.setdefault(place, []).append(factor)
    g = poly.constant(d, 1.0)
    if d == 3 and draw(st.booleans()):
        g = draw(polynomials(d, 2, least=0, terms=2))
    return tuple((i, j, poly.multiply(g, poly.add(*parts))) for (i, j), parts in sorted(entries.items()))


def _skew_family(draw: st.DrawFn, d: int, v: list[Polynomial]) -> Structure:
    """B = |v|²S + v(Sv)ᵀ − (Sv)vᵀ, for which Bᵀv = 0."""
    S = np.zeros((d, d))
    for i, j in combinations(range(d), 2):
        S[i, j] = draw(st.sampled_from([0.0, 1.0, -1.0]))
        S[j, i] = -S[i, j]
    if not S.any():
        S[0, 1], S[1, 0] = 1.0, -1.0
    norm = poly.add(*(poly.multiply(f, f) for f in v))
    turned = [poly.add(*(poly.scale(float(S[i, k]), v[k]) for k in range(d))) for i in range(d)]

    def entry(i: int, j: int) -> Polynomial:
        back = poly.scale(-1.0, poly.multiply(turned[i], v[j]))
        return poly.add(poly.scale(float(S[i, j]), norm), poly.multiply(v[i], turned[j]), back)

    return tuple((i, j, entry(i, j)) for i, j in combinations(range(d), 2))
