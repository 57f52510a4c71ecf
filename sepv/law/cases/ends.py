"""States and steps of extreme size, made from a case of usual size by a change of the units of y
and of time.

A scheme gives the same digits in all units, unless it contains a number that has a unit, such as an
absolute tolerance.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from sepv.law.cases.case import Case
from sepv.law.cases.strata import EXTREME_SIZES, SIZE, STEP, Levels, Stratum
from sepv.problem import PolynomialSystem, Structure, scaled_damping
from sepv.record import Polynomial, poly

# The largest |exponent of 2| of coefficients and of powers of y. So none of them overflows, and an
# underflow, whose error is 2⁻¹⁰⁷⁴, changes even the smallest of them by a relative error below
# 2⁻⁵³.
MAX_EXPONENT = 960
# Sizes |y| that every scheme must take, and the largest exponent of 2 of other sizes: |y| = 1e±100,
# whose squares neither overflow nor lose digits.
USUAL_SIZES, MAX_SIZE_EXPONENT = (2.0**-21, 2.0**21), 333

# A scheme may refuse a step whose |h| + Σ|c_j ΔW_j| is larger than this.
LONGEST_STEP = 8.0


def is_usual(size: float) -> bool:
    """True if a size |y| is so near to 1 that no scheme may refuse a state of this size."""
    return USUAL_SIZES[0] <= size <= USUAL_SIZES[1]


def beyond(case: Case) -> bool:
    """True if the state y of a case is so large or so small that a scheme may refuse it."""
    largest = max(map(abs, case.y), default=0.0)
    return largest > 0 and not is_usual(largest)


def is_long(case: Case) -> bool:
    """True if |h| + Σ|c_j ΔW_j| is so large that a scheme may refuse the step,
    although it is usual in other units.
    """
    return isinstance(case.problem, PolynomialSystem) and _length(case) > LONGEST_STEP


def usual(levels: Levels) -> Levels:
    """Replace extreme ranges of |y| and |Δ| by usual ones. A case is drawn in these,
    then rescaled by `at_the_end`.
    """
    ranges = {a.name: {s.name: s._replace(end=0.0) for s in a.strata} for a in (SIZE, STEP)}
    found = {
        a: ranges[a].get(s.name, s) if a in ranges else s for a, s in levels.items() if s not in EXTREME_SIZES
    }
    far = next((s for s in levels.values() if s in EXTREME_SIZES), None)
    return {**found, SIZE.name: SIZE.strata[0]} if far else found


def at_the_end(case: Case, levels: Levels) -> Case:
    """Rescale the units of a case drawn in usual ranges,
    so that |y| and |Δ| come into the ranges in `levels`.
    """
    size = next((s for s in levels.values() if s in EXTREME_SIZES), levels[SIZE.name])
    length = levels[STEP.name]
    ordinary = usual(levels)
    power = _power(size, ordinary[SIZE.name], max(map(abs, case.y)))
    return in_other_units(case, power, round(_power(length, ordinary[STEP.name], _length(case)) / 2))


def _power(wanted: Stratum, ordinary: Stratum, value: float) -> int:
    """The n for which 2ⁿ times `value` has the `wanted` size;
    0 if this size is in the `ordinary` range.
    """
    unchanged = ordinary.low <= wanted.low <= ordinary.high or not value
    return 0 if unchanged else round(math.log2(wanted.low / value))


def _length(case: Case) -> float:
    assert isinstance(case.problem, PolynomialSystem)
    return abs(case.h) + sum(abs(c * w) for c, w in zip(case.problem.noise, case.dW, strict=True))


def in_other_units(case: Case, power: int, time: int = 0) -> Case:
    """Convert a case to other units: y is multiplied by 2ⁿ and time by 4ᵏ,
    so that the step leads to 2ⁿy1.

    Here k = `time`, and n is `power`, or a number nearer to 0 if numbers would otherwise overflow.
    H becomes 4⁻ᵏ2ʷⁿH(2⁻ⁿy) and B becomes 2²ⁿ⁻ʷⁿB(2⁻ⁿy) with w of `_weight`. The noise vectors
    become 2ⁿ4⁻ᵏg_j, the damping 4⁻ᵏγ and the step 4ᵏh; c_j and ΔW_j are multiplied by 2ᵏ.
    """
    system = case.problem
    assert isinstance(system, PolynomialSystem)
    # The brackets {H, H_j} are sums of products of three coefficients, so that three exponents add
    # up.
    most = (MAX_EXPONENT / 3 if system.noise_hamiltonians else MAX_EXPONENT) - 2 * abs(time)
    while power and any(abs(e) > most for e in _exponents(case, system, power)):
        power = int(power / 1.25)
    w = _weight(system)
    changed = replace(
        system,
        hamiltonian=_scaled(system.hamiltonian, w, power, time),
        structure=_of(system.structure, 2 - w, power),
        noise=tuple(math.ldexp(c, time) for c in system.noise),
        damping=scaled_damping(system.damping, 4.0**-time),
        nambu=system.nambu and (_scaled(system.nambu[0], -1, power), _scaled(system.nambu[1], 2, power)),
        polynomial_casimirs=tuple(_scaled(p, 2, power) for p in system.polynomial_casimirs),
        noise_structures=tuple(_of(G, 2 - w, power) for G in system.noise_structures),
        noise_hamiltonians=tuple(_scaled(p, w, power, time) for p in system.noise_hamiltonians),
        noise_vectors=tuple(tuple(math.ldexp(v, power - 2 * time) for v in g) for g in system.noise_vectors),
    )
    y, dW = (tuple(math.ldexp(v, e) for v in vector) for vector, e in ((case.y, power), (case.dW, time)))
    return replace(case, problem=changed, y=y, h=math.ldexp(case.h, 2 * time), dW=dW)


def _scaled(p: Polynomial, weight: int, power: int, time: int = 0) -> Polynomial:
    """The polynomial 4⁻ᵏ 2^(n·weight) p(2⁻ⁿy) with n = `power` and k = `time`:
    p after a change of units.
    """
    terms = [(e, math.ldexp(c, power * (weight - sum(e)) - 2 * time)) for e, c in p.terms]
    return poly.polynomial(p.dimension, terms)


def _weight(system: PolynomialSystem) -> int:
    """The exponent w of `in_other_units`: 1 for linear B, else 2,
    so that Lie-Poisson and canonical systems keep B.
    """
    entries = [p for B in (system.structure, *system.noise_structures) for _, _, p in B]
    linear = system.nambu is None and all(sum(e) == 1 for p in entries for e, _ in p.terms)
    return 1 if linear else 2


def _of(B: Structure, weight: int, power: int) -> Structure:
    return tuple((i, j, _scaled(entry, weight, power)) for i, j, entry in B)


def _exponents(case: Case, system: PolynomialSystem, power: int) -> Iterator[float]:
    """Exponents of 2 of coefficients and of powers of y in new units; if |y| leaves its range,
    one is > MAX_EXPONENT.
    """
    sizes = [abs(v) for v in case.y if v]
    ends = [math.log2(v) + power for v in (max(sizes), min(sizes))] if sizes else []
    yield from (MAX_EXPONENT + 1 for end in ends[:1] if abs(end) > MAX_SIZE_EXPONENT)
    w = _weight(system)
    fields = [(w, p) for p in (system.hamiltonian, *system.noise_hamiltonians)]
    fields += [(2, p) for p in system.polynomial_casimirs]
    fields += [(2 - w, p) for B in (system.structure, *system.noise_structures) for _, _, p in B]
    if system.nambu is not None:
        fields += [(-1, system.nambu[0]), (2, system.nambu[1])]
    for weight, p in fields:
        yield from (end * p.degree for end in ends)
        yield from (math.log2(abs(c)) + power * (weight - sum(e)) for e, c in p.terms)


def in_known_units(case: Case) -> list[Case]:
    """The case in units of y and of time in which |y| and |h| are near 1, and in units halfway."""
    size = max(map(abs, case.y), default=0.0) or 1.0
    power, time = -math.log2(size), -math.log2(abs(case.h)) / 2 if case.h else 0.0
    return [in_other_units(case, round(share * power), round(share * time)) for share in (1.0, 0.5)]
