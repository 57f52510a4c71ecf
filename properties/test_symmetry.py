"""(2.1) is symmetric: its equation is the same with y0 and y1 exchanged and h, ΔW negated,
so a step back ends at y0.

The law "random-step" tests separately that h and ΔW act through the random step Δ alone.
"""

from __future__ import annotations

from sepv.properties._way_back import measured, no_memory

from sepv.law import Case, Cases, Effort, Measurement, Middle, require, searched
from sepv.schemes import Scheme


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure |y0′ − y0| after a step with (h, ΔW) and one with (−h, −ΔW)."""
    return measured(scheme, case)


def in_time(case: Case) -> Case | None:
    """Keep a case if h ≠ 0. Otherwise a scheme that refuses h < 0 would be judged by its steps with
    h = 0 alone.
    """
    return case if case.h else None


law = searched(
    name="symmetry",
    statement="Φ(−h, −ΔW) ∘ Φ(h, ΔW) = id: the step with −h and −ΔW from y1 returns to y0",
    source="(2.1)",
    unit="ulp of y",
    preserves=True,
    cost=0.6,
    steps=174,
    middle=Middle.MAP,
    premise=no_memory,
    cases=Cases(adapt=in_time, damped=True, blind={"degree of B": ("0",)}),
    check=check,
)


def test_symmetry(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
