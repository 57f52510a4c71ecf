"""A step Φ has Φ′(y0) B Φ′(y0)ᵀ = B for constant B, which is symplecticity if B is the canonical matrix.

The law "poisson-map" demands this for every B. Runge-Kutta methods that keep all quadratic invariants, such as Gauss
methods, are symplectic (J. M. Sanz-Serna, BIT 28, 1988), also with the random step Δ, but no Poisson maps for other B.
"""

from __future__ import annotations

from sepv.properties._poisson_map import check
from sepv.properties._structures import is_constant

from sepv.problem import Systems
from sepv.schemes import Scheme
from sepv.verification import Case, Cases, Effort, Middle, require, searched
from sepv.verification._contraction import shortened


def constant(case: Case) -> Case | None:
    """Keep a case if its B is constant, and shorten its step to at most half the contraction radius."""
    problem, y, _, _ = case.build()
    return shortened(case) if is_constant(problem, y) else None


def test_symplecticity(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)


law = searched(
    name="symplecticity",
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
            "d": ("2", "3", "4–6"),
            "degree of H": ("1–2", "3–4", "5–6"),
            "terms of H": ("1–2", "3–9"),
        },
        adapt=constant,
        why="B of the problems is not constant",
        not_of={Systems.SEVERAL: "a map has one structure, and the systems have one for each noise"},
    ),
    check=check,
)
