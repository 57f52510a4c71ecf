"""Functions I with LI = σ − λI for the law *invariant*: those that a problem states,
and those of its class of systems.

L is the generator of a system (`sepv.problem.relation`). A problem states functions by name; their
σ and λ are found by recording. The classes of systems state H and Casimirs, with the σ and λ that
theory gives:

- **Casimirs** of one or more Hamiltonians are kept, whatever their degree. The law *casimir* is
  about yᵀAy and bᵀy.
- **Friction** −γy: a homogeneous function of degree p that B∇H keeps decays as e^(−pγt), by
  yᵀ∇I = pI.
- **Additive noise** Σ c_j g_j dW_j: for Casimirs ∇CᵀB = 0 leaves LC = ½ Σ_j c_j² g_jᵀC″g_j.
- **Several Hamiltonians**: LH_0 = ½ Σ_j c_j² {{H_0, H_j}, H_j}, which need not be a constant.

(D. Cohen and G. Vilmart, Int. J. Comput. Math. 99, 2022, for additive noise; arXiv 2503.01540 for
friction.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from sepv import problems
from sepv.law.cases.case import Case, with_order
from sepv.problem import (
    Array,
    Function,
    GivenProblem,
    PolynomialSystem,
    Problem,
    Relation,
    damping_of,
    derivatives,
    noise_vectors,
    one_hamiltonian,
    relation,
    uniform_damping,
)
from sepv.problems import bracket
from sepv.record import Polynomial, PolynomialMap, poly


class StatedFunction(NamedTuple):
    """A function I with LI = σ − λI: its name, I, ∇I (d, ...), I″ (None for a polynomial),
    and the relation.
    """

    name: str
    value: Function
    slope: Function
    curve: Function | None
    relation: Relation


def by_problem(case: Case) -> list[StatedFunction]:
    """The functions that the problem of a case states."""
    problem = problems.build(case.problem)
    return [
        StatedFunction(name, I, *_slopes(I, problem.dimension), relation(problem, name))
        for name, I in problem.invariants.items()
    ]


@lru_cache(maxsize=256)
def _slopes(I: Function, dimension: int) -> tuple[Function, Function]:
    derived = derivatives(dimension, I, "an invariant")
    return derived.gradient, derived.hessian


def polynomial_data(case: Case) -> PolynomialSystem | None:
    """The problem of a case as polynomial data, also if it is given as functions;
    None if there is no such data.
    """
    data = case.problem.problem.data if isinstance(case.problem, GivenProblem) else case.problem
    return data if isinstance(data, PolynomialSystem) else None


def energies(case: Case) -> list[StatedFunction]:
    """H, if friction or noise moves it and it is polynomial data."""
    data = polynomial_data(case)
    if data is None or has_friction_and_noise(case):
        return []
    degrees = {sum(exponents) for exponents, _ in data.hamiltonian.terms}
    if data.damping:
        decays = Relation(0.0, max(degrees, default=0) * damping_of(problems.build(data)), (), drifts=True)
        return [_polynomial("H", data.hamiltonian, decays)] if len(degrees) == 1 and degrees != {0} else []
    rate = None if one_hamiltonian(problems.build(data)) else drift_of_energy(data)
    if rate is None:
        return []
    return [
        _polynomial("H", data.hamiltonian, Relation(rate, 0.0, tuple(range(len(data.noise))), drifts=False))
    ]


def has_friction_and_noise(case: Case) -> bool:
    """True if additive noise acts beside friction: then LH and LC are no σ − λH and σ − λC with
    theory's constants.
    """
    problem = problems.build(case.problem)
    return bool(damping_of(problem)) and uniform_damping(problem) is None


def drift_of_energy(data: PolynomialSystem) -> float | None:
    """The constant rate at which the mean of H_0 changes; None if the rate depends on y.

    The rate is LH_0 with the generator L: ½ Σ_j c_j² {{H_0, H_j}, H_j}, or ½ Σ_j c_j² g_jᵀH_0″g_j
    for vectors g_j.
    """
    noises: list[Callable[[Polynomial], Polynomial]]
    noises = [lambda p, H=H: bracket(data, p, H)[0] for H in data.noise_hamiltonians]  # type: ignore[misc]
    noises += [lambda p, g=g: _along(p, g) for g in data.noise_vectors]  # type: ignore[misc]
    parts = [poly.scale(0.5 * c * c, f(f(data.hamiltonian))) for c, f in zip(data.noise, noises, strict=True)]
    total = poly.add(poly.polynomial(data.dimension, {}), *parts)
    return None if total.degree else sum((c for _, c in total.terms), 0.0)


def _along(p: Polynomial, g: Sequence[float]) -> Polynomial:
    """The derivative ∇pᵀg of a polynomial p along a vector g."""
    parts = [poly.scale(v, slope) for v, slope in zip(g, poly.gradient(p), strict=True)]
    return poly.add(poly.polynomial(p.dimension, {}), *parts)


def casimirs(case: Case) -> list[StatedFunction]:
    """The Casimirs, if the law *casimir* does not speak of them: with friction, additive noise,
    or of any degree.
    """
    problem = problems.build(case.problem)
    if has_friction_and_noise(case):
        return []
    forms = [("yᵀAy", A) for A in problem.casimirs] + [("bᵀy", b) for b in problem.linear_casimirs]
    if damping_of(problem) or len(noise_vectors(problem)):
        return [_polynomial(name, _form(A), _of_form(problem, A)) for name, A in forms]
    kept, given = Relation(0.0, 0.0, (), drifts=False), isinstance(case.problem, GivenProblem)
    found = [_polynomial("C", C, kept) for C in getattr(problem.data, "polynomial_casimirs", ())]
    if problem.nambu is not None:
        found.append(
            StatedFunction("C", problem.nambu.casimir, problem.nambu.gradient, problem.nambu.hessian, kept)
        )
    return [] if given else found


def _of_form(problem: Problem, A: Array) -> Relation:
    """LC = σ − λC for a Casimir C = yᵀAy or bᵀy: σ = Σ_j c_j² g_jᵀAg_j by additive noise,
    λ = γ·(degree of C).
    """
    g = noise_vectors(problem)
    if not len(g):
        return Relation(0.0, A.ndim * damping_of(problem), (), drifts=True)
    rate = float(problem.c**2 @ np.sum((g @ A) * g, axis=1)) if A.ndim == 2 else 0.0
    return Relation(rate, 0.0, tuple(range(problem.noises)), drifts=False)


def _form(A: Array) -> Polynomial:
    """The polynomial yᵀAy of a matrix A (d, d), or bᵀy of a vector."""
    unit = np.eye(len(A), dtype=int)
    terms = [(tuple(unit[list(at)].sum(axis=0).tolist()), float(v)) for at, v in np.ndenumerate(A) if v]
    return poly.polynomial(len(A), terms)


def _polynomial(name: str, p: Polynomial, known: Relation) -> StatedFunction:
    return StatedFunction(
        name, PolynomialMap((), (p,)), PolynomialMap((p.dimension,), poly.gradient(p)), None, known
    )


def with_noises(case: Case, kept: Sequence[int]) -> Case | None:
    """The case with the noises `kept` of its polynomial data, in this order.

    None if the problem is not given as data, or if the class of systems then changes.
    """
    data = polynomial_data(case)
    if data is None:
        return None

    fewer = with_order(replace(case, problem=data), kept)
    return None if one_hamiltonian(problems.build(fewer.problem)) else fewer
