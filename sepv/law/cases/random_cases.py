"""Random cases (a system, a state and a step inside the contraction radius)
with sizes inside given ranges (strata).

The parts of a system come from `sepv.law.cases.random_parts`. The contraction radius is inversely
proportional to H, so H is multiplied by a power of two that makes the radius fit a step of the
wanted |Δ|.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from random import Random

import numpy as np

from sepv import problems
from sepv.law.cases import random_parts as some
from sepv.law.cases.case import Case
from sepv.law.cases.ends import at_the_end, usual
from sepv.law.cases.shows_faults import shows_faults
from sepv.law.cases.strata import (
    KIND,
    NEAR_REST,
    NO_STEP,
    NO_TIME,
    ONE_SIGN,
    UNEVEN_NOISES,
    Levels,
    Make,
    monomials,
)
from sepv.law.contraction import contraction_ball, contraction_radius
from sepv.law.tolerance import gradient_majorant, structure_majorant
from sepv.problem import (
    Array,
    Matrix,
    PolynomialSystem,
    Problem,
    Structure,
    one_hamiltonian,
    vector_field,
)
from sepv.record import Polynomial, poly

# After this many draws a rest point may be the origin, because the monomials may be too few for
# another rest point.
REST_POINT_DRAWS = 30
# The smallest B∇H in a design, relative to the sum of its terms' absolute values; a random search
# allows smaller B∇H.
GENERIC_FIELD_SHARE = 1 / 64
# After this many draws a case is accepted although some fault would not show in it.
FAULT_SHOWING_DRAWS = 24
# For a step from y = 0, Δ as a share of the radius inside which y1(Δ) is analytic. The share
# balances the terms that the law "expansion" omits against rounding.
ORIGIN_SHARE = 2.0**-9
# Near a rest point some components are multiplied by ½ to a power in this range; the motion still
# exceeds rounding.
NEARNESS_EXPONENTS = (8, 30)
# In steps with uneven noises the |c_jΔW_j| are scaled by powers of ten with exponents from
# −UNEVENNESS to UNEVENNESS.
UNEVENNESS = 4.0


class Parts:
    """Random d, degrees and state y inside the strata `levels`, and the H,
    B and c of a system drawn to fit them.

    Attributes
    ----------
    d, degree, terms : int
        The dimension, the degree of H and the number of its terms.
    y, unit : (d,), float
        The state, and the size to which coefficients are scaled.
    """

    def __init__(self, levels: Levels, random: Random, dimensions: Sequence[int] = ()) -> None:
        self.levels, self.random = levels, random
        state, kind = levels["state"].name, levels.get(KIND)
        self.near = kind == NEAR_REST
        self.at_rest, self.at_origin = self.near or state == "∇H = 0", state == "0"
        if dimensions:
            low, high = levels["d"].low, levels["d"].high
            exact = float(random.choice([d for d in dimensions if low <= d <= high]))
            levels = {**levels, "d": levels["d"]._replace(low=exact, high=exact)}
        self.d, self.degree, self.terms = some.sizes(levels, random, least=2 if self.at_rest else 1)
        self.y, self.unit = some.state(self.d, levels["|y|"], random)
        self.zero: set[int] = set()
        if kind in ONE_SIGN:
            self.y = tuple(kind.low * (abs(v) or self.unit) for v in self.y)
        if self.at_origin:
            self.y, self.unit = (0.0,) * self.d, 1.0

    def hamiltonian(self) -> Polynomial:
        """Draw H. If ∇H must (nearly) vanish, each term has degree ≥ 2 in components of y that
        become zero or small.
        """
        d, n, random = self.d, self.degree, self.random
        if self.at_rest:
            self.zero, kept = some.rest_monomials(d, n, self.terms, random)
            small = 2.0 ** -random.randint(*NEARNESS_EXPONENTS) if self.near else 0.0
            self.y = tuple(small * v if i in self.zero else v for i, v in enumerate(self.y))
            return self._weighted(kept)
        H = self.with_slope(some.hamiltonian(d, n, self.terms, self.unit, random))
        if d > some.ALL_COMPONENTS_DIMENSION:
            H = poly.add(H, poly.linear([some.coefficient(random) / self.unit for _ in range(d)]))
        return some.with_constant(H, self.y, random) if random.random() < some.SPECIAL_PART_PROBABILITY else H

    def further(self) -> Polynomial:
        """Draw the H_j of a noise, with at most H's degree and number of terms.
        If ∇H is made to vanish, so is ∇H_j.
        """
        low = 2 if self.at_rest else 1
        n = self.random.randint(low, self.degree)
        count = self.random.randint(1, min(self.terms, monomials(self.d, n)))
        if self.at_rest:
            return self._weighted(some.monomials_at_rest(self.d, n, count, sorted(self.zero), self.random))
        return self.with_slope(some.hamiltonian(self.d, n, count, self.unit, self.random))

    def _weighted(self, kept: Sequence[tuple[int, ...]]) -> Polynomial:
        unit = self.unit
        return poly.polynomial(self.d, [(e, some.coefficient(self.random) * unit ** -sum(e)) for e in kept])

    def with_slope(self, p: Polynomial) -> Polynomial:
        """Add linear and quadratic terms to p if y = 0,
        so that a field B∇p and its derivative do not vanish there.
        """
        if not self.at_origin:
            return p
        linear = poly.linear([some.coefficient(self.random) for _ in range(self.d)])
        return poly.add(linear, poly.squares((1.0,) * self.d), p)

    def structure(self) -> tuple[Structure, tuple[Matrix, ...], Matrix]:
        """Draw B, and return B, its quadratic Casimirs and its linear Casimirs."""
        degree = self.levels["degree of B"]
        if self.at_origin:
            return some.with_constants(self.d, degree, self.random), (), ()
        if self.levels["Jacobi"].name == "Poisson":
            return some.poisson(self.d, degree, self.unit, self.random), (), ()
        return some.structure(self.levels["Casimirs"].name, self.d, degree, self.unit, self.random)

    def noise(self) -> tuple[float, ...]:
        """Draw the noise coefficients c_j; c_1 is a power of two, and exactly 1 if y = 0."""
        c = some.noise(self.levels["m"], self.random)
        return (1.0, *c[1:]) if c and self.at_origin else c


SystemOf = Callable[[Parts], PolynomialSystem | None]


def maker(system_of: SystemOf, dimensions: Sequence[int] = (), *, shows: bool = True) -> Make:
    """Return a function that makes test cases of a class of systems;
    `system_of` makes a system from `Parts`.

    `dimensions` lists the dimensions that the class can have; it is empty if all are possible. If
    `shows`, a case of a design is drawn again, a few times, until it would show faults
    (`sepv.law.cases.shows_faults`).
    """

    def drawn(levels: Levels, random: Random, attempt: int | None) -> Case | None:
        parts = Parts(levels, random, dimensions)
        system = system_of(parts)
        if system is None:
            return None
        if parts.at_origin:
            return from_origin(system, levels, random)
        if parts.at_rest:
            everywhere = len(parts.zero) == parts.d and attempt is not None and attempt < REST_POINT_DRAWS
            return None if everywhere else placed(system, parts.y, levels, random, moving=False)
        case = placed(system, parts.y, levels, random, moving=attempt is not None)
        hides = (
            shows
            and levels.get(KIND) in (None, *ONE_SIGN)
            and attempt is not None
            and attempt < FAULT_SHOWING_DRAWS
        )
        return None if case is not None and hides and not shows_faults(case, levels) else case

    def make(levels: Levels, random: Random, attempt: int | None) -> Case | None:
        case = drawn(usual(levels), random, attempt)
        # A case at the origin keeps its units: the law's bound is derived for c_1 = 1, and |y| = 0
        # has no unit.
        if case is None or not any(case.y):
            return case
        end = at_the_end(case, levels)
        return case if end == case else _inside(end)

    make.__name__ = system_of.__name__  # the name under which cases are stored
    return make


def single(parts: Parts) -> PolynomialSystem:
    """A system of class (1.1): one structure and one Hamiltonian."""
    H, (B, quadratic, linear) = parts.hamiltonian(), parts.structure()
    return PolynomialSystem(parts.d, H, B, parts.noise(), quadratic, linear)


def nambu(parts: Parts) -> PolynomialSystem:
    """A system in dimension three with B(y)v = g(y)(v × ∇C(y)),
    where g and the Casimir C are random polynomials.
    """
    levels, unit, random = parts.levels, parts.unit, parts.random
    H, g = parts.hamiltonian(), some.scalar(3, levels["degree of g"], unit, random)
    degree = some.integer(levels["degree of C"], random)
    # A C of degree 2 is homogeneous, so that it is a quadratic Casimir.
    least = 2 if degree == 2 else 1
    most = monomials(3, degree) - monomials(3, least - 1)
    C = some.hamiltonian(3, degree, min(random.randint(2, 6), most), unit, random, least=least)
    return problems.nambu_system(H, g, parts.with_slope(C), parts.noise())


def several(parts: Parts) -> PolynomialSystem:
    """A system whose noises have structures of their own:
    c_j G_j(y)∇H∘dW_j in place of c_j B(y)∇H∘dW_j.
    """
    d, degree, unit, random = parts.d, parts.levels["degree of B"], parts.unit, parts.random
    H, c = parts.hamiltonian(), parts.noise()
    kind, count = parts.levels["structures"].name, 1 + len(c)
    quadratic: tuple[Matrix, ...] = ()
    if parts.at_origin:
        B = [some.with_constants(d, degree, random) for _ in range(count)]
    elif kind == "common Casimir":
        quadratic = (some.symmetric(d, random),)
        forms, less = [some.linear_forms(quadratic[0])], some.less(degree, 1)
        B = [
            some.times(some.scalar(d, less, unit, random), some.contracted(d, forms, random))
            for _ in range(count)
        ]
    else:
        B = [some.skew(d, degree, unit, random)]
        B += B * len(c) if kind == "all are B" else [some.skew(d, degree, unit, random) for _ in c]
    return PolynomialSystem(d, H, B[0], c, quadratic, noise_structures=tuple(B[1:]))


def hamiltonians(parts: Parts) -> PolynomialSystem | None:
    """A system with a Hamiltonian H_j for each noise, or None if each bracket {H, H_j} vanishes."""
    H, (B, quadratic, linear), c = parts.hamiltonian(), parts.structure(), parts.noise()
    others = tuple(parts.further() for _ in c)
    return general(PolynomialSystem(parts.d, H, B, c, quadratic, linear, noise_hamiltonians=others))


def general(system: PolynomialSystem) -> PolynomialSystem | None:
    """Return the system if some bracket {H_0, H_j} of its Hamiltonians does not vanish; else
    None.
    """
    return None if one_hamiltonian(problems.build(system)) else system


def from_origin(system: PolynomialSystem, levels: Levels, random: Random) -> Case | None:
    """A step from y = 0 in which h and Σ|c_jΔW_j| are small shares of the radius inside which y1(Δ)
    is analytic.
    """
    d, m = system.dimension, len(system.noise)
    radius = contraction_ball(problems.build(system), np.zeros(d))[0]
    if not 0 < radius < math.inf:
        return None
    wanted = some.number(levels["|Δ|"], random)
    power = math.floor(math.log2(radius * ORIGIN_SHARE / wanted))
    step = ORIGIN_SHARE * min(radius / 2.0**power, 1.0)
    dW = tuple(random.choice([0.0, 0.5, -0.25]) * step / (2 * m) for _ in system.noise)
    return Case(_scaled(system, power), (0.0,) * d, step, dW, given=levels["given as"].name)


def placed(
    system: PolynomialSystem, y: tuple[float, ...], levels: Levels, random: Random, *, moving: bool = True
) -> Case | None:
    """A case with H scaled such that |h| + Σ|c_jΔW_j| is the share of the contraction radius given
    in `levels`.

    None if the field vanishes at y, or if the rounding of its terms would hide any fault.
    """
    problem = problems.build(system)
    radius = contraction_radius(problem, np.array(y))
    if not 0 < radius < math.inf or (moving and not _moves(problem, np.array(y))):
        return None
    kind = levels.get(KIND)
    if kind == NO_STEP:
        return _undone(system, y, levels, random, radius)
    c, sign = system.noise, levels["h"].low
    total = some.number(levels["|Δ|"], random)
    loud = [j for j, cj in enumerate(c) if cj]
    # Shares of |h| and of the |c_jΔW_j|, with signs such that |Δ| is at least a quarter of
    # |h| + Σ|c_jΔW_j|.
    shares = [random.uniform(0.125, 1) for _ in range(1 + len(loud))]
    if kind == UNEVEN_NOISES:
        end = 1.0 if moving else random.random()
        powers = [end, -end, *(random.uniform(-1, 1) for _ in loud)][: len(loud)]
        shares[1:] = [10 ** (UNEVENNESS * power) for power in random.sample(powers, len(powers))]
    if kind == NO_TIME:
        shares[0] = 0.0
    signs = [sign, *(random.choice([1.0, -1.0]) for _ in loud)]
    largest = sum(shares)
    if abs(sum(s * x for s, x in zip(signs, shares, strict=True))) < largest / 4:
        signs = [sign, *([sign if kind == UNEVEN_NOISES else random.choice([1.0, -1.0])] * len(loud))]
        shares[0] = min(shares[0], largest / 8) if loud and kind != UNEVEN_NOISES else shares[0]
    unit = total / abs(sum(s * x for s, x in zip(signs, shares, strict=True)))
    length = unit * sum(shares)
    parts = [s * x * unit for s, x in zip(signs, shares, strict=True)]
    dW = [random.choice([1.0, -1.0]) * total for _ in c]
    for j, part in zip(loud, parts[1:], strict=True):
        dW[j] = part / c[j]
    power = math.floor(math.log2(radius * levels["step/radius"].high / length))
    return Case(_scaled(system, power), y, parts[0] + 0.0, tuple(dW), given=levels["given as"].name)


def _inside(case: Case) -> Case:
    """Divide H by a power of two so that the step is inside the contraction radius,
    which a change of units alters.
    """
    problem, y, h, dW = case.build()
    length = abs(h) + float(np.sum(np.abs(problem.c * dW)))
    power = math.floor(math.log2(contraction_radius(problem, y) / length)) if length else 0
    assert isinstance(case.problem, PolynomialSystem)
    return case if power >= 0 else replace(case, problem=_scaled(case.problem, power))


def _undone(
    system: PolynomialSystem, y: tuple[float, ...], levels: Levels, random: Random, radius: float
) -> Case:
    """A step with Δ = 0 exactly: h = c_1 2^n, ΔW_1 = −2^n, no other noise. h > 0,
    because schemes may refuse h < 0.
    """
    c, n = system.noise, math.floor(math.log2(some.number(levels["|Δ|"], random)))
    dW = (-(2.0**n), *(0.0 if cj else 2.0**n for cj in c[1:]))
    power = math.floor(math.log2(radius * levels["step/radius"].high / (c[0] * 2.0 ** (n + 1))))
    return Case(_scaled(system, power), y, c[0] * 2.0**n, dW, given=levels["given as"].name)


def _scaled(system: PolynomialSystem, power: int) -> PolynomialSystem:
    """Multiply all Hamiltonians and noise vectors of a system by 2^power."""
    return replace(
        system,
        hamiltonian=poly.scale(2.0**power, system.hamiltonian),
        noise_hamiltonians=tuple(poly.scale(2.0**power, p) for p in system.noise_hamiltonians),
        noise_vectors=tuple(tuple(2.0**power * v for v in g) for g in system.noise_vectors),
    )


def _moves(problem: Problem, y: Array) -> bool:
    """True if B∇H and yᵀ∇H both exceed a small share (GENERIC_FIELD_SHARE)
    of the sums of absolute values of their terms.
    """
    g, most = problem.gradient(y), gradient_majorant(problem, y)
    flow, whole = vector_field(problem, y), structure_majorant(problem, y) @ most
    motion, growth = float(np.max(np.abs(flow))), abs(float(g @ y))
    enough = motion >= GENERIC_FIELD_SHARE * float(np.max(whole)) and growth >= GENERIC_FIELD_SHARE * float(
        most @ np.abs(y)
    )
    return motion > 0 < growth and enough
