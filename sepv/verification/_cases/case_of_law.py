"""What each law makes of a step of a user's problem: as it is, changed, or nothing, with the reason.

A law that is about the noise changes the noise; a law about quadratic H leaves out every other. `TURNS` has the laws
that do not take every case as it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from sepv import problems as named
from sepv.problem import (
    Array,
    GivenProblem,
    HamiltoniansProblem,
    PolynomialSystem,
    Problem,
    StructuresProblem,
    is_poisson,
)
from sepv.problem._hamiltonians import is_several
from sepv.problem._poisson import derivative_of_structure
from sepv.problems._polynomial_system import drift_of_energy
from sepv.verification._cases.case import Case, with_noise
from sepv.verification.strategies import halved, in_the_mean

# What a law makes of a case, or None where it says nothing about it.
Turn = Callable[[Case], Case | None]


def as_it_is(case: Case) -> Case:
    return case


def _where(holds: Callable[[Problem], Any], *, data: bool = False) -> Turn:
    """The case as it is where this holds of its problem, and where that is given as data if it has to be."""

    def turn(case: Case) -> Case | None:
        lacks = data and _functions(case)
        return case if not lacks and holds(named.build(case.problem)) else None

    return turn


def _no_step(case: Case) -> Case | None:
    """h = c_1 2^-n and ΔW_1 = −2^-n: Δ = 0 exactly, whatever c_1 is, the other increments being zero."""
    problem = named.build(case.problem)
    if is_several(problem):  # no noise cancels h
        return replace(case, h=0.0, dW=(0.0,) * problem.noises)
    c = problem.c
    if not c.size or not c[0]:
        return None
    unit = 2.0 ** np.floor(np.log2(max(abs(case.h), 2.0**-30)))
    return replace(case, h=float(c[0] * unit), dW=(-float(unit), *(0.0,) * (c.size - 1)))


def _functions(case: Case) -> bool:
    return isinstance(case.problem, GivenProblem)


def _constant_or_silent(case: Case) -> Case | None:
    """B constant: as it is. Else the same system without noise, which the law compares with the deterministic step."""
    if _functions(case):
        return None
    problem = named.build(case.problem)
    if is_several(problem):
        return None
    rng = np.random.default_rng(1)
    states = np.array(case.y)[:, None] * (1 + 0.25 * rng.uniform(-1, 1, (len(case.y), 4)))
    B = problem.structure(states)
    if bool(np.all(B[..., :1] == B)) and problem.c.any():
        return case
    return with_noise(case, (0.0,) * max(1, problem.noises), (case.dW or (case.h,)))


def _several_noises(case: Case) -> Case | None:
    """Two noises at least; a second one, half of the first, where there is one only."""
    c = tuple(float(v) for v in named.build(case.problem).c)
    if len(c) > 1 or is_several(named.build(case.problem)):
        return case if len(c) > 1 else None
    first = c[0] if c and c[0] else 1.0
    share = case.dW[0] if case.dW and c[0] else case.h
    return with_noise(case, (first, first / 2), (share / 2, share))


def _half_where(holds: Callable[[Problem, Array], Any]) -> Turn:
    """Half the step of a problem with one structure of which this holds at y."""

    def turn(case: Case) -> Case | None:
        problem = named.build(case.problem)
        one = not isinstance(problem, StructuresProblem)
        return halved(case) if one and holds(problem, np.array(case.y)) else None

    return turn


def _steady_drift(case: Case) -> Case | None:
    """Of a system whose E[H_0] changes at a constant rate, a step over which all likely increments have a solution."""
    data = case.problem
    if isinstance(data, GivenProblem) and isinstance(data.problem.data, PolynomialSystem):
        data = data.problem.data
    if not isinstance(data, PolynomialSystem) or not isinstance(named.build(data), HamiltoniansProblem):
        return None
    return None if drift_of_energy(data) is None else in_the_mean(replace(case, problem=data))


def of_one_hamiltonian(turn: Turn) -> Turn:
    """The turn for laws that say nothing of several Hamiltonians."""

    def turned(case: Case) -> Case | None:
        return None if isinstance(named.build(case.problem), HamiltoniansProblem) else turn(case)

    return turned


_noisy = _where(lambda p: p.c.any())
_NEEDS_DATA = "it compares with a solution in extended precision, which needs the problem as data"
# law: (what it makes of a case, why it says nothing where that is None)
TURNS: dict[str, tuple[Turn, str]] = {
    "casimir": (
        _where(lambda p: len(p.casimirs) or len(p.linear_casimirs)),
        "the problems name no quadratic or linear Casimir",
    ),
    "any-casimir": (
        _where(lambda p: p.nambu is not None, data=True),
        "the problems have no Casimir and factor in dimension 3 as data",
    ),
    "poisson-map": (_half_where(is_poisson), "B of the problems does not satisfy Jacobi's identity"),
    "symplecticity": (
        _half_where(lambda p, y: not np.any(derivative_of_structure(p, y))),
        "B of the problems is not constant",
    ),
    "positivity": (_where(lambda p: p.domain is not None), "the problems have no domain to leave"),
    "energy-drift": (
        _steady_drift,
        "the generator makes no constant of H_0, or the problems are not given as data",
    ),
    "identity": (_no_step, "the problems have no noise that could cancel h"),
    "midpoint": (
        _where(lambda p: p.degree in (1, 2), data=True),
        "the problems have no quadratic H given as data",
    ),
    "reduction": (_constant_or_silent, _NEEDS_DATA),
    "noise-sum": (_several_noises, "the problems have one structure for each noise"),
    "symmetry": (_noisy, "the problems have no noise"),
    "random-step": (_noisy, "the problems have no noise"),
    "reference": (_where(lambda _: True, data=True), _NEEDS_DATA),
}
_NOT_KEPT = "with several Hamiltonians that do not commute with H_0 the exact flow does not keep H_0"
_OTHER = "it is about the equation of (2.1), which several Hamiltonians do not have"
# What laws cannot say of several Hamiltonians {H_0, H_j} ≠ 0.
NOT_OF_HAMILTONIANS = {
    **dict.fromkeys(("energy", "rounding"), _NOT_KEPT),
    "random-step": "with several Hamiltonians there is no random step Δ",
    **dict.fromkeys(("midpoint", "reduction", "reference"), _OTHER),
    "any-casimir": "its cases have one Hamiltonian: see casimir, and poisson-map",
}
# Laws whose cases are systems of their own.
OUTSIDE = {
    "expansion": "it starts at y = 0 with systems made for that; the local laws measure the order on these problems",
    "equivariance": "a change of variables leads out of the problems that the scheme is for",
}
