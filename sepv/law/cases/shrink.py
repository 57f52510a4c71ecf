"""Simplify a case that violates a law, as a reader would: drop a term, a noise or a dimension,
or round a number.

Hypothesis shrinks its own examples. Cases that come from a list (a law's design) need this module,
because Hypothesis may not find a rare violation again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from sepv import problems
from sepv.errors import SepvError
from sepv.law.cases.case import Case
from sepv.law.cases.ends import in_other_units
from sepv.law.contraction import contraction_radius
from sepv.problem import PolynomialSystem, Structure
from sepv.record import Polynomial, poly

# States and steps beyond UNITS_LIMIT or below 1/UNITS_LIMIT are shown in other units, if the law is
# violated there too.
UNITS_LIMIT = 2.0**16


def shrunk(case: Case, fails: Callable[[Case], bool | None]) -> Case:
    """The simplest case found that still fails.

    `fails` returns True if a candidate is one of the law's cases and still fails; None ends the
    search. Candidates outside the contraction radius are not tried, because they may have no
    solution.
    """
    simpler = True
    while simpler:
        simpler = False
        for candidate in _candidates(case):
            failed = _stands(candidate) and fails(candidate)
            if failed is None:
                return case
            if failed:
                case, simpler = candidate, True
                break
    return case


def _stands(case: Case) -> bool:
    """True if the simplified case is a valid problem with a step inside its contraction radius."""
    try:
        problem, y, h, dW = case.build()
    except SepvError:  # a matrix is no longer a Casimir, or a structure no longer agrees with its factor g
        return False
    if not isinstance(case.problem, PolynomialSystem):
        return True
    return abs(h) + float(np.abs(problem.c * dW).sum()) <= contraction_radius(problem, y)


def _candidates(case: Case) -> Iterator[Case]:
    """Simpler cases, the largest simplifications first."""
    if case.given != "data":
        yield replace(case, given="data")
    yield from (replace(case, after=n) for n in (0, *range(1, case.after)) if case.after)
    if in_strange_units(case) and not in_strange_units(known := in_known_units(case)):
        yield known
    if case.batch > 2:
        yield from (replace(case, batch=b) for b in (2, case.batch // 2, case.batch - 1))
    system = case.problem
    if isinstance(system, PolynomialSystem):
        yield from _smaller_systems(case, system)
    for k, v in enumerate(case.y):
        # Only values before v in this order are simpler: otherwise 1 and −1 would alternate until
        # the budget is spent.
        for simple in (0.0, 1.0, -1.0, _rounded(v)):
            if simple == v:
                break
            yield replace(case, y=_put(case.y, k, simple))
    for k, v in enumerate(case.dW):
        for simple in (0.0, _rounded(v)):
            if simple != v:
                yield replace(case, dW=_put(case.dW, k, simple))
    if case.h != _rounded(case.h):
        yield replace(case, h=_rounded(case.h))


def in_strange_units(case: Case) -> bool:
    """True for a case as data whose |y| or |h| is far from 1.
    In other units of y and time it says the same.
    """
    if not isinstance(case.problem, PolynomialSystem):
        return False
    sizes = [v for v in (abs(case.h), max(map(abs, case.y), default=0.0)) if v]
    return any(not 1 / UNITS_LIMIT <= size <= UNITS_LIMIT for size in sizes)


def in_known_units(case: Case) -> Case:
    """The case in units of y and of time in which |y| and |h| are near 1."""
    size = max(map(abs, case.y), default=0.0) or 1.0
    time = -round(math.log2(abs(case.h)) / 2) if case.h else 0
    return in_other_units(case, -round(math.log2(size)), time)


def _put(entries: tuple[Any, ...], n: int, *new: Any) -> tuple[Any, ...]:
    """Replace the n-th of the `entries` by the entries `new`, of which there may be none."""
    return (*entries[:n], *new, *entries[n + 1 :])


def _rounded(v: float) -> float:
    """The largest power of two that is at most |v|, with the sign of v; 0 for v = 0."""
    return float(np.sign(v) * 2.0 ** np.floor(np.log2(abs(v)))) if v else 0.0


def _smaller_systems(case: Case, system: PolynomialSystem) -> Iterator[Case]:
    d = system.dimension
    if d > 2 and system.nambu is None:
        for k in reversed(range(d)):
            yield replace(case, problem=_without(system, k), y=_put(case.y, k))
    for j in reversed(range(len(system.noise))):
        keys = ("noise", "noise_structures", "noise_hamiltonians", "noise_vectors")
        fewer: dict[str, Any] = {key: _put(getattr(system, key), j) for key in keys}
        yield replace(case, problem=replace(system, **fewer), dW=_put(case.dW, j))
    yield from (replace(case, problem=simpler) for simpler in _simpler_systems(system))


def _simpler_systems(system: PolynomialSystem) -> Iterator[PolynomialSystem]:
    """Simpler systems of the same dimension with the same number of noises."""
    if system.casimirs or system.linear_casimirs:
        yield replace(system, casimirs=(), linear_casimirs=())
    for n in range(len(system.polynomial_casimirs)):
        yield replace(system, polynomial_casimirs=_put(system.polynomial_casimirs, n))
    for H in _simpler(system.hamiltonian):
        yield replace(system, hamiltonian=H)
    for n, other in enumerate(system.noise_hamiltonians):
        for H in _simpler(other):
            yield replace(system, noise_hamiltonians=_put(system.noise_hamiltonians, n, H))
    if system.nambu is not None:
        g, C = system.nambu
        for pair in [(g, p) for p in _simpler(C)] + [(p, C) for p in _simpler(g)]:
            yield problems.nambu_system(system.hamiltonian, *pair, system.noise)
        return
    for B in _simpler_structures(system.structure):
        yield replace(system, structure=B)
    for n, G in enumerate(system.noise_structures):
        for simple in _simpler_structures(G):
            yield replace(system, noise_structures=_put(system.noise_structures, n, simple))


def _simpler(p: Polynomial) -> Iterator[Polynomial]:
    """Polynomials with half of the terms, with one term less,
    and with coefficients ±1 or powers of two.
    """
    terms = p.terms
    if len(terms) > 3:
        yield poly.polynomial(p.dimension, terms[: len(terms) // 2])
        yield poly.polynomial(p.dimension, terms[len(terms) // 2 :])
    if len(terms) > 1:
        yield from (poly.polynomial(p.dimension, _put(terms, t)) for t in range(len(terms)))
    for t, (e, c) in enumerate(terms):
        for simple in (1.0, _rounded(c)):
            if simple != c:
                yield poly.polynomial(p.dimension, _put(terms, t, (e, simple)))
                break


def _simpler_structures(B: Structure) -> Iterator[Structure]:
    for n, (i, j, entry) in enumerate(B):
        if len(B) > 1:
            yield _put(B, n)
        for simple in _simpler(entry):
            yield _put(B, n, (i, j, simple))


def _without(system: PolynomialSystem, k: int) -> PolynomialSystem:
    """The system with y_k = 0, without row and column k of B."""
    d = system.dimension - 1

    def restricted(p: Polynomial) -> Polynomial:
        return poly.polynomial(d, [(_put(e, k), c) for e, c in p.terms if not e[k]])

    def cut(B: Structure) -> Structure:
        return tuple((i - (i > k), j - (j > k), restricted(e)) for i, j, e in B if k not in (i, j))

    return replace(
        system,
        dimension=d,
        hamiltonian=restricted(system.hamiltonian),
        structure=cut(system.structure),
        casimirs=tuple(tuple(_put(row, k) for row in _put(A, k)) for A in system.casimirs),
        linear_casimirs=tuple(_put(b, k) for b in system.linear_casimirs),
        polynomial_casimirs=tuple(restricted(C) for C in system.polynomial_casimirs),
        noise_structures=tuple(cut(G) for G in system.noise_structures),
        noise_hamiltonians=tuple(restricted(H) for H in system.noise_hamiltonians),
        noise_vectors=tuple(_put(g, k) for g in system.noise_vectors),
        damping=tuple(_put(row, k) for row in _put(system.damping, k))
        if isinstance(system.damping, tuple)
        else system.damping,
        invariants=tuple((name, restricted(I)) for name, I in system.invariants),
    )
