"""Random content inside given strata: a system, a state and a step inside the contraction radius.

Coefficients are small dyadic rationals times powers of two, so that a Casimir holds exactly as data. A size |y| far
from 1 would leave one degree of H and B with any weight: three times in four each coefficient is divided by that size
to the degree of its monomial. Then H is multiplied by the power of two that makes the wanted |Δ| as long as the
contraction radius, to which it is inversely proportional.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, wraps
from itertools import combinations, combinations_with_replacement, count, permutations
from random import Random

import numpy as np

from sepv import polynomial as poly
from sepv import problems
from sepv.case import Case
from sepv.fields import vector_field
from sepv.polynomial import Exponents, Polynomial
from sepv.problem import Array, PolynomialSystem, Problem
from sepv.strata import Levels, Stratum, monomials
from sepv.strategies import contraction_ball, contraction_radius, linear_forms
from sepv.telling import tells
from sepv.tolerance import gradient_majorant, structure_majorant

Entries = tuple[tuple[int, int, Polynomial], ...]
Matrix = tuple[tuple[float, ...], ...]
# Above it a table of all monomials is not worth making.
FEW = 300
# Entries of B above the diagonal, for large d: its derivatives are d³ polynomials.
MOST_ENTRIES = 8
# The share of states and of components of a state that are something other than generic.
SOMETIMES = 1 / 8
# Draws until a point at rest may be the origin, where monomials are too few for any other.
ATTEMPTS = 30
# What B∇H may be beside the sum of its terms' absolute values: less is left to the random search.
GENERIC = 1 / 64
# Draws until a case is taken in which not every fault would show.
TRIES = 24


Make = Callable[[Levels, int], Case]


def drawn(make: Callable[[Levels, Random], Case]) -> Make:
    """`make` with its random numbers from seed and strata: the same strata have the same content, made once."""

    @cache
    def known(strata: tuple[tuple[str, Stratum], ...], seed: int) -> Case:
        return make(dict(strata), _random(dict(strata), seed))

    @wraps(make)
    def made(levels: Levels, seed: int) -> Case:
        return known(tuple(levels.items()), seed)

    return made


def _random(levels: Levels, seed: int) -> Random:
    return Random(f"{seed} {[(axis, stratum.name) for axis, stratum in levels.items()]}")


def _without(axis: str, levels: Levels) -> Levels:
    return {name: stratum for name, stratum in levels.items() if name != axis}


@drawn
def single(levels: Levels, random: Random) -> Case:
    """A case of class (1.1)."""
    for attempt in count():
        d, n, terms = _sizes(levels, random)
        y, unit = state(d, levels["|y|"], random)
        B, quadratic, linear = structure(
            levels["Casimirs"].name if "Casimirs" in levels else "none",
            d,
            levels["degree of B"],
            unit,
            random,
        )
        H = hamiltonian(d, n, terms, unit, random)
        c = noise(levels["m"], random)
        system = PolynomialSystem(d, H, B, c, quadratic, linear)
        found = placed(system, y, levels, random)
        if found is not None and (attempt >= TRIES or tells(found, levels)):
            return found
    raise AssertionError("unreachable")


@drawn
def nambu(levels: Levels, random: Random) -> Case:
    """A case with B(y)v = g(y)(v × ∇C(y)) in dimension three."""
    for attempt in count():
        _, n, terms = _sizes(levels, random)
        y, unit = state(3, levels["|y|"], random)
        H, g = hamiltonian(3, n, terms, unit, random), scalar(3, levels["degree of g"], unit, random)
        degree = _integer(levels["degree of C"], random)
        # One of degree 2 is homogeneous, so that it is a quadratic Casimir.
        least = 2 if degree == 2 else 1
        most = monomials(3, degree) - monomials(3, least - 1)
        C = hamiltonian(3, degree, min(random.randint(2, 6), most), unit, random, least=least)
        c = noise(levels["m"], random)
        found = placed(problems.nambu_system(H, g, C, c), y, levels, random)
        if found is not None and (attempt >= TRIES or tells(found, levels)):
            return found
    raise AssertionError("unreachable")


@drawn
def several(levels: Levels, random: Random) -> Case:
    """A case with a structure for each noise."""
    for attempt in count():
        d, n, terms = _sizes(levels, random)
        y, unit = state(d, levels["|y|"], random)
        c = noise(levels["m"], random)
        quadratic: tuple[Matrix, ...] = ()
        if levels["structures"].name == "common Casimir":
            quadratic = (symmetric(d, random),)
            forms = [linear_forms(quadratic[0])]
            parts = [
                times(scalar(d, _less(levels["degree of B"], 1), unit, random), contracted(d, forms, random))
                for _ in range(1 + len(c))
            ]
        else:
            parts = [skew(d, levels["degree of B"], unit, random) for _ in range(1 + len(c))]
        H = hamiltonian(d, n, terms, unit, random)
        system = PolynomialSystem(d, H, parts[0], c, quadratic, noise_structures=tuple(parts[1:]))
        found = placed(system, y, levels, random)
        if found is not None and (attempt >= TRIES or tells(found, levels)):
            return found
    raise AssertionError("unreachable")


def still(levels: Levels, seed: int) -> Case:
    """A case whose step must not move: Δ = 0 exactly, or ∇H = 0 at y."""
    if levels["why"].name == "∇H = 0":
        return at_rest(_without("why", levels), seed)
    case = single(_without("why", levels), seed)
    assert isinstance(case.problem, PolynomialSystem)
    c = case.problem.noise
    if not c:
        return replace(case, h=0.0, dW=(0.0,) * len(c))
    # c_1 is a power of two: c_1ΔW_1 = −h exactly, in whatever order Δ is summed.
    others = [0.0 if cj else dW for cj, dW in zip(c[1:], case.dW[1:], strict=True)]
    return replace(case, dW=(-case.h / c[0], *others))


@drawn
def at_rest(levels: Levels, random: Random) -> Case:
    """A critical point of H: each monomial has degree ≥ 2 in the components of y that are zero."""
    for attempt in count():
        d, n, terms = _sizes(levels, random, least=2)
        y, unit = state(d, levels["|y|"], random)
        zero, kept = _at_rest_monomials(d, n, terms, random)
        if len(zero) == d and attempt < ATTEMPTS:
            continue
        H = poly.polynomial(d, [(e, coefficient(random) * unit ** -sum(e)) for e in kept])
        B, quadratic, linear = structure(levels["Casimirs"].name, d, levels["degree of B"], unit, random)
        system = PolynomialSystem(d, H, B, noise(levels["m"], random), quadratic, linear)
        rest = tuple(0.0 if i in zero else v for i, v in enumerate(y))
        found = placed(system, rest, levels, random, moving=False)
        if found is not None:
            return found
    raise AssertionError("unreachable")


def _at_rest_monomials(d: int, n: int, terms: int, random: Random) -> tuple[set[int], list[Exponents]]:
    """Components to be zero, all only where it must be, and monomials of degree ≥ 2 in them, the first of degree n."""
    for size in (*random.sample(range(1, d), d - 1), d):
        zero = random.sample(range(d), size)
        found: dict[Exponents, None] = {}
        for _ in range(40 * terms):
            degree = n if not found or random.random() < 0.5 else random.randint(2, n)
            chosen = [
                random.choice(zero),
                random.choice(zero),
                *(random.randrange(d) for _ in range(degree - 2)),
            ]
            found.setdefault(_exponents(d, chosen))
            if len(found) == terms:
                return set(zero), list(found)
    every = some_monomials(d, n, terms, random, least=2)
    return set(range(d)), every


def at_origin(share: float, levels: Levels, random: Random) -> Case:
    """y = 0, with all terms that the field and its slope need there; h and the noise are `share` of the radius."""
    while True:
        d, n, terms = _sizes(levels, random)
        every = [tuple(int(i == k) for i in range(d)) for k in range(d)]
        linear = poly.polynomial(d, [(e, coefficient(random)) for e in every])
        square = poly.polynomial(d, [(tuple(2 * k for k in e), 0.5) for e in every])
        H = poly.add(linear, square, hamiltonian(d, n, terms, 1.0, random))
        degree = _integer(levels["degree of B"], random)
        B = []
        for i, j in combinations(range(d), 2):
            if j == i + 1 or random.random() < 1 / d:
                entry = poly.constant(d, coefficient(random))
                if degree:
                    own = degree if i == 0 else random.randint(1, degree)
                    entry = poly.add(entry, hamiltonian(d, own, min(2, monomials(d, own)), 1.0, random))
                B.append((i, j, entry))
        m = _integer(levels["m"], random)
        system = PolynomialSystem(
            d, H, tuple(B), (1.0, *(random.choice([1.0, 0.5, 0.25]) for _ in range(m - 1)))
        )
        radius = contraction_ball(problems.build(system), np.zeros(d))[0]
        wanted = math.exp(random.uniform(math.log(levels["|Δ|"].low), math.log(levels["|Δ|"].high)))
        power = math.floor(math.log2(radius * share / wanted))
        scaled = replace(system, hamiltonian=poly.scale(2.0**power, H))
        step = share * min(radius / 2.0**power, 1.0)
        dW = tuple(random.choice([0.0, 0.5, -0.25]) * step / (2 * m) for _ in system.noise)
        return Case(scaled, (0.0,) * d, step, dW, given=levels["given as"].name)


def same_structures(levels: Levels, seed: int) -> Case:
    """Several structures, all of them B: (2.1)."""
    case = single(levels, seed)
    assert isinstance(case.problem, PolynomialSystem)
    copies = (case.problem.structure,) * len(case.problem.noise)
    return replace(case, problem=replace(case.problem, noise_structures=copies))


def reduced(make: Make, levels: Levels, seed: int) -> Case:
    """A case with constant B, or with c = 0: then h alone is as long as the step was."""
    case = make(_without("reduced", levels), seed)
    if levels["reduced"].name == "constant B":
        return case
    assert isinstance(case.problem, PolynomialSystem)
    silent = replace(case.problem, noise=(0.0,) * len(case.problem.noise))
    found = placed(silent, case.y, levels, _random(levels, seed))
    assert found is not None  # whether it moves is a matter of H and B alone
    return found


def unmoved(make: Make, levels: Levels, seed: int) -> Case:
    """h = 0 and no increments."""
    case = make(levels, seed)
    return replace(case, h=0.0, dW=(0.0,) * len(case.dW))


def batched(make: Make, levels: Levels, seed: int) -> Case:
    """A case that is asked about in a batch."""
    case = make(_without("batch", levels), seed)
    return replace(case, batch=_integer(levels["batch"], _random(levels, seed)))


def placed(
    system: PolynomialSystem, y: tuple[float, ...], levels: Levels, random: Random, *, moving: bool = True
) -> Case | None:
    """The system with H scaled so that a step of the wanted |Δ| reaches the wanted share of the contraction radius.

    None where nothing moves, or so little beside the rounding of its terms that no fault would show.
    """
    problem = problems.build(system)
    radius = contraction_radius(problem, np.array(y))
    if not 0 < radius < math.inf or (moving and not _moves(problem, np.array(y))):
        return None
    c, sign = system.noise, levels["h"].low
    total = math.exp(random.uniform(math.log(levels["|Δ|"].low), math.log(levels["|Δ|"].high)))
    loud = [j for j, cj in enumerate(c) if cj]
    # Shares of |h| and of |c_jΔW_j|; signs such that Δ is at least a quarter of their sum.
    shares = [random.uniform(0.125, 1) for _ in range(1 + len(loud))]
    signs = [sign, *(random.choice([1.0, -1.0]) for _ in loud)]
    largest = sum(shares)
    if abs(sum(s * x for s, x in zip(signs, shares, strict=True))) < largest / 4:
        signs = [sign, *([random.choice([1.0, -1.0])] * len(loud))]
        shares[0] = min(shares[0], largest / 8) if loud else shares[0]
    unit = total / abs(sum(s * x for s, x in zip(signs, shares, strict=True)))
    length = unit * sum(shares)
    parts = [s * x * unit for s, x in zip(signs, shares, strict=True)]
    dW = [random.choice([1.0, -1.0]) * total for _ in c]
    for j, part in zip(loud, parts[1:], strict=True):
        dW[j] = part / c[j]
    power = math.floor(math.log2(radius * levels["step/radius"].high / length))
    scaled = replace(system, hamiltonian=poly.scale(2.0**power, system.hamiltonian))
    return Case(scaled, y, parts[0], tuple(dW), given=levels["given as"].name)


def _moves(problem: Problem, y: Array) -> bool:
    """Whether B∇H and yᵀ∇H, by which H changes with the size of y, are not small beside their terms."""
    g, most = problem.gradient(y), gradient_majorant(problem, y)
    flow, whole = vector_field(problem, y), structure_majorant(problem, y) @ most
    motion, growth = float(np.max(np.abs(flow))), abs(float(g @ y))
    enough = motion >= GENERIC * float(np.max(whole)) and growth >= GENERIC * float(most @ np.abs(y))
    return motion > 0 < growth and enough


def _integer(stratum: Stratum, random: Random) -> int:
    return random.randint(int(stratum.low), int(stratum.high))


def _less(stratum: Stratum, by: int) -> Stratum:
    return Stratum(stratum.name, max(0, stratum.low - by), max(0, stratum.high - by))


def _sizes(levels: Levels, random: Random, least: int = 1) -> tuple[int, int, int]:
    """(d, degree of H, terms of H), of which there are enough monomials."""
    while True:
        d = _integer(levels["d"], random) if "d" in levels else 3
        n, terms = _integer(levels["degree of H"], random), _integer(levels["terms of H"], random)
        if n >= least and terms <= monomials(d, n) - monomials(d, least - 1):
            return d, n, terms


def state(d: int, size: Stratum, random: Random) -> tuple[tuple[float, ...], float]:
    """A state, and the size for which coefficients are made: a power of two near |y|, or now and then 1."""
    scale = math.exp(random.uniform(math.log(size.low), math.log(size.high)))
    y = [random.choice([1.0, -1.0]) * scale * random.uniform(0.25, 1) for _ in range(d)]
    for k in range(d):
        if random.random() < SOMETIMES:
            y[k] = random.choice([0.0, y[k] / 1024])
    y[random.randrange(d)] = random.choice([1.0, -1.0]) * scale
    return tuple(y), 2.0 ** round(math.log2(scale)) if random.random() < 0.75 else 1.0


def coefficient(random: Random) -> float:
    """A multiple of 1/4 between ±2, not zero."""
    return random.choice([1.0, -1.0]) * random.randint(1, 8) / 4


def some_monomials(d: int, n: int, count: int, random: Random, *, least: int = 1) -> list[Exponents]:
    """So many different monomials of degree `least` to n: the first of degree n, about half of the others too."""
    total = monomials(d, n) - monomials(d, least - 1)
    count = min(count, total)
    if total <= FEW:
        every = [
            _exponents(d, chosen)
            for k in range(least, n + 1)
            for chosen in combinations_with_replacement(range(d), k)
        ]
        top = random.choice([e for e in every if sum(e) == n])
        return [top, *random.sample([e for e in every if e != top], count - 1)]
    found: dict[Exponents, None] = {}
    while len(found) < count:
        degree = n if not found or random.random() < 0.5 else random.randint(least, n)
        found.setdefault(_exponents(d, [random.randrange(d) for _ in range(degree)]))
    return list(found)


def _exponents(d: int, chosen: Sequence[int]) -> Exponents:
    exponents = [0] * d
    for k in chosen:
        exponents[k] += 1
    return tuple(exponents)


def hamiltonian(d: int, n: int, terms: int, unit: float, random: Random, *, least: int = 1) -> Polynomial:
    """A polynomial of degree n with so many terms, the coefficient of each divided by unit^degree."""
    return poly.polynomial(
        d,
        [
            (e, coefficient(random) * unit ** -sum(e))
            for e in some_monomials(d, n, terms, random, least=least)
        ],
    )


def scalar(d: int, degree: Stratum, unit: float, random: Random) -> Polynomial:
    """1 and one or two terms more, of this degree."""
    n = _integer(degree, random)
    if n == 0:
        return poly.constant(d, 1.0)
    more = hamiltonian(d, n, min(random.randint(1, 2), monomials(d, n)), unit, random)
    return poly.add(poly.constant(d, 1.0), more)


def noise(m: Stratum, random: Random) -> tuple[float, ...]:
    """c_1 a power of two, as an exact way back needs; further ones any, zero among them."""
    count = _integer(m, random)
    more = [random.choice([1.0, 0.5, 0.25, 0.3, 1.7, 0.0]) for _ in range(count - 1)]
    c = (random.choice([1.0, 0.5, 2.0]), *more)
    if count > 1 and {*c} <= {0.0, 1.0}:
        c = (*c[:-1], 0.3)  # not all of them their own squares
    return c if count else ()


def skew(d: int, degree: Stratum, unit: float, random: Random) -> Entries:
    """Any skew B of this degree; for degree 0 half of them canonical."""
    if degree.high == 0 and random.random() < 0.5:
        return tuple((2 * k, 2 * k + 1, poly.constant(d, -1.0)) for k in range(d // 2))
    pairs = list(combinations(range(d), 2))
    chosen = sorted(
        random.sample(
            pairs, random.randint(min(d - 1, len(pairs)), min(len(pairs), max(d - 1, MOST_ENTRIES)))
        )
    )
    n = _integer(degree, random)
    entries = []
    for place, (i, j) in enumerate(chosen):
        own = n if place == 0 else random.randint(0, n)
        entry = poly.constant(d, coefficient(random))
        if own:
            more = hamiltonian(d, own, min(random.randint(1, 2), monomials(d, own)), unit, random)
            entry = more if random.random() < 0.5 else poly.add(entry, more)
        entries.append((i, j, entry))
    return tuple(entries)


def structure(
    casimirs: str, d: int, degree: Stratum, unit: float, random: Random
) -> tuple[Entries, tuple[Matrix, ...], tuple[tuple[float, ...], ...]]:
    """B, its quadratic and its linear Casimirs.

    B_ij = g Σ T_ijk… v_k … with T totally antisymmetric and v = Ay for yᵀAy, v = b for bᵀy; or a B that leaves one
    component out, of which any function is a Casimir. For two, the degree tells which: linear, one of each, quadratic.
    """
    if casimirs == "none":
        return skew(d, degree, unit, random), (), ()
    quadratic = min(2, int(degree.low)) if casimirs == "two" else int(casimirs == "quadratic")
    if casimirs == "quadratic" and degree.high == 0:
        left = random.randrange(d)
        others = [k for k in range(d) if k != left]
        B = tuple(
            (others[i], others[j], poly.constant(d, e.terms[0][1]))
            for i, j, e in skew(d - 1, degree, unit, random)
        )
        return B, (tuple(tuple(float(i == j == left) for j in range(d)) for i in range(d)),), ()
    contraction: Entries = ()
    while not contraction:
        matrices = tuple(symmetric(d, random) for _ in range(quadratic))
        vectors = tuple(vector(d, random) for _ in range((2 if casimirs == "two" else 1) - quadratic))
        forms = [linear_forms(A) for A in matrices]
        contraction = contracted(d, forms + [[poly.constant(d, x) for x in b] for b in vectors], random)
    return times(scalar(d, _less(degree, quadratic), unit, random), contraction), matrices, vectors


def times(factor: Polynomial, entries: Entries) -> Entries:
    """Each entry multiplied."""
    return tuple((i, j, poly.multiply(factor, e)) for i, j, e in entries)


def symmetric(d: int, random: Random) -> Matrix:
    """The identity, or a symmetric matrix of small integers."""
    A = (
        np.diag([random.choice([1.0, 1.0, 2.0, -1.0]) for _ in range(d)])
        if random.random() < 0.5
        else np.eye(d)
    )
    for _ in range(random.randint(0, 2)):
        i, j = random.randrange(d), random.randrange(d)
        A[i, j] = A[j, i] = random.choice([1.0, -1.0, 2.0])
    return tuple(map(tuple, A.tolist()))


def vector(d: int, random: Random) -> tuple[float, ...]:
    """Small integers, not all zero."""
    b = [random.choice([0.0, 1.0, -1.0, 2.0]) for _ in range(d)]
    b[random.randrange(d)] = 1.0
    return tuple(b)


def contracted(d: int, forms: list[list[Polynomial]], random: Random) -> Entries:
    """B_ij = Σ T_ijk… v_k … for a random totally antisymmetric T with a few entries; nothing where the forms depend."""
    rank = 2 + len(forms)
    entries: dict[tuple[int, int], list[Polynomial]] = {}
    for _ in range(random.randint(1, 3) if d > rank else 1):
        indices = sorted(random.sample(range(d), rank))
        weight = random.choice([1.0, -1.0, 2.0])
        for order in permutations(indices):
            if order[0] < order[1]:
                parity = (-1) ** sum(a > b for a, b in combinations(order, 2))
                product = poly.constant(d, weight * parity)
                for form, k in zip(forms, order[2:], strict=True):
                    product = poly.multiply(product, form[k])
                entries.setdefault((order[0], order[1]), []).append(product)
    added = [(i, j, poly.add(*parts)) for (i, j), parts in sorted(entries.items())]
    return tuple(entry for entry in added if entry[2].terms)
