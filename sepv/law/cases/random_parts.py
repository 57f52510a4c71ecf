"""Random parts of a case: states, polynomials, skew B and their Casimirs,
with degrees and sizes in given ranges.

Coefficients are small dyadic rationals times powers of two, so that a Casimir's B∇C = 0 holds
exactly for the stored numbers. If |y| is far from 1, the terms of one degree in H or B would be far
larger than all others. To avoid this, in three cases of four each coefficient is divided by |y| to
the degree of its monomial.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations, combinations_with_replacement, permutations
from random import Random

import numpy as np

from sepv.law.cases.strata import Levels, Stratum, monomials
from sepv.problem import Matrix, Structure
from sepv.problems import nambu_system, planes
from sepv.record import Exponents, Polynomial, poly

# If there are at most this many monomials, monomials are drawn from a table of them.
TABLE_MAX_MONOMIALS = 300
# The most entries of B above the diagonal for large d, because the derivatives of B are d³
# polynomials.
MOST_ENTRIES = 8
# If d is larger than this, H gets a linear form of all components, and B an entry in the last row.
# Otherwise few terms would leave most components at rest, and a component that a scheme forgets
# would not show.
ALL_COMPONENTS_DIMENSION = 12
# The probability of special parts: components of a state near zero, an H with a constant, a B with
# one nonzero block.
SPECIAL_PART_PROBABILITY = 1 / 8


def integer(stratum: Stratum, random: Random) -> int:
    """Draw a whole number from the `low` to the `high` of a stratum (range), ends included."""
    return random.randint(int(stratum.low), int(stratum.high))


def number(stratum: Stratum, random: Random) -> float:
    """Draw a number between the `low` and the `high` of a stratum (range), with uniform
    logarithm.
    """
    return math.exp(random.uniform(math.log(stratum.low), math.log(stratum.high)))


def less(stratum: Stratum, by: int) -> Stratum:
    """The stratum (range) with both ends lowered by the number `by`, but not below zero."""
    return Stratum(stratum.name, max(0, stratum.low - by), max(0, stratum.high - by))


def sizes(levels: Levels, random: Random, least: int = 1) -> tuple[int, int, int]:
    """Draw d, the degree of H and its number of terms,
    such that enough monomials of degree ≥ `least` exist.
    """
    while True:
        d = integer(levels["d"], random)
        n, terms = integer(levels["degree of H"], random), integer(levels["terms of H"], random)
        if n >= least and terms <= monomials(d, n) - monomials(d, least - 1):
            return d, n, terms


def state(d: int, size: Stratum, random: Random) -> tuple[tuple[float, ...], float]:
    """A state, and the size to which coefficients are scaled: a power of two near |y|,
    or sometimes 1.
    """
    scale = number(size, random)
    y = [random.choice([1.0, -1.0]) * scale * random.uniform(0.25, 1) for _ in range(d)]
    for k in range(d):
        if random.random() < SPECIAL_PART_PROBABILITY:
            y[k] = random.choice([0.0, y[k] / 1024])
    y[random.randrange(d)] = random.choice([1.0, -1.0]) * scale
    return tuple(y), 2.0 ** round(math.log2(scale)) if random.random() < 0.75 else 1.0


def coefficient(random: Random) -> float:
    """A multiple of 1/4 between ±2, not zero."""
    return random.choice([1.0, -1.0]) * random.randint(1, 8) / 4


def some_monomials(d: int, n: int, count: int, random: Random, *, least: int = 1) -> list[Exponents]:
    """Draw `count` different monomials of degree `least` to n: the first has degree n,
    others often have it too.
    """
    total = monomials(d, n) - monomials(d, least - 1)
    count = min(count, total)
    if total <= TABLE_MAX_MONOMIALS:
        products = (combinations_with_replacement(range(d), k) for k in range(least, n + 1))
        every = [exponents_of(d, chosen) for own in products for chosen in own]
        top = random.choice([e for e in every if sum(e) == n])
        return [top, *random.sample([e for e in every if e != top], count - 1)]
    found: dict[Exponents, None] = {}
    while len(found) < count:
        degree = n if not found or random.random() < 0.5 else random.randint(least, n)
        found.setdefault(exponents_of(d, [random.randrange(d) for _ in range(degree)]))
    return list(found)


def exponents_of(d: int, chosen: Sequence[int]) -> Exponents:
    """The exponents of the product of the chosen coordinates."""
    exponents = [0] * d
    for k in chosen:
        exponents[k] += 1
    return tuple(exponents)


def hamiltonian(d: int, n: int, terms: int, unit: float, random: Random, *, least: int = 1) -> Polynomial:
    """A polynomial of degree n with `terms` terms; a coefficient of a term of degree k is divided
    by `unit`ᵏ.
    """
    chosen = some_monomials(d, n, terms, random, least=least)
    return poly.polynomial(d, [(e, coefficient(random) * unit ** -sum(e)) for e in chosen])


def with_constant(p: Polynomial, y: tuple[float, ...], random: Random) -> Polynomial:
    """Add a constant to p: of the size of the largest term of p at y, or such that p(y)
    nearly vanishes.
    """
    values = [c * math.prod(v**k for v, k in zip(y, e, strict=True)) for e, c in p.terms]
    left = random.choice([-sum(values), random.choice([2.0, -1.0, 0.25]) * max(map(abs, values))])
    return poly.add(p, poly.constant(p.dimension, left))


def rest_monomials(d: int, n: int, terms: int, random: Random) -> tuple[set[int], list[Exponents]]:
    """Choose components to set to zero, and `terms` monomials of degree ≥ 2 in these components,
    so that ∇H = 0.
    """
    for size in (*random.sample(range(1, d), d - 1), d):
        # Monomials of degree 0 or 1 in the components of the set are not counted.
        left = d - size
        if monomials(d, n) - monomials(left, n) - size * (1 + monomials(left, n - 1)) < terms:
            continue
        zero = random.sample(range(d), size)
        found = monomials_at_rest(d, n, terms, zero, random)
        if len(found) == terms:
            return set(zero), found
    return set(range(d)), some_monomials(d, n, terms, random, least=2)


def monomials_at_rest(d: int, n: int, terms: int, zero: Sequence[int], random: Random) -> list[Exponents]:
    """Draw at most `terms` monomials of joint degree ≥ 2 in the components numbered `zero`;
    the first has degree n.
    """
    found: dict[Exponents, None] = {}
    for _ in range(40 * terms):
        degree = n if not found or random.random() < 0.5 else random.randint(2, n)
        chosen = [random.choice(zero) for _ in range(2)] + [random.randrange(d) for _ in range(degree - 2)]
        found.setdefault(exponents_of(d, chosen))
        if len(found) == terms:
            break
    return list(found)


def polynomial(d: int, least: int, most: int, terms: int, random: Random) -> Polynomial:
    """A polynomial of degree `least` to `most` with at most `terms` terms."""
    n = random.randint(least, most)
    if n == 0:
        return poly.constant(d, coefficient(random))
    least = max(least, 1)
    return hamiltonian(d, n, random.randint(1, terms), 1.0, random, least=least)


def scalar(d: int, degree: Stratum, unit: float, random: Random) -> Polynomial:
    """A polynomial of this `degree`: 1 plus one or two random terms."""
    n = integer(degree, random)
    if n == 0:
        return poly.constant(d, 1.0)
    more = hamiltonian(d, n, min(random.randint(1, 2), monomials(d, n)), unit, random)
    return poly.add(poly.constant(d, 1.0), more)


def noise(m: Stratum, random: Random) -> tuple[float, ...]:
    """Draw coefficients c_j ≥ 0 of the noise; c_1 is a power of two,
    so that a ΔW_1 can cancel or reverse h exactly.
    """
    count = integer(m, random)
    more = [random.choice([1.0, 0.5, 0.25, 0.3, 1.7, 0.0, random.uniform(0.25, 2)]) for _ in range(count - 1)]
    c = (random.choice([1.0, 0.5, 2.0]), *more)
    if count > 1 and {*c} <= {0.0, 1.0}:
        c = (*c[:-1], 0.3)  # some c_j must differ from its square
    return c if count else ()


def skew(d: int, degree: Stratum, unit: float, random: Random) -> Structure:
    """A random skew B of this degree; half of the constant B are canonical,
    some B are 0 outside one diagonal block.
    """
    if degree.high == 0 and random.random() < 0.5:
        return planes(d)
    some = random.random() < SPECIAL_PART_PROBABILITY and d <= ALL_COMPONENTS_DIMENSION
    moved = random.sample(range(d), random.randint(2, d)) if some else range(d)
    pairs = list(combinations(sorted(moved), 2))
    count = random.randint(min(d - 1, len(pairs)), min(len(pairs), max(d - 1, MOST_ENTRIES)))
    chosen = sorted(random.sample(pairs, count))
    n = integer(degree, random)
    entries = []
    for place, (i, j) in enumerate(chosen):
        own = n if place == 0 else random.randint(0, n)
        entry = poly.constant(d, coefficient(random))
        if own:
            more = hamiltonian(d, own, min(random.randint(1, 2), monomials(d, own)), unit, random)
            entry = more if random.random() < 0.5 else poly.add(entry, more)
        entries.append((i, j, entry))
    return tuple(entries)


def with_constants(d: int, degree: Stratum, random: Random) -> Structure:
    """A random skew B with B(0) ≠ 0 and, if not constant, further terms: f = B∇H has f(0)
    ≠ 0 and f′(0) ≠ 0.
    """
    n, B = integer(degree, random), []
    for i, j in combinations(range(d), 2):
        if j == i + 1 or random.random() < 1 / d:
            entry = poly.constant(d, coefficient(random))
            if n:
                own = n if i == 0 else random.randint(1, n)
                entry = poly.add(entry, hamiltonian(d, own, min(2, monomials(d, own)), 1.0, random))
            B.append((i, j, entry))
    return tuple(B)


def poisson(d: int, degree: Stratum, unit: float, random: Random) -> Structure:
    """A random skew B of this degree that satisfies Jacobi's identity.

    B is constant; or B_ij = b_ij y_i y_j with any constant skew b, so that {ln y_i, ln y_j}
    is constant; or B consists of diagonal blocks. A block of size 2 is b(y)J with any b(y)
    and J = ((0, 1), (−1, 0)). A block of size 3 is the matrix of v ↦ v × w with w = g∇C, and
    satisfies the identity because w · curl w = 0.
    """
    if degree.high == 0:
        return skew(d, degree, unit, random)
    if d > 2 and degree.low <= 2 <= degree.high and random.random() < 0.5:
        pairs = [(i, j) for i, j in combinations(range(d), 2) if j == i + 1 or random.random() < 1 / d]
        y = [poly.variable(d, k) for k in range(d)]
        return tuple((i, j, poly.scale(coefficient(random), poly.multiply(y[i], y[j]))) for i, j in pairs)
    n, places = integer(degree, random), random.sample(range(d), d)
    entries: list[tuple[int, int, Polynomial]] = []
    while len(places) > 1:
        size = 3 if len(places) == 3 or (len(places) > 3 and random.random() < 0.5) else 2
        block, places = sorted(places[:size]), places[size:]
        own = random.randint(0, n) if entries else n
        entries += [
            (block[i], block[j], embedded(p, d, block)) for i, j, p in _block(size, own, unit, random)
        ]
    return tuple(sorted(entries))


def _block(size: int, n: int, unit: float, random: Random) -> Structure:
    """A Poisson structure of degree n: b(y)J with J skew for size 2,
    the matrix of v ↦ v × g(y)∇C(y) for size 3.
    """
    if size == 2:
        return ((0, 1, exactly(2, n, unit, random)),)
    of_casimir = random.randint(1, n + 1)
    C, g = exactly(3, of_casimir, unit, random), exactly(3, n + 1 - of_casimir, unit, random)
    return nambu_system(C, g, C).structure


def exactly(d: int, n: int, unit: float, random: Random) -> Polynomial:
    """A random polynomial of degree n with one to three terms; a constant if n = 0."""
    if n == 0:
        return poly.constant(d, coefficient(random))
    return hamiltonian(d, n, min(random.randint(1, 3), monomials(d, n)), unit, random)


def embedded(p: Polynomial, d: int, places: Sequence[int]) -> Polynomial:
    """Write p as a polynomial in d variables: its k-th variable becomes the variable with number
    places[k].
    """

    def moved(exponents: Exponents) -> Exponents:
        whole = [0] * d
        for k, e in zip(places, exponents, strict=True):
            whole[k] = e
        return tuple(whole)

    return poly.polynomial(d, [(moved(e), c) for e, c in p.terms])


def structure(
    casimirs: str, d: int, degree: Stratum, unit: float, random: Random
) -> tuple[Structure, tuple[Matrix, ...], Matrix]:
    """Draw B with given kinds of Casimirs, and return B,
    its quadratic Casimirs and its linear Casimirs.

    B_ij = g Σ T_ijk… v_k … with a scalar g(y), a totally antisymmetric T, and a vector v for each
    Casimir: Ay for yᵀAy, b for bᵀy. A constant B with a quadratic Casimir has a row and column of
    zeros, for a component that is conserved. Of two Casimirs, both are linear if B has degree 0,
    one is linear for degree 1, and none for higher degrees.
    """
    if casimirs == "none":
        return skew(d, degree, unit, random), (), ()
    quadratic = min(2, int(degree.low)) if casimirs == "two" else int(casimirs == "quadratic")
    if casimirs == "quadratic" and degree.high == 0:
        left = random.randrange(d)
        others = [k for k in range(d) if k != left]
        smaller = skew(d - 1, degree, unit, random)
        B = tuple((others[i], others[j], poly.constant(d, e.terms[0][1])) for i, j, e in smaller)
        return B, (tuple(tuple(float(i == j == left) for j in range(d)) for i in range(d)),), ()
    contraction: Structure = ()
    while not contraction:
        matrices = tuple(symmetric(d, random) for _ in range(quadratic))
        vectors = tuple(vector(d, random) for _ in range((2 if casimirs == "two" else 1) - quadratic))
        forms = [linear_forms(A) for A in matrices]
        contraction = contracted(d, forms + [[poly.constant(d, x) for x in b] for b in vectors], random)
    return times(scalar(d, less(degree, quadratic), unit, random), contraction), matrices, vectors


def times(factor: Polynomial, entries: Structure) -> Structure:
    """Multiply each entry by the factor."""
    return tuple((i, j, poly.multiply(factor, e)) for i, j, e in entries)


def symmetric(d: int, random: Random) -> Matrix:
    """A random symmetric (d, d) matrix of small integers, sometimes the identity."""
    some = random.random() < 0.5
    A = np.diag([random.choice([1.0, 1.0, 2.0, -1.0]) if some else 1.0 for _ in range(d)])
    for _ in range(random.randint(0, 2)):
        i, j = random.randrange(d), random.randrange(d)
        A[i, j] = A[j, i] = random.choice([1.0, -1.0, 2.0])
    return tuple(map(tuple, A.tolist()))


def vector(d: int, random: Random) -> tuple[float, ...]:
    """A vector of small integers, not all zero."""
    b = [random.choice([0.0, 1.0, -1.0, 2.0]) for _ in range(d)]
    b[random.randrange(d)] = 1.0
    return tuple(b)


def linear_forms(A: Matrix) -> list[Polynomial]:
    """The components of Ay as polynomials."""
    return [poly.linear(row) for row in A]


def tensor_terms(
    d: int, indices: Sequence[int], weight: float, forms: list[list[Polynomial]]
) -> Iterator[tuple[tuple[int, int], Polynomial]]:
    """The terms, for i < j, that T's entry `weight` at `indices` adds to B_ij = Σ T_ijk… v_k …;
    `forms` lists the v.
    """
    for i, j, *others in permutations(indices):
        if i < j:
            parity = (-1) ** sum(a > b for a, b in combinations((i, j, *others), 2))
            product = poly.constant(d, weight * parity)
            for form, k in zip(forms, others, strict=True):
                product = poly.multiply(product, form[k])
            yield (i, j), product


def contracted(d: int, forms: list[list[Polynomial]], random: Random) -> Structure:
    """Draw B with B_ij = Σ T_ijk… v_k … for a random sparse antisymmetric T and the v in `forms`;
    empty if B = 0.
    """
    rank = 2 + len(forms)
    entries: dict[tuple[int, int], list[Polynomial]] = {}
    for n in range(random.randint(1, 3) if d > rank else 1):
        indices = sorted(random.sample(range(d), rank))
        if d > ALL_COMPONENTS_DIMENSION and not n:
            indices[-1] = d - 1
        weight = random.choice([1.0, -1.0, 2.0])
        for place, product in tensor_terms(d, indices, weight, forms):
            entries.setdefault(place, []).append(product)
    added = [(i, j, poly.add(*parts)) for (i, j), parts in sorted(entries.items())]
    return tuple(entry for entry in added if entry[2].terms)
