"""Simplify a case that violates a law, as a reader would: take a smaller case of the law,
drop a term, a noise or a dimension, or round a number.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import chain, islice
from typing import Any

import numpy as np

from sepv import problems
from sepv.errors import SepvError
from sepv.law.cases.case import Case
from sepv.law.cases.ends import in_known_units
from sepv.law.cases.families import algebra
from sepv.law.cases.from_problem import is_near
from sepv.law.contraction import contraction_radius
from sepv.problem import PolynomialSystem, Structure
from sepv.record import Polynomial, poly

# The most cases of the law that are tried before a case is changed, the smallest first.
OTHERS_TRIED = 50


def shrunk(
    case: Case,
    fails: Callable[[Case], bool | None],
    admits: Callable[[Case, Case], bool] = lambda _new, _old: True,
    others: Iterable[Case] = (),
) -> Case:
    """The simplest case found that still fails.

    Parameters
    ----------
    fails : case -> bool or None
        True if a candidate still fails; None ends the search.
    admits : (new, old) -> bool
        True if `new`, a change of `old`, is a case of the law too. Changes that lead outside the
        contraction radius, or away from a problem's initial state, are not tried, because the step
        may have no solution.
    others : cases
        Cases of the law. The smallest are tried before any change.
    """
    tried, start, simpler = {case}, 0, True  # each candidate is tried once
    smaller = sorted((other for other in others if size(other) < size(case)), key=size)[:OTHERS_TRIED]

    def changes(old: Case) -> Iterator[tuple[int, Case]]:
        # Kinds of changes that failed a moment ago come last.
        numbered = enumerate(_candidates(old))
        first = list(islice(numbered, start))
        for n, new in chain(numbered, first):
            if new not in tried and _stands(new, old) and admits(new, old):
                yield n, new

    candidates: Iterator[tuple[int, Case]] = chain(((0, other) for other in smaller), changes(case))
    while simpler:
        simpler = False
        for n, candidate in candidates:
            tried.add(candidate)
            failed = fails(candidate)
            if failed is None:
                return case
            if failed:
                case, start, simpler, candidates = candidate, n, True, changes(candidate)
                break
    return case


def size(case: Case) -> tuple[int, int]:
    """The size of a case: the number of variables, noises and terms, then the length of numbers.

    A problem without data counts as ten terms.
    """
    system, count = case.problem, 10 + len(case.y) + len(case.dW) + case.after + (case.given != "data")
    numbers = [*case.y, case.h, *case.dW]
    if isinstance(system, PolynomialSystem):
        entries = (p for B in (system.structure, *system.noise_structures) for _, _, p in B)
        terms = [t for p in (system.hamiltonian, *system.noise_hamiltonians, *entries) for t in p.terms]
        count, numbers = count + len(terms) - 10, [*numbers, *system.noise, *(c for _, c in terms)]
    return count, sum(len(repr(v)) for v in numbers)


def _stands(new: Case, old: Case) -> bool:
    """True if the simplified case is a valid problem with a step inside its contraction radius, or
    a part of the old step of a problem that is no polynomial data.
    """
    try:
        problem, y, h, dW = new.build()
    except SepvError:  # a matrix is no longer a Casimir, or a structure no longer agrees with its factor g
        return False
    if isinstance(new.problem, PolynomialSystem):
        return abs(h) + float(np.abs(problem.c * dW).sum()) <= contraction_radius(problem, y)
    shares = zip((h, *dW), (old.h, *old.dW), strict=True)
    return (new.y == old.y and all(abs(a) <= abs(b) for a, b in shares)) or is_near(new)


def _candidates(case: Case) -> Iterator[Case]:
    """Simpler cases, the largest simplifications first."""
    if case.given != "data":
        yield replace(case, given="data")
    yield from (replace(case, after=n) for n in (0, *range(1, case.after)) if case.after)
    if isinstance(case.problem, PolynomialSystem):
        yield from (new for new in in_known_units(case) if size(new) < size(case))
    if case.batch > 2:
        yield from (replace(case, batch=b) for b in (2, case.batch // 2, case.batch - 1))
    system = case.problem
    if isinstance(system, PolynomialSystem):
        yield from _smaller_systems(case, system)
    yield from _shorter_numbers(case)


def _shorter_numbers(case: Case) -> Iterator[Case]:
    """Cases with shorter numbers in y, dW and h: first in all of them, then in one."""
    for n in range(2):
        y, dW, (h,) = (tuple(_shorter(v)[-n] for v in values) for values in (case.y, case.dW, (case.h,)))
        yield replace(case, y=y, dW=dW, h=h)
    # A state as the problem has it is the simplest.
    start = None if isinstance(case.problem, PolynomialSystem) else problems.build(case.problem).initial
    for k, v in enumerate(case.y):
        # Only values before v in this order are simpler: otherwise 1 and −1 would alternate until
        # the budget is spent.
        given = () if start is None else (float(np.asarray(start)[k]),)
        for simple in (*given, 0.0, 1.0, -1.0, *_shorter(v)):
            if simple == v:
                break
            yield replace(case, y=_put(case.y, k, simple))
    for k, v in enumerate(case.dW):
        for simple in (0.0, *_shorter(v)):
            if simple == v:
                break
            yield replace(case, dW=_put(case.dW, k, simple))
    yield from (replace(case, h=h) for h in (abs(case.h), *_shorter(case.h)) if h != case.h)


def _put(entries: tuple[Any, ...], n: int, *new: Any) -> tuple[Any, ...]:
    """Replace the n-th of the `entries` by the entries `new`, of which there may be none."""
    return (*entries[:n], *new, *entries[n + 1 :])


def _shorter(v: float) -> tuple[float, ...]:
    """Numbers near v that are shorter to read, the shortest first: the largest power of two that is
    at most |v|, and two digits; only v itself if it is 0 or a power of two.
    """
    power = math.copysign(2.0 ** math.floor(math.log2(abs(v))), v) if v else 0.0
    return (v,) if v == power else (power, float(f"{v:.1e}"))


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
    d, B, quadratic, _ = algebra("so(3)")
    if system.casimirs and system.nambu is None and not system.noise_structures and system.structure != B:
        rest = replace(system, structure=(), casimirs=(), linear_casimirs=())
        while rest.dimension > d:
            rest = _without(rest, rest.dimension - 1)
        yield replace(case, problem=replace(rest, structure=B, casimirs=quadratic), y=case.y[:d])


def _simpler_systems(system: PolynomialSystem) -> Iterator[PolynomialSystem]:
    """Simpler systems of the same dimension with the same number of noises."""
    if system.casimirs or system.linear_casimirs:
        yield replace(system, casimirs=(), linear_casimirs=())
    for n in range(len(system.polynomial_casimirs)):
        yield replace(system, polynomial_casimirs=_put(system.polynomial_casimirs, n))
    yield replace(system, noise=(1.0,) * len(system.noise))
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
    """Polynomials with half of the terms, with one term less, with one factor y_k^n less,
    and with coefficients 1, powers of two or of two digits.
    """
    terms = p.terms
    if len(terms) > 3:
        yield poly.polynomial(p.dimension, terms[: len(terms) // 2])
        yield poly.polynomial(p.dimension, terms[len(terms) // 2 :])
    if len(terms) > 1:
        yield from (poly.polynomial(p.dimension, _put(terms, t)) for t in range(len(terms)))
    for t, (e, c) in enumerate(terms):
        fewer = (_put(e, k, 0) for k in range(p.dimension) if 0 < e[k] < sum(e))
        yield from (poly.polynomial(p.dimension, _put(terms, t, (powers, c))) for powers in fewer)
        for simple in (1.0, *_shorter(c)):
            if simple == c:
                break
            yield poly.polynomial(p.dimension, _put(terms, t, (e, simple)))


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
