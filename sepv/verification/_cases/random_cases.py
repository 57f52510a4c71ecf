"""Random content inside given strata: a system, a state and a step inside the contraction radius.

The parts come from `sepv.verification._cases.random_parts`. Then H is multiplied by the power of two that
makes the wanted |Δ| as long as the contraction radius, to which it is inversely proportional.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache, wraps
from itertools import combinations, count
from random import Random

import numpy as np

from sepv import problems
from sepv.problem import Array, HamiltoniansProblem, PolynomialSystem, Problem, vector_field
from sepv.problem._problem import Matrix
from sepv.record import _polynomial as poly
from sepv.record._polynomial import Exponents
from sepv.verification._cases import random_parts as some
from sepv.verification._cases.case import Case
from sepv.verification._cases.shows_faults import shows_faults
from sepv.verification._cases.strata import Levels, Stratum, monomials
from sepv.verification._contraction import contraction_ball, contraction_radius
from sepv.verification._tolerance import gradient_majorant, structure_majorant
from sepv.verification.strategies import linear_forms

# Draws until a point at rest may be the origin, where monomials are too few for any other.
ATTEMPTS = 30
# What B∇H may be beside the sum of its terms' absolute values: less is left to the random search.
GENERIC = 1 / 64
# Draws until a case is taken in which not every fault would show.
TRIES = 24

Make = Callable[[Levels, int], Case]


def drawn(make: Callable[[Levels, Random, int], Case | None]) -> Make:
    """`make` with its random numbers from seed and strata, and asked again while it makes nothing.

    The same strata have the same content, made once.
    """

    @cache
    def known(strata: tuple[tuple[str, Stratum], ...], seed: int) -> Case:
        levels = dict(strata)
        random = _random(levels, seed)
        attempts = (make(levels, random, attempt) for attempt in count())
        return next(case for case in attempts if case is not None)

    @wraps(make)
    def made(levels: Levels, seed: int) -> Case:
        return known(tuple(levels.items()), seed)

    return made


def _where_faults_show(found: Case | None, levels: Levels, attempt: int) -> Case | None:
    """The case if every fault would show in it, or any after so many attempts."""
    return found if found is not None and (attempt >= TRIES or shows_faults(found, levels)) else None


def _random(levels: Levels, seed: int) -> Random:
    return Random(f"{seed} {[(axis, stratum.name) for axis, stratum in levels.items()]}")


def _without(axis: str, levels: Levels) -> Levels:
    return {name: stratum for name, stratum in levels.items() if name != axis}


@drawn
def single(levels: Levels, random: Random, attempt: int) -> Case | None:
    """A case of class (1.1)."""
    d, n, terms = some.sizes(levels, random)
    y, unit = some.state(d, levels["|y|"], random)
    B, quadratic, linear = some.structure(levels["Casimirs"].name, d, levels["degree of B"], unit, random)
    H = some.hamiltonian(d, n, terms, unit, random)
    c = some.noise(levels["m"], random)
    system = PolynomialSystem(d, H, B, c, quadratic, linear)
    return _where_faults_show(placed(system, y, levels, random), levels, attempt)


@drawn
def nambu(levels: Levels, random: Random, attempt: int) -> Case | None:
    """A case with B(y)v = g(y)(v × ∇C(y)) in dimension three."""
    _, n, terms = some.sizes(levels, random)
    y, unit = some.state(3, levels["|y|"], random)
    H, g = some.hamiltonian(3, n, terms, unit, random), some.scalar(3, levels["degree of g"], unit, random)
    degree = some.integer(levels["degree of C"], random)
    # One of degree 2 is homogeneous, so that it is a quadratic Casimir.
    least = 2 if degree == 2 else 1
    most = monomials(3, degree) - monomials(3, least - 1)
    C = some.hamiltonian(3, degree, min(random.randint(2, 6), most), unit, random, least=least)
    c = some.noise(levels["m"], random)
    return _where_faults_show(placed(problems.nambu_system(H, g, C, c), y, levels, random), levels, attempt)


@drawn
def several(levels: Levels, random: Random, attempt: int) -> Case | None:
    """A case with a structure for each noise."""
    d, n, terms = some.sizes(levels, random)
    y, unit = some.state(d, levels["|y|"], random)
    c = some.noise(levels["m"], random)
    quadratic: tuple[Matrix, ...] = ()
    if levels["structures"].name == "common Casimir":
        quadratic = (some.symmetric(d, random),)
        forms = [linear_forms(quadratic[0])]
        degree = some.less(levels["degree of B"], 1)
        parts = [
            some.times(some.scalar(d, degree, unit, random), some.contracted(d, forms, random))
            for _ in range(1 + len(c))
        ]
    else:
        parts = [some.skew(d, levels["degree of B"], unit, random) for _ in range(1 + len(c))]
    H = some.hamiltonian(d, n, terms, unit, random)
    system = PolynomialSystem(d, H, parts[0], c, quadratic, noise_structures=tuple(parts[1:]))
    return _where_faults_show(placed(system, y, levels, random), levels, attempt)


@drawn
def hamiltonians(levels: Levels, random: Random, attempt: int) -> Case | None:  # noqa: ARG001  (of `drawn`)
    """A case with a Hamiltonian for each noise, of the degree of H at most, some of which do not commute with H."""
    d, n, terms = some.sizes(levels, random)
    y, unit = some.state(d, levels["|y|"], random)
    B, quadratic, linear = some.structure(levels["Casimirs"].name, d, levels["degree of B"], unit, random)
    H, c = some.hamiltonian(d, n, terms, unit, random), some.noise(levels["m"], random)
    others = []
    for _ in c:
        degree = random.randint(1, n)
        count = random.randint(1, min(terms, monomials(d, degree)))
        others.append(some.hamiltonian(d, degree, count, unit, random))
    system = PolynomialSystem(d, H, B, c, quadratic, linear, noise_hamiltonians=tuple(others))
    general = isinstance(problems.build(system), HamiltoniansProblem)
    return placed(system, y, levels, random) if general else None


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
def at_rest(levels: Levels, random: Random, attempt: int) -> Case | None:
    """A critical point of H: each monomial has degree ≥ 2 in the components of y that are zero."""
    d, n, terms = some.sizes(levels, random, least=2)
    y, unit = some.state(d, levels["|y|"], random)
    zero, kept = _at_rest_monomials(d, n, terms, random)
    if len(zero) == d and attempt < ATTEMPTS:
        return None
    H = poly.polynomial(d, [(e, some.coefficient(random) * unit ** -sum(e)) for e in kept])
    B, quadratic, linear = some.structure(levels["Casimirs"].name, d, levels["degree of B"], unit, random)
    system = PolynomialSystem(d, H, B, some.noise(levels["m"], random), quadratic, linear)
    rest = tuple(0.0 if i in zero else v for i, v in enumerate(y))
    return placed(system, rest, levels, random, moving=False)


def _at_rest_monomials(d: int, n: int, terms: int, random: Random) -> tuple[set[int], list[Exponents]]:
    """Components to be zero, all only where it must be, and monomials of degree ≥ 2 in them, the first of degree n."""
    for size in (*random.sample(range(1, d), d - 1), d):
        zero = random.sample(range(d), size)
        found: dict[Exponents, None] = {}
        for _ in range(40 * terms):
            degree = n if not found or random.random() < 0.5 else random.randint(2, n)
            chosen = [random.choice(zero) for _ in range(2)] + [
                random.randrange(d) for _ in range(degree - 2)
            ]
            found.setdefault(some.exponents_of(d, chosen))
            if len(found) == terms:
                return set(zero), list(found)
    every = some.some_monomials(d, n, terms, random, least=2)
    return set(range(d)), every


def at_origin(share: float, levels: Levels, random: Random, _attempt: int) -> Case:
    """y = 0, with all terms that the field and its slope need there; h and the noise are `share` of the radius."""
    d, n, terms = some.sizes(levels, random)
    linear = poly.linear([some.coefficient(random) for _ in range(d)])
    H = poly.add(linear, poly.squares((1.0,) * d), some.hamiltonian(d, n, terms, 1.0, random))
    degree = some.integer(levels["degree of B"], random)
    B = []
    for i, j in combinations(range(d), 2):
        if j == i + 1 or random.random() < 1 / d:
            entry = poly.constant(d, some.coefficient(random))
            if degree:
                own = degree if i == 0 else random.randint(1, degree)
                entry = poly.add(entry, some.hamiltonian(d, own, min(2, monomials(d, own)), 1.0, random))
            B.append((i, j, entry))
    m = some.integer(levels["m"], random)
    system = PolynomialSystem(d, H, tuple(B), (1.0, *(random.choice([1.0, 0.5, 0.25]) for _ in range(m - 1))))
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
    return replace(case, batch=some.integer(levels["batch"], _random(levels, seed)))


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
    scaled = replace(
        system,
        hamiltonian=poly.scale(2.0**power, system.hamiltonian),
        noise_hamiltonians=tuple(poly.scale(2.0**power, p) for p in system.noise_hamiltonians),
    )
    return Case(scaled, y, parts[0], tuple(dW), given=levels["given as"].name)


def _moves(problem: Problem, y: Array) -> bool:
    """Whether B∇H and yᵀ∇H, by which H changes with the size of y, are not small beside their terms."""
    g, most = problem.gradient(y), gradient_majorant(problem, y)
    flow, whole = vector_field(problem, y), structure_majorant(problem, y) @ most
    motion, growth = float(np.max(np.abs(flow))), abs(float(g @ y))
    enough = motion >= GENERIC * float(np.max(whole)) and growth >= GENERIC * float(most @ np.abs(y))
    return motion > 0 < growth and enough
