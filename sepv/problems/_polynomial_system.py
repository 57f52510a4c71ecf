"""Problems with polynomial H and B, made from coefficients, with analytic derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from functools import lru_cache
from typing import Any

import numpy as np

from sepv.errors import ProblemError
from sepv.problem import (
    DampedProblem,
    HamiltoniansProblem,
    Matrix,
    Nambu,
    PolynomialSystem,
    Problem,
    Structure,
    StructuresProblem,
    commuting_hamiltonians,
)
from sepv.problems._nambu_system import check_nambu
from sepv.record import EPS, Polynomial, PolynomialMap, poly

# The largest dimension d. It is bounded because the derivatives of B are d³ polynomials.
POLYNOMIAL_MAX_DIMENSION = 64


@lru_cache(maxsize=512)
def polynomial_problem(data: PolynomialSystem) -> Problem:
    """The problem that polynomial data describe, with analytic derivatives;
    the degree of H makes averages of ∇H exact.

    Raises
    ------
    ProblemError
        If parts of the data do not fit together. For example, ∇CᵀB has a coefficient ≠ 0 for one of
        the Casimirs C.
    """
    d = data.dimension
    if d > POLYNOMIAL_MAX_DIMENSION:
        raise ProblemError(
            expected=f"at most {POLYNOMIAL_MAX_DIMENSION} dimensions: "
            "B, its derivatives and H″ are tables of polynomials",
            received=f"{d}",
            remedy="a smaller system: B is a dense matrix",
        )
    _check_indices(data)
    _check_shapes(data)
    structure, derivative = _structure_maps(d, data.structure)
    _check_casimirs(d, data.structure, data.casimirs, data.linear_casimirs, data.polynomial_casimirs)
    check_nambu(data)
    gradient = poly.gradient(data.hamiltonian)
    H = PolynomialMap((), (data.hamiltonian,))
    problem = Problem(
        dimension=d,
        structure=structure,
        hamiltonian=H,
        gradient=PolynomialMap((d,), gradient),
        hessian=PolynomialMap((d, d), _hessian(gradient)),
        structure_derivative=derivative,
        noise=np.array(data.noise),
        casimirs=data.casimirs,
        linear_casimirs=data.linear_casimirs,
        degree=max(data.hamiltonian.degree, 1),
        name=f"polynomial system in {d} variables",
        data=data,
        nambu=None if data.nambu is None else _nambu(*data.nambu),
        invariants={name: PolynomialMap((), (I,)) for name, I in data.invariants},
        check=False,
    )
    more = data.noise_structures or data.noise_hamiltonians or data.noise_vectors
    if data.damping and (data.noise_structures or (more and not isinstance(data.damping, tuple))):
        raise ProblemError(
            expected="damping: a matrix beside noise_vectors or noise_hamiltonians, a number where noises have the "
            "field of the drift",
            received=f"{data.damping!r:.80}, and noises with "
            f"{'structures' if data.noise_structures else 'fields'} of their own",
            remedy="give the matrix γI for a rate γ, and no noise_structures",
        )
    if isinstance(data.damping, tuple) and not data.noise_hamiltonians:
        return HamiltoniansProblem(
            **_shared(problem), noise_vectors=data.noise_vectors, damping=data.damping, check=False
        )
    if data.damping and not more:
        return DampedProblem(**_shared(problem), damping=data.damping, check=False)
    return _with_more_noise(problem, data) if more else problem


def started(data: PolynomialSystem, name: str, initial: Sequence[float], **more: Any) -> Problem:
    """The problem of polynomial data with this name and initial state;
    `more` sets other attributes of the problem.
    """
    return replace(polynomial_problem(data), name=name, initial=tuple(initial), check=False, **more)


def _hessian(gradient: tuple[Polynomial, ...]) -> tuple[Polynomial, ...]:
    """The second derivatives ∂²H/∂y_i∂y_k from ∇H, row by row;
    the lower triangle repeats the upper one.
    """
    above = [poly.gradient(slope, i) for i, slope in enumerate(gradient)]
    numbers = range(len(gradient))
    return tuple(above[min(i, k)][abs(i - k)] for i in numbers for k in numbers)


@lru_cache(maxsize=512)
def _structure_maps(d: int, structure: Structure) -> tuple[PolynomialMap, PolynomialMap]:
    """The functions B (d, d) and B′ (d, d, d) of a structure,
    cached for all systems with this structure.
    """
    zero = poly.polynomial(d, {})
    above = {(i, j): entry for i, j, entry in structure}
    below = {(j, i): poly.scale(-1.0, entry) for i, j, entry in structure}
    entries, none = above | below, (zero,) * d
    slopes = {place: poly.gradient(entry) for place, entry in entries.items()}
    places = [(i, j) for i in range(d) for j in range(d)]
    flat = tuple(entries.get(place, zero) for place in places)
    return PolynomialMap((d, d), flat), PolynomialMap(
        (d, d, d), tuple(p for place in places for p in slopes.get(place, none))
    )


def _with_more_noise(drift: Problem, data: PolynomialSystem) -> Problem:
    """The problem `drift` with the noises of `data`, which has a structure,
    a Hamiltonian or a vector for each c_j.

    If {H, H_j} = 0 for all noise Hamiltonians, and there is no friction, the flow keeps H, and the
    result is a `StructuresProblem`.
    """
    d = data.dimension
    counts = [len(data.noise_structures), len(data.noise_hamiltonians), len(data.noise_vectors)]
    if sorted(counts) != [0, 0, len(data.noise)]:
        raise ProblemError(
            expected="noise_structures, noise_hamiltonians or noise_vectors, one for each coefficient in noise",
            received="{} structures, {} Hamiltonians, {} vectors, ".format(*counts)
            + f"{len(data.noise)} coefficients",
            remedy="give as many coefficients c_j as there are G_j, H_j or g_j",
        )
    if data.noise_vectors:
        return HamiltoniansProblem(**_shared(drift), noise_vectors=data.noise_vectors, check=False)
    if data.noise_hamiltonians:
        slopes = [poly.gradient(p) for p in data.noise_hamiltonians]
        gradients = [PolynomialMap((d,), slope) for slope in slopes]
        hessians = [PolynomialMap((d, d), _hessian(slope)) for slope in slopes]
        if data.damping or not all(
            vanishes(bracket(data, data.hamiltonian, p)) for p in data.noise_hamiltonians
        ):
            return HamiltoniansProblem(
                **_shared(drift),
                noise_hamiltonians=tuple(PolynomialMap((), (p,)) for p in data.noise_hamiltonians),
                noise_gradients=tuple(gradients),
                noise_hessians=tuple(hessians),
                damping=data.damping,
                check=False,
            )
        return commuting_hamiltonians(
            drift, gradients, hessians=hessians, noise=data.noise, name=drift.name, data=data, check=False
        )
    for G in data.noise_structures:
        _check_indices(replace(data, structure=G))
        _check_casimirs(d, G, data.casimirs, data.linear_casimirs, data.polynomial_casimirs)
    maps = [_structure_maps(d, G) for G in data.noise_structures]
    return StructuresProblem(
        **_shared(drift),
        noise_structures=tuple(G for G, _ in maps),
        noise_structure_derivatives=tuple(slope for _, slope in maps),
        check=False,
    )


def _shared(drift: Problem) -> dict[str, Any]:
    """The attributes of `drift`, as keyword arguments for a subclass of `Problem` whose noises have
    their own parts.
    """
    return {f.name: getattr(drift, f.name) for f in fields(Problem) if f.init}


def bracket(data: PolynomialSystem, F: Polynomial, G: Polynomial) -> tuple[Polynomial, list[Polynomial]]:
    """The Poisson bracket {F, G} = ∇FᵀB∇G of two polynomials,
    and a list of the products whose sum it is.
    """
    left, right = poly.gradient(F), poly.gradient(G)
    terms = []
    for i, j, entry in data.structure:
        terms.append(poly.multiply(entry, poly.multiply(left[i], right[j])))
        terms.append(poly.scale(-1.0, poly.multiply(entry, poly.multiply(left[j], right[i]))))
    return poly.add(poly.polynomial(data.dimension, {}), *terms), terms


def vanishes(bracket: tuple[Polynomial, list[Polynomial]]) -> bool:
    """True if a sum of polynomials, given with its summands, is zero to rounding:
    `bracket` is (sum, summands).
    """
    total, terms = bracket
    size = max((abs(c) for p in terms for _, c in p.terms), default=0.0)
    return all(abs(c) <= 64 * EPS * size for _, c in total.terms)


def _nambu(factor: Polynomial, casimir: Polynomial) -> Nambu:
    """The `Nambu` record of polynomials g and C for B(y)v = g(y)(v × ∇C(y)),
    with analytic derivatives of C.
    """
    slope = poly.gradient(casimir)
    return Nambu(
        factor=PolynomialMap((), (factor,)),
        casimir=PolynomialMap((), (casimir,)),
        gradient=PolynomialMap((3,), slope),
        hessian=PolynomialMap((3, 3), tuple(poly.differentiate(g, k) for g in slope for k in range(3))),
        degree=max(casimir.degree, 1),
    )


def structure_entries(data: PolynomialSystem) -> list[list[Polynomial]]:
    """The structure B of polynomial data as a full d × d table of polynomials."""
    d = data.dimension
    table = [[poly.polynomial(d, {}) for _ in range(d)] for _ in range(d)]
    for i, j, entry in data.structure:
        table[i][j] = entry
        table[j][i] = poly.scale(-1.0, entry)
    return table


def _check_indices(data: PolynomialSystem) -> None:
    """Raise a ProblemError unless all entries of the structure lie above the diagonal,
    each at most once.
    """
    seen = set()
    for i, j, entry in data.structure:
        if not 0 <= i < j < data.dimension or (i, j) in seen or entry.dimension != data.dimension:
            raise ProblemError(
                expected=f"structure entries (i, j) with 0 ≤ i < j < {data.dimension}, each once",
                received=f"({i}, {j})",
                remedy="give B above the diagonal only: the rest follows from B_ji = −B_ij",
            )
        seen.add((i, j))


def _check_shapes(data: PolynomialSystem) -> None:
    """Raise a ProblemError unless H and the Casimirs (matrices, vectors, polynomials)
    fit the dimension d.
    """
    d, H = data.dimension, data.hamiltonian
    parts: list[tuple[bool, str, str]] = []
    for n, A in enumerate(data.casimirs):
        rows = [len(row) for row in A]
        fits = rows == [d] * d
        parts.append((fits, f"casimirs[{n}], a matrix of {d} rows of {d} numbers", f"rows of {rows} numbers"))
    for n, b in enumerate(data.linear_casimirs):
        parts.append((len(b) == d, f"linear_casimirs[{n}], a row of {d} numbers", f"{len(b)} numbers"))
    polynomials = {f"polynomial_casimirs[{n}]": C for n, C in enumerate(data.polynomial_casimirs)}
    polynomials |= {f"invariants[{name!r}]": I for name, I in data.invariants}
    for name, p in (polynomials | {"hamiltonian": H}).items():
        parts.append((p.dimension == d, f"{name} in {d} variables", f"one in {p.dimension}"))
    for fits, expected, received in parts:
        if not fits:
            remedy = "give one for each component of y"
            raise ProblemError(expected=expected, received=received, remedy=remedy)


@lru_cache(maxsize=256)
def _check_casimirs(
    d: int, structure: Structure, casimirs: tuple[Matrix, ...], linear_casimirs: Matrix,
    polynomial_casimirs: tuple[Polynomial, ...],
) -> None:  # fmt: skip
    """Raise a ProblemError unless all coefficients of ∇CᵀB are zero to rounding,
    for each Casimir C.

    The result depends on B and the Casimirs alone. It is cached, so that systems that differ only
    in H share it.
    """
    zero = poly.polynomial(d, {})
    # The gradient ∇C up to a factor: Ay for yᵀAy, b for bᵀy.
    slopes = {f"casimirs[{n}]": [poly.linear(row) for row in A] for n, A in enumerate(casimirs)}
    for n, b in enumerate(linear_casimirs):
        slopes[f"linear_casimirs[{n}]"] = [poly.constant(d, value) for value in b]
    for n, C in enumerate(polynomial_casimirs):
        slopes[f"polynomial_casimirs[{n}]"] = list(poly.gradient(C))
    for name, slope in slopes.items():
        products: list[list[Polynomial]] = [[] for _ in slope]
        for i, j, entry in structure:
            products[j].append(poly.multiply(slope[i], entry))
            products[i].append(poly.scale(-1.0, poly.multiply(slope[j], entry)))
        for j, terms in enumerate(products):
            total = poly.add(zero, *terms)
            if not vanishes((total, terms)):
                raise ProblemError(
                    expected=f"{name} to be a Casimir: ∇CᵀB = 0 for all y",
                    received=f"(∇CᵀB)[{j}] ∝ {total}",
                    remedy="correct C or B, or leave it out: no law then asks for it",
                )
