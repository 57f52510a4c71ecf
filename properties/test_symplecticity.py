"""Φ′(y0) B Φ′(y0)ᵀ = B for constant B: symplecticity where B is canonical, as of the midpoint rule and Gauss methods.

It is the law "poisson-map" for constant B alone: Runge-Kutta methods that keep all quadratic invariants are symplectic
(J. M. Sanz-Serna, BIT 28, 1988), and so they are with the random step Δ, but no Poisson maps for other B.
"""

from __future__ import annotations

from sepv.schemes import Scheme
from sepv.verification import Effort, require, searched
from sepv.verification._cases.fixed_cases import with_constant_structure
from sepv.verification._cases.poisson import constant_structure_steps
from sepv.verification._contraction import is_short
from sepv.verification._poisson_map import check


def test_symplecticity(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)


law = searched(
    name="symplecticity",
    statement="Φ′(y0) B Φ′(y0)ᵀ = B for constant B",
    source="GNI VI.4",
    unit="ulp of B",
    cost=1.2,
    steps=2361,
    cases=constant_structure_steps,
    check=check,
    fixed_cases=lambda: tuple(case for case in with_constant_structure() if is_short(case)),
    admits=is_short,
    undesigned=3,
)
