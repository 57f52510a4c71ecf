"""A step is a Poisson map: Φ′(y0) B(y0) Φ′(y0)ᵀ = B(y1), with h and the increments held fixed.

The part *constant* asks this of systems with constant B only, where it is symplecticity if B is the
canonical matrix. Runge-Kutta methods that keep all quadratic invariants, such as Gauss methods, are
symplectic (J. M. Sanz-Serna, BIT 28, 1988), also with the random step Δ, but no Poisson maps for
other B.

If B satisfies Jacobi's identity, the exact flow is a Poisson map (Hairer, Lubich and Wanner,
*Geometric Numerical Integration*, VII.2). The energy-preserving scheme (2.1) is not a Poisson map:
if a system has no invariants but functions of H and the Casimirs, a Poisson map that keeps H is the
exact flow at another time (Ge and Marsden, Phys. Lett. A 133, 1988).

The part *conformal* is about damping −Γy with ΓB + BΓᵀ = κB for a constant B. The exact flow then
has Φ′BΦ′ᵀ = e^{−κh}B, for every H and every additive noise
(`sepv.problem._damped.conformal_rate`). For friction −γp on all momenta κ is γ, for −γy it is 2γ.
In one degree of freedom it says det Φ′ = e^{−κh}.
"""

from __future__ import annotations

import math

from sepv.properties._poisson_map import check
from sepv.properties._structures import is_constant, is_poisson

from sepv.law import Case, Cases, Effort, Measurement, Middle, require, searched
from sepv.law.contraction import shortened
from sepv.problem import Fact, conformal_rate, damped, damping_of, hamiltonian_noises, same_structure
from sepv.schemes import Scheme


def poisson(case: Case) -> Case | None:
    """Keep a case if B satisfies Jacobi's identity, and shorten its step to at most half the
    contraction radius.
    """
    problem, y, _, _ = case.build()
    return shortened(case) if is_poisson(problem, y) else None


def constant(case: Case) -> Case | None:
    """Keep a case if its B is constant, and shorten its step to at most half the contraction
    radius.
    """
    problem, y, _, _ = case.build()
    return shortened(case) if is_constant(problem, y) else None


def conformal(case: Case) -> Case | None:
    """Keep a case of constant B if its damping has a κ."""
    problem, y, _, _ = case.build()
    if not damping_of(problem) or (kept := constant(case)) is None:
        return None
    return kept if conformal_rate(problem, y) is not None else None


def check_conformal(scheme: Scheme, case: Case) -> Measurement:
    """Measure Φ′BΦ′ᵀ − e^{−κh}B."""
    kappa = conformal_rate(*case.build()[:2])
    assert kappa is not None, "adapt keeps cases with a κ"
    return check(scheme, case, math.exp(-kappa * case.h))


MAP_SIZES = {
    "d": ("2", "3", "4–6"),
    "degree of H": ("1–2", "3–4", "5–6"),
    "terms of H": ("1–2", "3–9"),
}
ONE_STRUCTURE: dict[Fact, str] = {
    same_structure: "a map has one structure, and the systems have one for each noise"
}
law = searched(
    name="poisson-map",
    statement="Φ′(y0) B(y0) Φ′(y0)ᵀ = B(y1) if B satisfies Jacobi's identity",
    source="GNI VII.2",
    unit="ulp of B",
    preserves=True,
    cost=0.3,
    steps=464,
    middle=Middle.MAP,
    cases=Cases(
        where={"Jacobi": ("Poisson",), **MAP_SIZES},
        adapt=poisson,
        why="B of the problems does not satisfy Jacobi's identity, or the noise is given by vectors",
        needs={
            **ONE_STRUCTURE,
            hamiltonian_noises: "a translation by additive noise is no Poisson map of every B",
        },
    ),
    check=check,
)

for_constant_structure = searched(
    name="poisson-map:constant",
    statement="Φ′(y0) B Φ′(y0)ᵀ = B for constant B",
    source="GNI VI.4",
    unit="ulp of B",
    preserves=True,
    cost=1.2,
    steps=2361,
    middle=Middle.MAP,
    cases=Cases(
        where={
            "degree of B": ("0",),
            "degree of C": ("1",),
            "degree of g": ("0",),
            "Casimirs": ("none",),
            **MAP_SIZES,
        },
        adapt=constant,
        why="B of the problems is not constant",
        needs=ONE_STRUCTURE,
    ),
    check=check,
)

for_damping = searched(
    name="poisson-map:conformal",
    statement="with damping −Γy, Φ′(y0) B Φ′(y0)ᵀ = e^(−κh)B for constant B with ΓB + BΓᵀ = κB",
    source="J. Geom. Phys. 39",
    unit="ulp of B",
    preserves=True,
    cost=0.1,
    middle=Middle.MAP,
    cases=Cases(
        where={"degree of B": ("0",), "Casimirs": ("none",), "d": MAP_SIZES["d"]},
        adapt=conformal,
        why="the problems have no damping −Γy with ΓB + BΓᵀ = κB and constant B",
        needs={damped: "the systems have no damping"},
        damped=True,
    ),
    check=check_conformal,
)
laws = (law, for_constant_structure, for_damping)


def test_poisson_map(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)


def test_poisson_map_for_constant_structure(scheme: Scheme, effort: Effort) -> None:
    require(for_constant_structure, scheme, effort)


def test_poisson_map_for_damping(scheme: Scheme, effort: Effort) -> None:
    require(for_damping, scheme, effort)
