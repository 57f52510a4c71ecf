"""The verdict on an order from errors of one step: their slope at small steps with errors above
rounding.

At coarse steps correct schemes may have any slope. So a slope may refute a scheme only if the
errors are far above rounding and the slope no longer rises with smaller steps. Errors confirm a
scheme if the finest ones fall as the order demands, or if all errors are rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from sepv.properties._orders.local_errors import STEP_LEVELS, LocalErrors, local_errors, problems_for

from sepv.errors import Skipped
from sepv.files import finite
from sepv.law import Finding, Law, Run, Verdict, first_order
from sepv.problem import Array, Problem, uniform_damping
from sepv.record import EPS
from sepv.schemes import Scheme, order_of

# Half the distance between local rms orders, which are multiples of ½. Slopes at the fine end are
# within 0.1 of their limits. They converge most slowly if truncation contributes h^(k+1)|ln
# h|^(-3/2).
LOCAL_MARGIN = 0.25
# Up to this power of h mean errors have the margin LOCAL_MARGIN too, because slopes are accurate to
# 0.05 and errors that are not smooth, such as |ΔW|³, become visible. Above it the margin is ½,
# half-way between whole orders: mean errors of smooth schemes have whole orders, because odd powers
# of ΔW have mean zero.
SHARP_ORDER = 3.0
# Errors of a step below STEP_ROUNDING_FACTOR·eps·|y| may be rounding: some roundings of a state and
# a solver's last correction.
STEP_ROUNDING_FACTOR = 64.0
# SOLVER_FLOOR is by convention the error, in eps·|y|, of a solver that states no tolerance, also
# for sampled laws. Only errors SOLVER_CLEAR times as large may refute a scheme, because the
# solver's error changes their slopes by less than 0.1.
SOLVER_FLOOR, SOLVER_CLEAR = 1e4, 10.0
# The number of points of a slope, and the number needed to decide if a slope still rises.
SLOPE_POINTS, RISING_POINTS = 3, 4


@dataclass(frozen=True)
class Slope:
    """A slope of errors against h: its value, what it means for the law,
    and a text with its range of h.
    """

    verdict: Verdict
    value: float
    text: str


def judge_slope(  # noqa: PLR0911  (one return for each meaning of a slope)
    h: Array, errors: Array, least: float, rounding: float | Array, floor: float | Array
) -> Slope:
    """Judge whether errors (L,) at falling h have the slope `least` or more.

    Errors below `rounding` may be rounding. Errors above `floor` are not rounding. Both may have
    the shape (L,).
    """
    if not np.all(np.isfinite(errors)):
        return Slope(Verdict.VIOLATED, float("nan"), "errors too large for a number")
    large = np.flatnonzero(errors > floor)
    if errors.size and not large.size:
        return Slope(Verdict.HOLDS, float("inf"), f"errors below {np.max(floor):.1e} are rounding")
    # `far` counts errors up to the last large one, `real` those up to the first that may be
    # rounding.
    far = int(large[-1]) + 1 if large.size else 0
    real = max(far, int(np.argmin([*(errors > rounding), False])))
    # If fewer than three are real, the first error below `rounding` counts as `rounding`: the slope
    # is a lower bound.
    used = real if real >= SLOPE_POINTS else min(real + 1, errors.size)
    x, y = np.log(h), np.log(np.maximum(errors, rounding))
    if used < SLOPE_POINTS:
        # Errors that fall faster than claimed: the slope to `rounding` at the next step size is a
        # lower bound.
        bound = _over(x[:used], y[:used]) if used > 1 else None
        if bound is not None and bound.value >= least:
            return replace(bound, verdict=Verdict.HOLDS)
        return Slope(Verdict.INCONCLUSIVE, float("nan"), f"{used} step sizes are not enough for a slope")
    fine = _over(x[:used], y[:used])
    if fine.value >= least:
        return replace(fine, verdict=Verdict.HOLDS)
    if far < RISING_POINTS:
        return fine
    coarser, seen = _over(x[: far - 1], y[: far - 1]), _over(x[:far], y[:far])
    if seen.value >= least:
        return replace(seen, verdict=Verdict.HOLDS)
    if seen.value > coarser.value + LOCAL_MARGIN:  # not yet asymptotic
        return replace(seen, text=seen.text + ", rising")
    return replace(seen, verdict=Verdict.VIOLATED)


def _over(x: Array, y: Array) -> Slope:
    """Return the least-squares slope of the last SLOPE_POINTS points (x, y) of logarithms."""
    x, y = x[-SLOPE_POINTS:], y[-SLOPE_POINTS:]
    centred = x - np.mean(x)
    value = float(centred @ y / (centred @ centred))
    text = f"slope {value:.2f} for h = {np.exp(x[0]):.1e} … {np.exp(x[-1]):.1e}"
    return Slope(Verdict.INCONCLUSIVE, value, text)


def unclaimed(column: str) -> float:
    """Return the order required without a claim: the highest that increments alone allow for the
    kind of noise.
    """
    return 0.5 if column == "general" else 1.0


def strong_order(scheme: Scheme, column: str) -> float:
    """Return the mean-square order required for the kind of noise `column`: the claimed one,
    or else `unclaimed`.
    """
    return order_of(scheme.mean_square_order, column, unclaimed(column))


def mean_slope(local: LocalErrors, order: float) -> float:
    """Return the slope that mean or weak errors need: `order` + 1 or, if lower, the quadrature's,
    minus a margin.
    """
    power = min(order + 1, local.exact_order)
    return power - (LOCAL_MARGIN if power <= SHARP_ORDER else 2 * LOCAL_MARGIN)


def order_shown(slope: Slope, order: float, spacing: float, needs: Callable[[float], float]) -> float | None:
    """Return the largest order that a slope shows, or None if it shows none.

    Possible orders are `order`, with which the slope was compared, plus multiples of `spacing`. A
    slope that may still rise shows no order. Else it shows an order p if it is at least needs(p).
    Errors below rounding show only `order`.
    """
    if slope.verdict is Verdict.HOLDS:
        while np.isfinite(slope.value) and slope.value >= needs(order + spacing) > needs(order):
            order += spacing
        return order
    while slope.verdict is Verdict.VIOLATED and order > spacing:
        order -= spacing
        if slope.value >= needs(order):
            return order
    return None


def judge(
    law: Law, scheme: Scheme, run: Run,
    errors: Callable[[LocalErrors], Array],
    claimed: Callable[[LocalErrors], float],
    needs: Callable[[LocalErrors, float], float],
    spacing: float,
    measure: Callable[[Scheme, Problem, Run], LocalErrors] = local_errors,
    enough: int = STEP_LEVELS // 2,
    example: Callable[[Scheme, Problem, float], str] = lambda *_: "",
    problems: Iterable[Problem] | None = None,
) -> Finding:  # fmt: skip
    """Return the law's finding from the worst slope over the problems,
    each with at least `enough` step sizes.

    `errors` selects the law's errors, and `claimed` the order with which they are compared. `needs`
    gives the slope that an order needs, half-way to the slope of the next lower order. Orders are
    `spacing` apart. `measure` computes the errors, and for a violation `example` describes one step
    of a given size. `problems` are by default those of the scheme.
    """
    if scheme.eps > EPS:
        text = "one step shows its order where its error is below the roundings of single precision"
        return law.finding(Verdict.NOT_APPLICABLE, message=text)
    slopes, lines, measured, checks = [], [], [], 0
    shown: list[str] = []
    skipped: list[Skipped] = []
    unknown = ""
    for problem in problems_for(scheme) if problems is None else problems:
        if uniform_damping(problem):
            unknown = f"the solution of one step of {problem.name} is not known here: it depends on the path"
            lines.append(f"{problem.name}: skipped, {unknown}")
            continue
        try:
            local = measure(scheme, problem, run)
        except Skipped as skip:  # schemes may refuse some problems
            skipped.append(skip)
            lines.append(f"{problem.name}: skipped, {skip.reason}")
            continue
        checks += local.steps
        if local.h.size < enough:
            return _failed(law, local)
        order, needed = claimed(local), partial(needs, local)
        sizes, bound = errors(local), needed(order)
        if np.all(np.isnan(sizes)):
            known = bool(np.any(local.rms > 0))
            lacks = "no moments of the solution are known" if known else "only moments are known"
            unknown = f"of {problem.name} {lacks}"
            lines.append(f"{problem.name}: skipped, {unknown}")
            continue
        seen = _slope_of(scheme, local, sizes, bound)
        slopes.append((seen, bound))
        measured.append(_measured(local, sizes, seen, bound, order_shown(seen, order, spacing, needed)))
        lines.append(f"{problem.name}: {seen.text}, {bound:g} needed")
        if seen.verdict is Verdict.VIOLATED and not shown:
            shown += [example(scheme, problem, float(local.h[0])), *first_order(scheme, problem)]
    if not slopes and unknown and not skipped:  # the law itself cannot decide
        return law.finding(Verdict.NOT_APPLICABLE, message=unknown)
    if not slopes:
        raise skipped[0]
    verdict, worst, bound = _worst(slopes)
    if verdict is not Verdict.HOLDS:
        lines += [_errors_text(m) for m in measured]
    lines += filter(None, shown)
    return law.finding(
        verdict, defect=worst.value if np.isfinite(worst.value) else None, bound=bound, at_least=True, checks=checks,
        message="\n".join(lines), witness={"measured": measured}, replay=f"--law {law.name}",
    )  # fmt: skip


def _slope_of(scheme: Scheme, local: LocalErrors, errors: Array, bound: float) -> Slope:
    """Judge the slope of errors that are above rounding and above the errors of the scheme's solver
    and the flow.
    """
    tolerance, more = scheme.solver_tolerance, local.rounding
    return judge_slope(
        local.h, errors, bound, (STEP_ROUNDING_FACTOR * EPS + 2 * tolerance) * local.scale + 2 * local.flow + more,
        SOLVER_CLEAR * ((SOLVER_FLOOR * EPS + tolerance) * local.scale + more),
    )  # fmt: skip


def _worst(slopes: list[tuple[Slope, float]]) -> tuple[Verdict, Slope, float]:
    """Return the verdict on all problems, and the slope with this verdict farthest below its bound,
    with the bound.
    """
    verdicts = [seen.verdict for seen, _ in slopes]
    verdict = next((v for v in (Verdict.VIOLATED, Verdict.INCONCLUSIVE) if v in verdicts), Verdict.HOLDS)
    deciding = [s for s in slopes if s[0].verdict is verdict]
    return verdict, *min(deciding, key=lambda s: np.nan_to_num(s[0].value - s[1], nan=-np.inf))


def _measured(
    local: LocalErrors, errors: Array, seen: Slope, bound: float, order: float | None
) -> dict[str, Any]:
    return {
        "problem": local.problem, "h": local.h.tolist(), "error": errors.tolist(), "slope": finite(seen.value),
        "needed": bound, "verdict": seen.verdict.value, "order": order,
    }  # fmt: skip


def _errors_text(m: dict[str, Any]) -> str:
    errors = ", ".join(f"{e:.3g}" for e in m["error"])
    return f"{m['problem']}: errors {errors} for h = {', '.join(f'{h:.2g}' for h in m['h'])}"


def _failed(law: Law, local: LocalErrors) -> Finding:
    sizes = ", ".join(f"{h:.2g}" for h, _ in local.failed)
    reason = f"steps were not solved, not finite or out of the domain for h = {sizes}" if sizes else "no flow"
    return law.finding(
        Verdict.ERROR,
        checks=local.steps,
        message=f"{local.problem}: {reason}; only h smaller than all of these can be judged, and too few are left"
        + "".join(f"\n{local.problem}, {step}" for _, step in local.failed[-1:]),
    )
