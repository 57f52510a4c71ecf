"""The verdict on an order from errors of one step: the slope where steps are small and errors are not yet rounding.

A slope may say that a scheme is wrong only where it stands on errors far above any rounding and no longer rises: at
coarse steps right schemes have slopes of every kind. It may say that a scheme is right where the finest errors fall as
they should, or where nothing is left of them but rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from sepv.errors import Skipped
from sepv.files import finite
from sepv.problem import Array, Problem
from sepv.record._binary64 import EPS
from sepv.schemes import Scheme
from sepv.schemes._order_claims import order_of
from sepv.verification._law import Finding, Law, Run, Verdict
from sepv.verification._orders.local_errors import LEVELS, LocalErrors, local_errors, problems_for

# Local rms errors have orders that are multiples of ½: half-way to the next lower one. Slopes at the fine end are
# within 0.1 of their limits; the slowest to come there are those where clipping contributes h^(k+1)|ln h|^(-3/2).
MARGIN = 0.25
# Mean errors of smooth schemes have whole orders, as odd powers of ΔW have mean zero, and half-way is ½. Up to this
# power of h, where steps are small enough for slopes true to 0.05, the smaller margin sees also what is not smooth,
# such as |ΔW|³.
SHARP = 3.0
# Errors of a step below this many eps·|y| may be rounding: a few roundings of a state and a solver's last correction.
ROUNDING = 64.0
# What a solver that says nothing of its tolerance may leave, in eps·|y|: a convention, and that of the sampled laws.
# Only errors CLEAR times as large accuse: what is left changes their slopes by less than 0.1.
FLOOR, CLEAR = 1e4, 10.0
# Slopes over this many points, and as many points as it takes to see whether a slope still rises.
POINTS, ENOUGH = 3, 4


@dataclass(frozen=True)
class Slope:
    """The order seen, what it was seen on, and what it means."""

    verdict: Verdict
    value: float
    text: str


def judge_slope(  # noqa: PLR0911  (one return for each thing that a slope may mean)
    h: Array, errors: Array, least: float, rounding: float, floor: float
) -> Slope:
    """Whether errors (L,) at falling h fall with the slope `least` or more.

    Those below `rounding` may be rounding, those above `floor` are not.
    """
    if not np.all(np.isfinite(errors)):
        return Slope(Verdict.VIOLATED, float("nan"), "errors too large for a number")
    large = np.flatnonzero(errors > floor)
    if errors.size and not large.size:
        return Slope(Verdict.HOLDS, float("inf"), f"errors below {floor:.1e} are rounding")
    # Up to the last large error, whatever is before it; and beyond it up to the first that may be rounding.
    far = int(large[-1]) + 1 if large.size else 0
    real = max(far, int(np.argmin([*(errors > rounding), False])))
    # Fewer than three above rounding: with the first below it, counted as rounding, the slope is a lower bound.
    used = real if real >= POINTS else min(real + 1, errors.size)
    x, y = np.log(h), np.log(np.maximum(errors, rounding))
    if used < POINTS:
        # From the coarsest error to rounding at the next size: a lower bound, where errors fall faster than claimed.
        bound = _over(x[:used], y[:used]) if used > 1 else None
        if bound is not None and bound.value >= least:
            return replace(bound, verdict=Verdict.HOLDS)
        return Slope(Verdict.INCONCLUSIVE, float("nan"), f"{used} step sizes are not enough for a slope")
    fine = _over(x[:used], y[:used])
    if fine.value >= least:
        return replace(fine, verdict=Verdict.HOLDS)
    if far < ENOUGH:
        return fine
    coarser, seen = _over(x[: far - 1], y[: far - 1]), _over(x[:far], y[:far])
    if seen.value >= least:
        return replace(seen, verdict=Verdict.HOLDS)
    if seen.value > coarser.value + MARGIN:  # not yet asymptotic
        return replace(seen, text=seen.text + ", rising")
    return replace(seen, verdict=Verdict.VIOLATED)


def _over(x: Array, y: Array) -> Slope:
    """The slope by least squares over the last points."""
    x, y = x[-POINTS:], y[-POINTS:]
    centred = x - np.mean(x)
    value = float(centred @ y / (centred @ centred))
    text = f"slope {value:.2f} for h = {np.exp(x[0]):.1e} … {np.exp(x[-1]):.1e}"
    return Slope(Verdict.INCONCLUSIVE, value, text)


def unclaimed(column: str) -> float:
    """The mean-square order against which a scheme is measured that claims none: what increments alone allow."""
    return 0.5 if column == "general" else 1.0


def strong_order(scheme: Scheme, column: str) -> float:
    """The mean-square order that a scheme is measured against for noise of this kind: its claim, or `unclaimed`."""
    return order_of(scheme.mean_square_order, column, unclaimed(column))


def mean_slope(found: LocalErrors, order: float) -> float:
    """The least slope of a mean or weak error for an order: half-way below p + 1, or what the quadrature can show."""
    power = min(order + 1, found.exact_order)
    return power - (MARGIN if power <= SHARP else 2 * MARGIN)


def order_shown(slope: Slope, order: float, spacing: float, needs: Callable[[float], float]) -> float | None:
    """The largest order that a slope shows; None where it shows none.

    Orders are whole numbers of `spacing` from `order`, which was measured against. A slope that may still rise shows
    nothing. Higher orders need their own slope, which the quadrature can see: errors below rounding show `order` alone.
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
    enough: int = LEVELS // 2,
    example: Callable[[Scheme, Problem, float], str] = lambda *_: "",
) -> Finding:  # fmt: skip
    """The law's finding: the worst slope over the problems, of which `enough` step sizes must be left.

    `errors` says which of them the law is about, `claimed` the order that they are measured against, and `needs` the
    slope that an order needs, half-way to the next lower one, which is `spacing` less; `measure` makes them, and
    `example` shows one step of this size to a reader of a violation.
    """
    slopes, lines, measured, checks = [], [], [], 0
    shown: list[str] = []
    skipped: list[Skipped] = []
    unknown = ""
    for problem in problems_for(scheme):
        try:
            found = measure(scheme, problem, run)
        except Skipped as skip:  # a scheme need not take every problem
            skipped.append(skip)
            lines.append(f"{problem.name}: skipped, {skip.reason}")
            continue
        checks += found.steps
        if found.h.size < enough:
            return _failed(law, found)
        order, needed = claimed(found), partial(needs, found)
        sizes, bound = errors(found), needed(order)
        if np.all(np.isnan(sizes)):
            known = bool(np.any(found.rms > 0))
            lacks = "no moments of the solution are known" if known else "only moments are known"
            unknown = f"of {problem.name} {lacks}"
            lines.append(f"{problem.name}: skipped, {unknown}")
            continue
        seen = _slope_of(scheme, found, sizes, bound)
        slopes.append((seen, bound))
        measured.append(_measured(found, sizes, seen, bound, order_shown(seen, order, spacing, needed)))
        lines.append(f"{problem.name}: {seen.text}, {bound:g} needed")
        if seen.verdict is Verdict.VIOLATED and not shown:
            shown.append(example(scheme, problem, float(found.h[0])))
    if not slopes and unknown and not skipped:  # it is the law that can say nothing
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


def _slope_of(scheme: Scheme, found: LocalErrors, errors: Array, bound: float) -> Slope:
    """The slope judged, where errors above rounding and above what the scheme's solver and the flow leave decide."""
    tolerance = scheme.solver_tolerance
    return judge_slope(
        found.h, errors, bound, (ROUNDING * EPS + 2 * tolerance) * found.scale + 2 * found.flow,
        CLEAR * (FLOOR * EPS + tolerance) * found.scale,
    )  # fmt: skip


def _worst(slopes: list[tuple[Slope, float]]) -> tuple[Verdict, Slope, float]:
    """The verdict on all problems, with the slope that lies farthest below its bound among those that decide it."""
    verdicts = [seen.verdict for seen, _ in slopes]
    verdict = next((v for v in (Verdict.VIOLATED, Verdict.INCONCLUSIVE) if v in verdicts), Verdict.HOLDS)
    deciding = [s for s in slopes if s[0].verdict is verdict]
    return verdict, *min(deciding, key=lambda s: np.nan_to_num(s[0].value - s[1], nan=-np.inf))


def _measured(
    found: LocalErrors, errors: Array, seen: Slope, bound: float, order: float | None
) -> dict[str, Any]:
    return {
        "problem": found.problem, "h": found.h.tolist(), "error": errors.tolist(), "slope": finite(seen.value),
        "needed": bound, "verdict": seen.verdict.value, "order": order,
    }  # fmt: skip


def _errors_text(m: dict[str, Any]) -> str:
    errors = ", ".join(f"{e:.3g}" for e in m["error"])
    return f"{m['problem']}: errors {errors} for h = {', '.join(f'{h:.2g}' for h in m['h'])}"


def _failed(law: Law, found: LocalErrors) -> Finding:
    sizes = ", ".join(f"{h:.2g}" for h, _ in found.failed)
    reason = f"steps were not solved, not finite or out of the domain for h = {sizes}" if sizes else "no flow"
    return law.finding(
        Verdict.ERROR,
        checks=found.steps,
        message=f"{found.problem}: {reason}; only h smaller than all of these can be judged, and too few are left"
        + "".join(f"\n{found.problem}, {step}" for _, step in found.failed[-1:]),
    )
