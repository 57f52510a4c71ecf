"""States and steps of extreme size: a case at the usual size in other units of y and of time.

The step is the same one, and a scheme without a number that has a unit gives the same digits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from sepv.problem import PolynomialSystem, Structure
from sepv.record import Polynomial, poly
from sepv.verification._cases.case import Case
from sepv.verification._cases.strata import FAR, SIZE, STEP, Levels, Stratum

# The exponents of 2 that coefficients and powers of y may have: none overflows, and 2⁻¹⁰⁷⁴, the error of what
# underflows, is 2⁻⁵³ of the smallest of them and less.
EXPONENTS = 960
# Sizes |y| that every scheme must take, and the largest exponent of 2 of other sizes: |y| = 1e±100, whose squares are
# numbers with all digits.
USUAL, LARGEST = (2.0**-21, 2.0**21), 333

# Steps |h| + Σ|c_j ΔW_j| that a scheme may refuse.
LONG = 8.0


def is_usual(size: float) -> bool:
    """True for sizes |y| that every scheme must take."""
    return USUAL[0] <= size <= USUAL[1]


def beyond(case: Case) -> bool:
    """True if the state is larger or smaller than those that every scheme must take."""
    largest = max(map(abs, case.y), default=0.0)
    return largest > 0 and not is_usual(largest)


def is_long(case: Case) -> bool:
    """True if |h| + Σ|c_j ΔW_j| is more than any scheme must take: in other units the step is a usual one."""
    return isinstance(case.problem, PolynomialSystem) and _length(case) > LONG


def usual(levels: Levels) -> Levels:
    """The strata with the usual ranges of |y| and |Δ|, in which a case is drawn before `at_the_end`."""
    ranges = {a.name: {s.name: s._replace(end=0.0) for s in a.strata} for a in (SIZE, STEP)}
    found = {a: ranges[a].get(s.name, s) if a in ranges else s for a, s in levels.items() if s not in FAR}
    far = next((s for s in levels.values() if s in FAR), None)
    return {**found, SIZE.name: SIZE.strata[0]} if far else found


def at_the_end(case: Case, levels: Levels) -> Case:
    """The case in units in which |y| and |Δ| are as far beyond their usual ranges as the strata say."""
    size = next((s for s in levels.values() if s in FAR), levels[SIZE.name])
    length = levels[STEP.name]
    ordinary = usual(levels)
    power = _power(size, ordinary[SIZE.name], max(map(abs, case.y)))
    return in_other_units(case, power, round(_power(length, ordinary[STEP.name], _length(case)) / 2))


def _power(wanted: Stratum, ordinary: Stratum, value: float) -> int:
    """The exponent of 2 between a value and the number wanted, 0 where that is of the usual range."""
    return (
        0
        if ordinary.low <= wanted.low <= ordinary.high or not value
        else round(math.log2(wanted.low / value))
    )


def _length(case: Case) -> float:
    assert isinstance(case.problem, PolynomialSystem)
    return abs(case.h) + sum(abs(c * w) for c, w in zip(case.problem.noise, case.dW, strict=True))


def in_other_units(case: Case, power: int, time: int = 0) -> Case:
    """The step in other units of y, by 2ⁿ, and of time, by 4ᵏ, which leads to 2ⁿy1.

    H is 4ⁿ⁻ᵏH(2⁻ⁿy), B is B(2⁻ⁿy), so that canonical and mechanical systems stay what they are, g_j is 2ⁿ4⁻ᵏg_j, γ is
    4⁻ᵏγ, h is 4ᵏh, and c_j and ΔW_j are 2ᵏ times what they were. n is `power`, or as near to it as numbers go.
    """
    system = case.problem
    assert isinstance(system, PolynomialSystem)
    # The brackets {H, H_j} are sums of products of three coefficients.
    most = (EXPONENTS / 3 if system.noise_hamiltonians else EXPONENTS) - 2 * abs(time)
    while power and any(abs(e) > most for e in _exponents(case, system, power)):
        power = int(power / 1.25)
    changed = replace(
        system,
        hamiltonian=_scaled(system.hamiltonian, 2, power, time),
        structure=_of(system.structure, power),
        noise=tuple(math.ldexp(c, time) for c in system.noise),
        damping=math.ldexp(system.damping, -2 * time),
        nambu=system.nambu and (_scaled(system.nambu[0], -1, power), _scaled(system.nambu[1], 2, power)),
        polynomial_casimirs=tuple(_scaled(p, 2, power) for p in system.polynomial_casimirs),
        noise_structures=tuple(_of(G, power) for G in system.noise_structures),
        noise_hamiltonians=tuple(_scaled(p, 2, power, time) for p in system.noise_hamiltonians),
        noise_vectors=tuple(tuple(math.ldexp(v, power - 2 * time) for v in g) for g in system.noise_vectors),
    )
    y, dW = (tuple(math.ldexp(v, e) for v in vector) for vector, e in ((case.y, power), (case.dW, time)))
    return replace(case, problem=changed, y=y, h=math.ldexp(case.h, 2 * time), dW=dW)


def _scaled(p: Polynomial, weight: int, power: int, time: int = 0) -> Polynomial:
    """4⁻ᵏ2^(n weight) p(2⁻ⁿy), n = `power` and k = `time`."""
    terms = [(e, math.ldexp(c, power * (weight - sum(e)) - 2 * time)) for e, c in p.terms]
    return poly.polynomial(p.dimension, terms)


def _of(B: Structure, power: int) -> Structure:
    return tuple((i, j, _scaled(entry, 0, power)) for i, j, entry in B)


def _exponents(case: Case, system: PolynomialSystem, power: int) -> Iterator[float]:
    """Exponents of 2 of the numbers of the case in those units, and of powers of y; a large one for too large a y."""
    sizes = [abs(v) for v in case.y if v]
    ends = [math.log2(v) + power for v in (max(sizes), min(sizes))] if sizes else []
    yield from (EXPONENTS + 1 for end in ends[:1] if abs(end) > LARGEST)
    fields = [(2, p) for p in (system.hamiltonian, *system.noise_hamiltonians, *system.polynomial_casimirs)]
    fields += [(0, p) for B in (system.structure, *system.noise_structures) for _, _, p in B]
    if system.nambu is not None:
        fields += [(-1, system.nambu[0]), (2, system.nambu[1])]
    for weight, p in fields:
        yield from (end * p.degree for end in ends)
        yield from (math.log2(abs(c)) + power * (weight - sum(e)) for e, c in p.terms)
