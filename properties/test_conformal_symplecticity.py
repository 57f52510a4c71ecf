"""With damping −Γy and constant B, a step Φ has Φ′(y0) B Φ′(y0)ᵀ = e^{−κh}B if ΓB + BΓᵀ = κB.

The exact flow has this property for every H and every additive noise (`sepv.problem._damped.conformal_rate`). For
friction −γp on all momenta κ is γ, for −γy it is 2γ. In one degree of freedom it says det Φ′ = e^{−κh}.
"""

from __future__ import annotations

import math

from sepv.properties._poisson_map import check as defect
from sepv.properties._structures import is_constant

from sepv.problem import Systems, conformal_rate
from sepv.schemes import OF_DAMPED, Scheme
from sepv.verification import Case, Cases, Effort, Measurement, Middle, require, searched
from sepv.verification._contraction import shortened


def conformal(case: Case) -> Case | None:
    """Keep a case if its B is constant and its damping has a κ, and shorten its step to half the contraction radius."""
    problem, y, _, _ = case.build()
    if not problem.damping or not is_constant(problem, y) or conformal_rate(problem) is None:
        return None
    return shortened(case)


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure Φ′BΦ′ᵀ − e^{−κh}B, with the bound of the law "poisson-map"."""
    kappa = conformal_rate(case.build()[0])
    assert kappa is not None, "adapt keeps cases with a κ"
    return defect(scheme, case, math.exp(-kappa * case.h))


def test_conformal_symplecticity(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)


law = searched(
    name="conformal-symplecticity",
    statement="with damping −Γy, Φ′(y0) B Φ′(y0)ᵀ = e^(−κh)B for constant B with ΓB + BΓᵀ = κB",
    source="McLachlan and Perlmutter (2001)",
    unit="ulp of B",
    preserves=True,
    cost=0.1,
    middle=Middle.MAP,
    cases=Cases(
        where={"degree of B": ("0",), "Casimirs": ("none",), "d": ("2", "3", "4–6")},
        adapt=conformal,
        why="the problems have no damping −Γy with ΓB + BΓᵀ = κB and constant B",
        not_of={s: "the systems have no damping" for s in Systems if s not in OF_DAMPED},
        damped=True,
    ),
    check=check,
)
