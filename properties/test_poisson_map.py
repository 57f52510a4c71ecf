"""A step is a Poisson map: Φ′(y0) B(y0) Φ′(y0)ᵀ = B(y1), with h and the increments held fixed.

The flow of (1.1) is one where B satisfies Jacobi's identity (Hairer, Lubich and Wanner, *Geometric Numerical
Integration*, VII.2). (2.1) is none: no method that is symplectic keeps all energies too (Ge and Marsden, Phys. Lett. A
133, 1988).
"""

from __future__ import annotations

from sepv.schemes import Scheme
from sepv.verification import Effort, require, searched
from sepv.verification._cases.fixed_cases import fixed_cases
from sepv.verification._cases.poisson import poisson_steps
from sepv.verification._contraction import is_short
from sepv.verification._poisson_map import check


def test_poisson_map(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)


law = searched(
    name="poisson-map",
    statement="Φ′(y0) B(y0) Φ′(y0)ᵀ = B(y1) wherever B satisfies Jacobi's identity",
    source="GNI VII.2",
    unit="ulp of B",
    cost=0.3,
    steps=464,
    cases=poisson_steps,
    check=check,
    fixed_cases=lambda: tuple(case for case in fixed_cases() if is_short(case)),
    admits=is_short,
    undesigned=6,
)
