"""Steps of (2.1) that have no solution at all, with proofs in exact arithmetic.

Let B_kj be the only entry of row k of B, B_kj or ∂_jH constant, and B_kj(y) ∂_jH(y) = q(y_k),
where q(x) = q0 + q1 x + q2 x² has no real root. With x = y0_k, component k of (2.1) is an equation
for z = y1_k − y0_k alone:

    z = Δ (q(x) + ½ q′(x) z + w q2 z²),    w = ⅓ if B_kj is constant, ¼ if ∂_jH is,

because ∇H is averaged along the segment from y0 to y1, ∫₀¹ τ² dτ = ⅓, and B is taken at its middle,
(½)² = ¼. If (½ q′(x) Δ − 1)² < 4 w q2 q(x) Δ², no real z satisfies the equation, and (2.1) has no
solution. The difference of both sides is a polynomial in Δ, equal to 1 at Δ = 0. Its leading
coefficient (½ q′)² − 4 w q2 q(x) is negative, because q′² < 4 q2 q(x). So the inequality holds
beyond one fold Δ* > 0 and beyond one fold Δ* < 0.

For s stages and constant B_kj, u̇ of the collocation polynomial u is the L² projection of Δ q(u) on
degree s − 1. Hence z = Δ∫₀¹ q(u) dτ. Let q = γ + q2 (x − μ)², v = u − μ and K_s = 4 Σ (2n + 1) over
odd n ≤ s. Then |v(1) − v(0)|² ≤ K_s ∫v², because the Legendre polynomials P_n(2τ − 1) have norms
(2n + 1)^{−½}, and P_n(1) − P_n(−1) = 2 for odd n. So

    |z| ≥ |Δ| (|γ| + |q2| z² / K_s),    which no z satisfies if Δ² > K_s / (4 γ q2).

With several structures whose rows k are g_l times row k of B, Δ is replaced by h + Σ g_l c_l ΔW_l.
For Nambu systems with linear C, the method that averages ∇C too is (2.1).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from math import sqrt
from random import Random

from sepv.law.cases import random_parts as parts
from sepv.law.cases.case import Case
from sepv.law.cases.strata import Stratum
from sepv.problem import PolynomialSystem, Structure, Systems
from sepv.problems import nambu_system
from sepv.record import Polynomial, poly

# A scheme computes Δ with a relative rounding error of 2⁻⁵⁰, or 2⁻²¹ in single precision. The proof
# holds for every Δ within the relative distance FOLD_DISTANCE.
FOLD_DISTANCE = Fraction(1, 2**20)
# The classes of systems for which `made` makes steps without a solution.
CLASSES_WITH_FOLDS = (Systems.SINGLE, Systems.NAMBU, Systems.SEVERAL)
# Exponents n: a step is longer than a fold by the fraction 2^n. Most fractions are small, so that
# two half steps have solutions. Some are so small that a loose test of convergence accepts the
# nearest state as a solution.
FOLD_EXPONENTS = (-6, -6, -16, -12, -4, -3, -1, 0, 3)
_NO_SOLUTION = (Fraction(0), Fraction(0), Fraction(0))


@dataclass(frozen=True)
class NoSolution:
    """A proof that a step has no solution: the residual |a z² + b z + c| of one component of (2.1)
    has no real zero.

    Here z is component `place` of y1 − y0. With several stages the residual is at least |a z² + b
    |z| + c|.
    """

    place: int
    a: Fraction
    b: Fraction
    c: Fraction
    stages: int = 1

    def residual(self, y0: float, y1: float) -> Fraction:
        """Return the residual |a z² + b z + c| at z = y1 − y0,
        where y0 and y1 are components `place` of the states.
        """
        z = Fraction(y1) - Fraction(y0)
        z = z if self.stages == 1 else abs(z)
        return abs(self.a * z * z + self.b * z + self.c)

    @property
    def least(self) -> Fraction:
        """Return the smallest residual over all real z."""
        return abs(self.c - self.b * self.b / (4 * self.a))


def legendre_sum(stages: int) -> int:
    """Return the sum K_s = 4 Σ (2n + 1) over odd n ≤ s, for s stages."""
    return 4 * sum(2 * n + 1 for n in range(1, stages + 1, 2))


def proof(case: Case, stages: int = 1) -> NoSolution | None:
    """Return the proof that the step of a case has no solution,
    or None if the module's argument does not apply.
    """
    data = case.problem
    if not isinstance(data, PolynomialSystem) or data.noise_hamiltonians:
        return None
    found = (_at(case, data, k, stages) for k in range(data.dimension))
    return next((why for why in found if why is not None), None)


def _at(case: Case, data: PolynomialSystem, k: int, stages: int) -> NoSolution | None:
    row = _row(data.structure, k)
    if len(row) != 1:
        return None
    ((j, entry),) = row.items()
    slope, along = poly.differentiate(data.hamiltonian, j), entry.degree == 0
    if not along and (slope.degree or stages > 1 or data.noise_structures):
        return None
    if data.nambu is not None and (data.nambu[0].degree or data.nambu[1].degree != 1):
        return None
    q, factor = (_quadratic(slope, k), entry) if along else (_quadratic(entry, k), slope)
    step = _step(case, data, j, k)
    if q is None or step is None:
        return None
    delta = step * _value(factor)
    x, (q0, q1, q2) = Fraction(case.y[k]), q
    if stages > 1:
        positive = abs(q0 - q1 * q1 / (4 * q2)), abs(q2)
        a, b, c = positive[1] / legendre_sum(stages), Fraction(-1), positive[0]
    else:
        a, b, c = q2 * Fraction(1, 3 if along else 4), (q1 + 2 * q2 * x) / 2, q0 + q1 * x + q2 * x * x

    def equation(t: Fraction) -> tuple[Fraction, Fraction, Fraction]:
        return (a * abs(t), b, c * abs(t)) if stages > 1 else (a * t, b * t - 1, c * t)

    nearer = equation(delta * (1 - FOLD_DISTANCE))
    if nearer[1] ** 2 >= 4 * nearer[0] * nearer[2]:
        return None
    return NoSolution(k, *equation(delta), stages)


def _row(structure: Structure, k: int) -> dict[int, Polynomial]:
    """Return the nonzero entries of row k of a skew matrix, by column."""
    upper = {j: entry for i, j, entry in structure if i == k and entry.terms}
    return upper | {i: poly.scale(-1.0, entry) for i, j, entry in structure if j == k and entry.terms}


def _quadratic(p: Polynomial, k: int) -> tuple[Fraction, Fraction, Fraction] | None:
    """Return (q0, q1, q2) if the polynomial p depends on y_k alone, has degree 2 and no real root,
    else None.
    """
    found = list(_NO_SOLUTION)
    for exponents, value in p.terms:
        if sum(exponents) != exponents[k] or exponents[k] > 2:
            return None
        found[exponents[k]] = Fraction(value)
    q0, q1, q2 = found
    return (q0, q1, q2) if q1 * q1 < 4 * q0 * q2 else None


def _step(case: Case, data: PolynomialSystem, j: int, k: int) -> Fraction | None:
    """Return h + Σ g_l c_l ΔW_l if row k of each G_l is g_l times row k of B (g_l = 1 if G_l = B),
    else None.
    """
    shares = [Fraction(1)] * len(data.noise)
    own = _row(data.structure, k)
    for n, G in enumerate(data.noise_structures):
        other = _row(G, k)
        if set(other) - {j} or any(entry.degree for entry in other.values()):
            return None
        shares[n] = _value(other[j]) / _value(own[j]) if other else Fraction(0)
    noise = zip(shares, data.noise, case.dW, strict=True)
    return Fraction(case.h) + sum((g * Fraction(c) * Fraction(w) for g, c, w in noise), Fraction(0))


def _value(p: Polynomial) -> Fraction:
    """Return the value of a constant polynomial as a fraction."""
    return sum((Fraction(v) for _, v in p.terms), Fraction(0))


def made(random: Random, systems: Systems, stages: int = 1) -> Case:
    """Make a random step that exceeds a fold Δ* by 2⁻¹⁶ to 8 times |Δ*|.
    One case in four is stepped in a batch too.
    """
    while True:
        case = _drawn(random, systems, stages)
        if proof(case, stages) is not None:
            return case


def _drawn(random: Random, systems: Systems, stages: int) -> Case:
    single = systems is Systems.SINGLE
    d = 3 if systems is Systems.NAMBU else random.randint(2, 5)
    k, j, *others = random.sample(range(d), d)
    unit, rate = 2.0 ** random.randint(-12, 12), 2.0 ** random.randint(-6, 6)
    sign = random.choice([1.0, -1.0])
    q2, gamma = (sign * rate * abs(parts.coefficient(random)) * size for size in (1 / unit, unit))
    mu = unit * random.choice([0.0, 0.5, -0.25])
    q = {0: gamma + q2 * mu * mu, 1: -2 * q2 * mu, 2: q2}
    along = stages > 1 or not single or random.random() < 0.6
    as_polynomial = _in(d, k, q)
    factor = random.choice([1.0, -0.5, 2.0])
    entry = poly.constant(d, factor) if along else as_polynomial
    H = poly.multiply(poly.variable(d, j), as_polynomial if along else poly.constant(d, factor))
    free = [k, *others]
    more = parts.polynomial(len(free), 1, 4, 3, random)
    scaled = [(e, rate * v * unit ** (2 - sum(e))) for e, v in more.terms]
    H = poly.add(H, parts.embedded(poly.polynomial(len(free), scaled), d, free))
    y = [unit * random.choice([1.0, 0.5, -0.75, 0.0]) for _ in range(d)]
    data = _system(random, systems, d, (k, j, others), H, entry)
    shares = [1.0] * len(data.noise)
    if data.noise_structures:
        own = _value(_row(data.structure, k)[j])
        shares = [
            float(_value(_row(G, k).get(j, poly.constant(d, 0.0))) / own) for G in data.noise_structures
        ]
    folds = _folds([q[0], q[1], q[2]], y[k], factor, 1 / 3 if along else 1 / 4, stages)
    length = random.choice([f for f in folds if shares or f > 0]) * (1 + 2.0 ** random.choice(FOLD_EXPONENTS))
    h = abs(length) * 2.0 ** -random.randint(0, 6) if shares else length
    dW = [h * random.choice([0.5, -0.25, 0.0]) for _ in shares]
    if shares:
        used = sum(g * c * w for g, c, w in zip(shares[1:], data.noise[1:], dW[1:], strict=True))
        dW[0] = (length - h - used) / (shares[0] * data.noise[0])
    return Case(data, tuple(y), h, tuple(dW), batch=random.choice([0, 0, 0, 3]))


def _folds(q: list[float], x: float, factor: float, w: float, stages: int) -> list[float]:
    """Return both folds Δ*, at which 1 − q′(x) t + (¼q′(x)² − 4 w q2 q(x))
    t² = 0 with t = factor·Δ* and x = y0_k.
    """
    q0, q1, q2 = q
    if stages > 1:
        t = sqrt(legendre_sum(stages) / (4 * q2 * (q0 - q1 * q1 / (4 * q2))))
        return [t / abs(factor), -t / abs(factor)]
    half = q1 / 2 + q2 * x
    product = 4 * w * q2 * (q0 + q1 * x + q2 * x * x)
    root = sqrt(product)
    return [1 / ((half + root) * factor), 1 / ((half - root) * factor)]


def _in(d: int, k: int, coefficients: dict[int, float]) -> Polynomial:
    """Return the polynomial in y_k with the given coefficients, in d variables."""
    return poly.polynomial(d, [(tuple(n * (i == k) for i in range(d)), v) for n, v in coefficients.items()])


def _system(
    random: Random,
    systems: Systems,
    d: int,
    places: tuple[int, int, list[int]],
    H: Polynomial,
    entry: Polynomial,
) -> PolynomialSystem:
    """Make a system with the given H and B_kj = `entry`, (k, j, …) = `places`. Noises,
    other rows of B are random.
    """
    k, j, others = places
    if systems is Systems.NAMBU:
        # B(y)v = g v × ∇C with C = y_l, l the third index: the only entries of B are ±g at (k, j)
        # and (j, k).
        C = poly.variable(d, others[0])
        return nambu_system(H, poly.constant(d, _sign(k, j) * float(_value(entry))), C, _noise(random, 0))

    def structure(own: Polynomial) -> Structure:
        rest = parts.skew(d, Stratum("", 0, 1), 1.0, random)
        kept = [e for e in rest if k not in e[:2]]
        return (*kept, (k, j, own) if k < j else (j, k, poly.scale(-1.0, own)))

    system = PolynomialSystem(d, H, structure(entry), _noise(random, int(systems is Systems.SEVERAL)))
    if systems is not Systems.SEVERAL:
        return system
    G = [structure(poly.constant(d, random.choice([1.0, -0.5, 2.0]))) for _ in system.noise]
    return replace(system, noise_structures=tuple(G))


def _sign(k: int, j: int) -> float:
    """Return the sign of B_kj if Bv = v × e_l, with l the third index: (v × e_3)_1 = v_2."""
    return 1.0 if (j - k) % 3 == 1 else -1.0


def _noise(random: Random, least: int) -> tuple[float, ...]:
    return parts.noise(Stratum("", least, 3), random)
