"""Two steps Φ with equal h and ΔW return to y0 if the reversal ρ of momenta follows each:
ρ ∘ Φ ∘ ρ ∘ Φ = id.

If H(ρy) = H(y) and B(ρy) = −ρB(y)ρᵀ, the exact flow is reversible (`sepv.properties._reversal`),
also at the random time t + Σ c_jW_j. A symmetric scheme that commutes with ρ is reversible (Hairer,
Lubich and Wanner, *Geometric Numerical Integration*, V.1, Theorem 1.5). Unlike the law "symmetry",
this law takes no step with −h. Hybrid Monte Carlo needs reversible steps.
"""

from __future__ import annotations

from sepv.properties._reversal import momentum_flip
from sepv.properties._way_back import measured, no_memory

from sepv.law import Case, Cases, Effort, Measurement, Middle, require, searched
from sepv.problem import Systems, one_field
from sepv.problems import build
from sepv.schemes import Scheme


def reversible(case: Case) -> Case | None:
    """Keep a case if the reversal of momenta reverses the flow of its system."""
    return case if momentum_flip(build(case.problem)) is not None else None


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure |y0′ − y0| for y0′ = ρΦ(ρΦ(y0)).

    The step's equation y1 = y0 + R(y0, y1; Δ) has R(ρa, ρb; Δ) = −ρR(a, b; Δ) = ρR(a, b; −Δ). So
    y0′ solves the step from y1 with −h and −ΔW up to the residual of the second step, and the bound
    is that of the law "symmetry".
    """
    rho = momentum_flip(case.build()[0])
    assert rho is not None
    return measured(scheme, case, rho)


_NO_MOMENTA = "a half of y stands for the momenta, and the class has no such half"
_IN_THEIR_ORDER = "paths of several noises are reversed with their order in time"
law = searched(
    name="reversibility",
    statement="ρΦ(ρΦ(y0)) = y0 if the reversal ρ of momenta reverses the exact flow",
    source="GNI V.1",
    unit="ulp of y",
    preserves=True,
    cost=0.6,
    steps=174,
    middle=Middle.MAP,
    premise=no_memory,
    cases=Cases(
        adapt=reversible,
        why="H or B of the problems changes with the sign of the momenta, or nothing tells which half of y they are",
        instead={Systems.SINGLE: Systems.MECHANICAL},
        no_cases_of={Systems.NAMBU: _NO_MOMENTA},
        needs={one_field: _IN_THEIR_ORDER},
    ),
    check=check,
)


def test_reversibility(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
