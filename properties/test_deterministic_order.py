"""The order of a method without noise, c = (): order p means y1 = φ_h(y0) + O(h^(p+1))
with the exact flow φ.

The slope of the error of one step against h, in logarithms, is extrapolated to h = 0
(`sepv.properties._orders.without_noise`). The law holds if for all problems and states the order is
the claimed one or higher. For a scheme with memory it is the error of a path at a fixed time,
divided by the number of steps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from sepv.properties._failed_step import row
from sepv.properties._orders.without_noise import (
    Order,
    StepErrors,
    orders,
    path_errors,
    quiet_problems,
    rounds_step_sizes,
    step_errors,
)

from sepv.errors import Skipped
from sepv.law import Effort, Finding, Law, Run, Verdict, first_order, require
from sepv.law.advice import is_explicit
from sepv.problem import Problem
from sepv.schemes import Scheme, has_memory


def run(law: Law, scheme: Scheme, this_run: Run) -> Finding:  # noqa: ARG001 - nothing is drawn
    """Compare the least power of h in the error of a step with p + ½,
    for the claimed order p (1 without a claim).
    """
    if scheme.asks or scheme.systems.several_fields:
        why = "the scheme is for several fields, and y′ = B∇H has one"
        return law.finding(Verdict.NOT_APPLICABLE, message=why)
    claimed = scheme.order or 1.0
    least, lines, measured, checks = claimed + 0.5, [], [], 0
    judged: list[tuple[StepErrors, int, Order]] = []
    coarse: list[str] = []
    skipped: list[Skipped] = []
    carries = has_memory(scheme)
    what = "the error of a path, divided by its number of steps," if carries else "the error of a step"
    for problem in quiet_problems(scheme):
        try:
            errors = (path_errors if carries else step_errors)(scheme, problem)
        except Skipped as reason:
            skipped.append(reason)
            lines.append(f"{problem.name}: skipped, {reason.reason}")
            continue
        checks += errors.steps
        if errors.h.size < 4:
            why = f"{problem.name}: steps were not solved, or no flow; {errors.failed}"
            return law.finding(Verdict.ERROR, checks=checks, message=why)
        if h := rounds_step_sizes(scheme, problem):
            coarse.append(
                f"{problem.name}: steps of h(1 − 2⁻²⁸) and h(1 + 2⁻²⁸) are equal in every digit, h = {h:.3g}: h or y1 "
                "is rounded to 32 bits or fewer"
            )
        seen = orders(scheme, errors, least)
        s = min(range(len(seen)), key=lambda k: _first(seen[k], _OF_STATES))
        judged.append((errors, s, seen[s]))
        order: float | None = seen[s].order
        if order is None and seen[s].verdict is Verdict.HOLDS:  # no power, or only a bound
            order = claimed if scheme.order or np.isnan(seen[s].value) else max(1, int(seen[s].value) - 1)
        lines.append(f"{problem.name}: {_words(seen[s])}{what} is {seen[s].text}")
        measured.append({"problem": problem.name, "order": order, "verdict": seen[s].verdict.value})
    if not judged:
        raise skipped[0]
    errors, s, worst = min(judged, key=lambda entry: _first(entry[2], _OF_PROBLEMS))
    if worst.verdict is Verdict.VIOLATED:
        lines = [
            f"order {claimed:g} {'claimed' if scheme.order else 'needed'}, {worst.order} found",
            *lines,
        ]
        lines.append(_example(errors, s))
        if carries and _first_step_is_right(scheme, errors.problem, least):
            lines.append("the first step of a path has the order, and later steps do not")
        causes = first_order(scheme, errors.problem)
        lines += causes
        if not worst.order:
            start = errors.starts[:, s]
            solved = causes or is_explicit(scheme, errors.problem, start, float(errors.h[0]), np.zeros(0))
            hint = "" if solved else "; if it is the scheme's own solver: Scheme(…, solver_tolerance=…)"
            lines.append(f"order 0 is no convergence{hint}")
    verdict = Verdict.VIOLATED if coarse else worst.verdict
    return law.finding(
        verdict, defect=worst.value if np.isfinite(worst.value) else None, bound=least, at_least=True,
        checks=checks, message="\n".join(coarse + lines), witness={"measured": measured}, replay=f"--law {law.name}",
    )  # fmt: skip


# The first of these verdicts decides: an inconclusive state counts only if no other state of its
# problem decides.
_OF_STATES = (Verdict.VIOLATED, Verdict.HOLDS, Verdict.INCONCLUSIVE)
_OF_PROBLEMS = (Verdict.VIOLATED, Verdict.INCONCLUSIVE, Verdict.HOLDS)


def _first(order: Order, ranks: tuple[Verdict, ...]) -> tuple[int, float]:
    """Return the sorting key of an order: the rank of its verdict, then its slope."""
    return ranks.index(order.verdict), float(np.nan_to_num(order.value, nan=np.inf))


def _first_step_is_right(scheme: Scheme, problem: Problem, least: float) -> bool:
    """True if the errors of the first step of a path fall like the power `least` of h,
    from every state.
    """
    first = step_errors(scheme, problem)
    return first.h.size >= 4 and all(o.verdict is Verdict.HOLDS for o in orders(scheme, first, least))


def _words(order: Order) -> str:
    return "" if order.order is None else f"order {order.order}: "


def _example(errors: StepErrors, s: int) -> str:
    h, error = errors.h, errors.errors[s]
    sizes = ", ".join(f"{e:.3g}" for e in error[:: max(1, len(error) // 6)])
    start = f"{errors.problem.name}, from y0 = {row(errors.starts[:, s])}"
    return f"{start}: errors {sizes} for h = {h[0]:.3g} … {h[-1]:.2g}"


def replay(law: Law, scheme: Scheme, _witness: dict[str, Any]) -> Finding:
    """Run the law again, because it draws no random numbers that a witness would have to store."""
    return run(law, scheme, Run())


law = Law(
    name="deterministic-order",
    statement="without noise y1 = φ_h(y0) + O(h^(p+1)) with the exact flow φ_h and the claimed order p (default: 1)",
    source="GNI II.1",
    unit="power of h",
    cost=0.3,
    steps=369,
    run=run,
    replay=replay,
)


def test_deterministic_order(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
