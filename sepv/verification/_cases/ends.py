"""States of extreme size: a case at the usual size in other units.

The step is the same one, and a scheme without a number that has a unit gives the same digits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from sepv.problem import PolynomialSystem
from sepv.problem._problem import Structure
from sepv.record import Polynomial
from sepv.record import _polynomial as poly
from sepv.verification._cases.case import Case

# The exponents of 2 that coefficients and powers of y may have: none overflows, and 2⁻¹⁰⁷⁴, the error of what
# underflows, is 2⁻⁵³ of the smallest of them and less.
EXPONENTS = 960
# Sizes |y| of which every scheme is asked, and the largest exponent of 2 of any other, |y| = 1e±100, whose squares are
# numbers with all digits.
USUAL, LARGEST = (2.0**-21, 2.0**21), 333


def is_usual(size: float) -> bool:
    """True for sizes |y| of which every scheme is asked."""
    return USUAL[0] <= size <= USUAL[1]


def beyond(case: Case) -> bool:
    """True if the state is larger or smaller than every scheme is asked about."""
    largest = max(map(abs, case.y), default=0.0)
    return largest > 0 and not is_usual(largest)


def in_other_units(case: Case, power: int) -> Case:
    """The step from 2ⁿy with H(2⁻ⁿy), 2²ⁿB(2⁻ⁿy) and 2ⁿg_j, to 2ⁿy1; n is `power`, or as near to it as numbers go."""
    system = case.problem
    assert isinstance(system, PolynomialSystem)
    # The brackets {H, H_j} are sums of products of three coefficients.
    most = EXPONENTS / 3 if system.noise_hamiltonians else EXPONENTS
    while power and any(abs(e) > most for e in _exponents(case, system, power)):
        power = int(power / 1.25)
    H = system.hamiltonian
    changed = replace(
        system,
        hamiltonian=_scaled(H, 0, power),
        structure=_of(system.structure, power),
        nambu=system.nambu and (_scaled(system.nambu[0], 3, power), _scaled(system.nambu[1], 0, power)),
        noise_structures=tuple(_of(G, power) for G in system.noise_structures),
        noise_hamiltonians=tuple(_scaled(p, 0, power) for p in system.noise_hamiltonians),
        noise_vectors=tuple(tuple(math.ldexp(v, power) for v in g) for g in system.noise_vectors),
    )
    return replace(case, problem=changed, y=tuple(math.ldexp(v, power) for v in case.y))


def _scaled(p: Polynomial, weight: int, power: int) -> Polynomial:
    """2^(n weight) p(2⁻ⁿy), n = `power`."""
    return poly.polynomial(p.dimension, [(e, math.ldexp(c, power * (weight - sum(e)))) for e, c in p.terms])


def _of(B: Structure, power: int) -> Structure:
    return tuple((i, j, _scaled(entry, 2, power)) for i, j, entry in B)


def _exponents(case: Case, system: PolynomialSystem, power: int) -> Iterator[float]:
    """Exponents of 2 of the numbers of the case in those units, and of powers of y; a large one for too large a y."""
    sizes = [abs(v) for v in case.y if v]
    ends = [math.log2(v) + power for v in (max(sizes), min(sizes))] if sizes else []
    yield from (EXPONENTS + 1 for end in ends[:1] if abs(end) > LARGEST)
    fields = [(0, p) for p in (system.hamiltonian, *system.noise_hamiltonians)]
    fields += [(2, p) for B in (system.structure, *system.noise_structures) for _, _, p in B]
    if system.nambu is not None:
        fields += [(3, system.nambu[0]), (0, system.nambu[1])]
    for weight, p in fields:
        yield from (end * p.degree for end in ends)
        yield from (math.log2(abs(c)) + power * (weight - sum(e)) for e, c in p.terms)
