"""A step from y0 to y1 and a step back: the measurement of the laws "symmetry" and "reversibility",
and its bound.

Let Φ be the step and Ψ the step back in exact arithmetic, Ψ∘Φ = id. A rounding at the end of the
first step or at the start of the way back reaches y0′ as Ψ′ times itself. One at the start of the
first step or at the end of the way back arrives unchanged, and one between them as it is between
both. So |y0′ − y0| ≤ (I + |Ψ′|) r, where r is the sum of the residuals that the roundings of two
steps may cause (`sepv.law.tolerance`). Ψ′ comes from the scheme's own step back, from
states next to y1: a scheme may have another equation than (2.1), which moves far where (2.1) hardly
moves, and its rounding errors grow as that equation makes them grow. For (2.1), y1 = y0 + R(y0,
y1), a residual r moves y0′ by (I + ∂R/∂y0)⁻¹ r. Because Ψ′ = (I + ∂R/∂y0)⁻¹(I − ∂R/∂y1), and both
derivatives of R are equal up to O(Δ²), this is ½(I + Ψ′) r, half of the bound.

**Memory.** A scheme with a state makes N steps there and N steps back (`sepv.law.middle`, MAP). Its
`StatefulStep.reverse` gives the state that leads back. Without it, a path that begins anew at y_N
leads back only if y alone determines the path, as with a stored force. Then each path of N ≥ 2
steps equals one in which every step begins anew, up to the sum of the residuals of both. One case
in which it does not refutes this, and the laws say nothing of the scheme: where both paths are
equal, as at rest or where roundings hide the difference, a return proves nothing, and no return is
no fault. So all listed cases are asked first (`no_memory`), and again each case that would violate
the law.

A scheme that gives a state back at y_N has no steps from states next to y_N, so errors r before
them count as e^(2κ) times the largest r, the growth inside a contraction radius. This is not
derived for equations other than (2.1).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np

from sepv.errors import SchemeFault, Skipped, StepFailure, Unasked
from sepv.law import Measurement, amplification
from sepv.law.cases.case import Case
from sepv.law.tolerance import PATH_GROWTH, state_ulp, step_residual
from sepv.problem import Array, Problem
from sepv.schemes import (
    Scheme,
    SchemeCrash,
    StatefulStep,
    as_path,
    ask,
    ask_next,
    check_answer,
    several,
    translated,
)

# The y of a reversed state may differ from y_N by REVERSED_STATE_TOLERANCE times |y_N|_∞, because a
# state may use other coordinates.
REVERSED_STATE_TOLERANCE = 2.0**-20


def measured(scheme: Scheme, case: Case, rho: Array | None = None) -> Measurement:
    """Measure |y0′ − y0| after the steps of the case from y0 to y_N and steps back.

    The steps back are those with −h and −ΔW. With rho (d,), the signs of a reversal of momenta,
    they are those with h and ΔW from ρy_N, and y0′ is ρ times their end. The derivative of the way
    back costs d further ways back. They are made only if |y0′ − y0| exceeds r.

    Raises
    ------
    Skipped
        If the scheme refuses h < 0, that is, fails with the steps back and with a step −2⁻¹⁷h
        without noise.
    Unasked
        If nothing says how the path of a scheme with memory goes back.
    """
    problem, y, h, dW = case.build()
    scheme, own, count, words = _there(scheme)
    sign, turn = (-1.0, np.ones_like(y)) if rho is None else (1.0, rho)
    rule = own.step
    y1, state = _steps(own, problem, y, None, h, dW, count)

    def back(start: Array, turned: Any = None) -> Array:
        return np.asarray(turn * _steps(own, problem, turn * start, turned, sign * h, sign * dW, count)[0])

    alone: Callable[[Array], Array] | None = back
    start, way = y1, back
    if isinstance(rule, StatefulStep) and rule.reverse is not None:
        value, turned = _reversed(rule, problem, turn * y1, state, rho, h, dW)
        start, way, alone = turn * value, partial(back, turned=turned), None
    try:
        returned = way(start)
    except (StepFailure, SchemeFault, SchemeCrash) as failure:
        if sign * h < 0 < h and not _solves(own, problem, y1, -(2.0**-17) * h, 0 * dW):
            raise Skipped(f"the scheme makes no step with h < 0 ({_first_line(failure)})") from failure
        raise
    residual = step_residual(problem, y, y1, h, dW, scheme)
    residual = residual + step_residual(problem, y1, returned, -h, -dW, scheme)
    error, bound = np.abs(returned - y), residual
    if alone is None:
        bound = bound + PATH_GROWTH * float(residual.max())
    elif not np.all(error <= bound):
        bound = bound + sum(moved(alone, y1, returned, k, residual[k]) for k in range(y.size))
        if np.any(error > bound):
            no_memory(scheme, case)
    k = int(np.argmax(error / bound))
    unit = state_ulp(y, y1)
    detail = f"{words}y{count} = {y1.tolist()}, back at {returned.tolist()}"
    return Measurement(float(error[k]) / unit, float(bound[k]) / unit, detail)


def moved(back: Callable[[Array], Array], y1: Array, returned: Array, k: int, width: float) -> Array | float:
    """The change |back(y1 ± w e_k) − back(y1)| (d,), w = `width`,
    with the first sign for which the step succeeds.

    NaN if it succeeds for no sign: then nothing tells how roundings grow, and the case has no
    bound.
    """
    for sign in (1.0, -1.0):
        near = y1.copy()
        near[k] += sign * width
        with suppress(StepFailure, SchemeFault, SchemeCrash):
            return np.abs(back(near) - returned)
    return math.nan


def _steps(
    scheme: Scheme, problem: Problem, y: Array, state: Any, h: float, dW: Array, count: int
) -> tuple[Array, Any]:
    """Return the end y (d,) of `count` steps of a path, each with h/count and ΔW/count,
    and the state there.
    """
    for _ in range(count):
        y, state = ask_next(scheme, problem, y, state, h / count, dW / count)
    return y, state


def _reversed(
    rule: StatefulStep, problem: Problem, wanted: Array, state: Any, rho: Array | None, h: float, dW: Array
) -> tuple[Array, Any]:
    """Return the reversed state and its y, which must be `wanted`;
    raise SchemeFault if it is at another place.

    Raises Unasked if only signs differ: then the function serves the other of the two laws.
    """
    with translated(problem, wanted, h, dW):
        turned = rule.turned(state, rho)
        value = check_answer(np.array(rule.value(turned)), wanted)
    near = REVERSED_STATE_TOLERANCE * np.max(np.abs(wanted))
    if np.any(np.abs(np.abs(value) - np.abs(wanted)) > near):
        raise SchemeFault(
            expected=f"value(reverse(state)) at the y of the state, {wanted.tolist()}",
            received=str(value.tolist()),
            remedy="let reverse(state) keep y, or change the signs of momenta alone",
        )
    if np.any(np.abs(value - wanted) > near):
        law, does = ("symmetry", "changes signs of y") if rho is None else ("reversibility", "keeps y")
        raise Unasked(f"reverse(state) {does}: {law} needs reverse(state, rho) with rho or None")
    return value, turned


def no_memory(scheme: Scheme, case: Case) -> None:
    """Raise Unasked if no `reverse` is given, and the path of the case differs from one whose steps
    all begin anew.
    """
    scheme, own, count, _ = _there(scheme)
    if not isinstance(own.step, StatefulStep) or own.step.reverse is not None:
        return
    problem, y, h, dW = case.build()
    y1, anew = ask(scheme, problem, y, h, dW), y
    for _ in range(count):
        anew = ask(own, problem, anew, h / count, dW / count)
    allowed = 2 * amplification(scheme, case) * float(step_residual(problem, y, y1, h, dW, scheme).max())
    if not np.max(np.abs(anew - y1)) <= allowed:
        raise Unasked("a path depends on more than y: StatefulStep(…, reverse=…) says how it goes back")


def _there(scheme: Scheme) -> tuple[Scheme, Scheme, int, str]:
    """The steps there as one, one of them, their number, and words if it is not that of the case.

    A path of one step tells nothing of a memory, so that it becomes one of two.
    """
    own, count = as_path(scheme)
    words = ""
    if isinstance(own.step, StatefulStep) and own.step.reverse is None and count < 2:
        count, words = 2, "in 2 steps each way: "
    return several(own, count) if count > 1 else own, own, count, words


def _solves(scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array) -> bool:
    try:
        ask(scheme, problem, y, h, dW)
    except (StepFailure, SchemeFault, SchemeCrash):
        return False
    return True


def _first_line(error: Exception) -> str:
    """Return the name and text of an error's cause, for a message in which equal reasons are
    counted together.
    """
    cause = error.__cause__
    return f"{type(cause).__name__}: {cause}" if cause is not None else type(error).__name__
