"""(2.1) is symmetric: its equation is the same with y0 and y1 exchanged and h, ΔW negated, so a step back ends at y0.

The law "random-step" tests separately that h and ΔW act through the random step Δ alone.
"""

from __future__ import annotations

from sepv.properties._way_back import measured

from sepv.errors import SchemeFault, Skipped, StepFailure
from sepv.problem import Array, Problem
from sepv.schemes import Scheme, SchemeCrash, ask
from sepv.verification import Case, Cases, Effort, Measurement, require, searched


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure |y0′ − y0| after a step with (h, ΔW) and one with (−h, −ΔW)."""
    problem, _, h, dW = case.build()
    return measured(scheme, case, lambda y1: _back(scheme, problem, y1, h, dW))


def _back(scheme: Scheme, problem: Problem, y1: Array, h: float, dW: Array) -> Array:
    """Return the state after a step with (−h, −ΔW) from y1.

    Raises
    ------
    Skipped
        If the scheme refuses h < 0, that is, fails with this step and with a step −2⁻¹⁷h without noise.
    """
    try:
        return ask(scheme, problem, y1, -h, -dW)
    except (StepFailure, SchemeFault, SchemeCrash) as error:
        if h > 0 and not _solves(scheme, problem, y1, -(2.0**-17) * h, 0 * dW):
            raise Skipped(f"the scheme makes no step with h < 0 ({_first_line(error)})") from error
        raise


def _solves(scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array) -> bool:
    try:
        ask(scheme, problem, y, h, dW)
    except (StepFailure, SchemeFault, SchemeCrash):
        return False
    return True


def _first_line(error: Exception) -> str:
    """Return the name and text of an error's cause, for a message in which equal reasons are counted together."""
    cause = error.__cause__
    return f"{type(cause).__name__}: {cause}" if cause is not None else type(error).__name__


def in_time(case: Case) -> Case | None:
    """Keep a case if h ≠ 0. Otherwise a scheme that refuses h < 0 would be judged by its steps with h = 0 alone."""
    return case if case.h else None


law = searched(
    name="symmetry",
    statement="Φ(−h, −ΔW) ∘ Φ(h, ΔW) = id: the step with −h and −ΔW from y1 returns to y0",
    source="(2.1)",
    unit="ulp of y",
    cost=0.6,
    steps=174,
    cases=Cases(adapt=in_time, damped=True, blind={"degree of B": ("0",)}),
    check=check,
)


def test_symmetry(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
