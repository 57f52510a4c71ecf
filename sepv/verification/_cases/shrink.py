"""Simplify a case that violates, by steps that a reader would try: drop a term, a noise, a dimension; round a number.

What Hypothesis finds shrinks by itself. Cases of a design do not, and what violates only in one stratum may be found
nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from sepv import problems
from sepv.errors import SepvError
from sepv.problem import PolynomialSystem
from sepv.problem._problem import Structure
from sepv.record import Polynomial
from sepv.record import _polynomial as poly
from sepv.verification._cases.case import Case
from sepv.verification._contraction import contraction_radius


def shrunk(case: Case, fails: Callable[[Case], bool | None]) -> Case:
    """The simplest case found that still fails.

    Parameters
    ----------
    fails : case -> bool or None
        Whether a candidate is one of the law's cases and still fails; None ends the search. Candidates outside
        the contraction radius are not asked about: nothing need exist there.
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
    """Whether the candidate is a problem, with a step inside its contraction radius."""
    try:
        problem, y, h, dW = case.build()
    except SepvError:  # a matrix is no longer a Casimir, a structure no longer that of its factor
        return False
    if not isinstance(case.problem, PolynomialSystem):
        return True
    return abs(h) + float(np.abs(problem.c * dW).sum()) <= contraction_radius(problem, y)


def _candidates(case: Case) -> Iterator[Case]:
    """Simpler cases, the boldest first."""
    if case.given != "data":
        yield replace(case, given="data")
    if case.batch > 2:
        yield from (replace(case, batch=b) for b in (2, case.batch // 2, case.batch - 1))
    system = case.problem
    if isinstance(system, PolynomialSystem):
        yield from _smaller_systems(case, system)
    for k, v in enumerate(case.y):
        # Only what comes before v in this order is simpler: 1 and −1 would be tried in turn until the budget is spent.
        for simple in (0.0, 1.0, -1.0, _rounded(v)):
            if simple == v:
                break
            yield replace(case, y=(*case.y[:k], simple, *case.y[k + 1 :]))
    for k, v in enumerate(case.dW):
        for simple in (0.0, _rounded(v)):
            if simple != v:
                yield replace(case, dW=(*case.dW[:k], simple, *case.dW[k + 1 :]))
    if case.h != _rounded(case.h):
        yield replace(case, h=_rounded(case.h))


def _rounded(v: float) -> float:
    """The power of two below."""
    return float(np.sign(v) * 2.0 ** np.floor(np.log2(abs(v)))) if v else 0.0


def _smaller_systems(case: Case, system: PolynomialSystem) -> Iterator[Case]:
    d = system.dimension
    if d > 2 and system.nambu is None:
        for k in reversed(range(d)):
            yield replace(case, problem=_without(system, k), y=(*case.y[:k], *case.y[k + 1 :]))
    for j in reversed(range(len(system.noise))):
        yield replace(case, problem=_quieter(system, j), dW=(*case.dW[:j], *case.dW[j + 1 :]))
    if system.casimirs or system.linear_casimirs:
        yield replace(case, problem=replace(system, casimirs=(), linear_casimirs=()))
    for H in _simpler(system.hamiltonian):
        yield replace(case, problem=replace(system, hamiltonian=H))
    for n, H in enumerate(system.noise_hamiltonians):
        others = system.noise_hamiltonians
        for H_n in _simpler(H):
            yield replace(
                case, problem=replace(system, noise_hamiltonians=(*others[:n], H_n, *others[n + 1 :]))
            )
    if system.nambu is not None:
        g, C = system.nambu
        simpler = [(g, p) for p in _simpler(C)] + [(p, C) for p in _simpler(g)]
        for pair in simpler:
            yield replace(case, problem=problems.nambu_system(system.hamiltonian, *pair, system.noise))
        return
    for B in _simpler_structures(system.structure):
        yield replace(case, problem=replace(system, structure=B))
    for n, G in enumerate(system.noise_structures):
        for simple in _simpler_structures(G):
            parts = system.noise_structures
            yield replace(
                case, problem=replace(system, noise_structures=(*parts[:n], simple, *parts[n + 1 :]))
            )


def _simpler(p: Polynomial) -> Iterator[Polynomial]:
    """Half of the terms, all but one, and coefficients ±1 or powers of two."""
    terms = p.terms
    if len(terms) > 3:
        yield poly.polynomial(p.dimension, terms[: len(terms) // 2])
        yield poly.polynomial(p.dimension, terms[len(terms) // 2 :])
    if len(terms) > 1:
        yield from (poly.polynomial(p.dimension, (*terms[:t], *terms[t + 1 :])) for t in range(len(terms)))
    for t, (e, c) in enumerate(terms):
        for simple in (1.0, _rounded(c)):
            if simple != c:
                yield poly.polynomial(p.dimension, (*terms[:t], (e, simple), *terms[t + 1 :]))
                break


def _simpler_structures(B: Structure) -> Iterator[Structure]:
    for n, (i, j, entry) in enumerate(B):
        if len(B) > 1:
            yield (*B[:n], *B[n + 1 :])
        for simple in _simpler(entry):
            yield (*B[:n], (i, j, simple), *B[n + 1 :])


def _quieter(system: PolynomialSystem, j: int) -> PolynomialSystem:
    def fewer(parts: tuple[Any, ...]) -> tuple[Any, ...]:
        return (*parts[:j], *parts[j + 1 :])

    return replace(
        system,
        noise=fewer(system.noise),
        noise_structures=fewer(system.noise_structures),
        noise_hamiltonians=fewer(system.noise_hamiltonians),
    )


def _without(system: PolynomialSystem, k: int) -> PolynomialSystem:
    """The system with y_k = 0 and its row and column of B left out."""
    d = system.dimension - 1

    def restricted(p: Polynomial) -> Polynomial:
        return poly.polynomial(d, [((*e[:k], *e[k + 1 :]), c) for e, c in p.terms if not e[k]])

    def cut(B: Structure) -> Structure:
        return tuple((i - (i > k), j - (j > k), restricted(e)) for i, j, e in B if k not in (i, j))

    def shorter(row: Any) -> Any:
        return (*row[:k], *row[k + 1 :])

    return replace(
        system,
        dimension=d,
        hamiltonian=restricted(system.hamiltonian),
        structure=cut(system.structure),
        casimirs=tuple(tuple(shorter(row) for row in shorter(A)) for A in system.casimirs),
        linear_casimirs=tuple(shorter(b) for b in system.linear_casimirs),
        noise_structures=tuple(cut(G) for G in system.noise_structures),
        noise_hamiltonians=tuple(restricted(H) for H in system.noise_hamiltonians),
    )
