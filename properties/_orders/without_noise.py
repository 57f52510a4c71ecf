"""The order of a method without noise, y′ = B∇H: the power of h of the error of one step,
extrapolated to h = 0.

From a given state a method of order p has the error e(h) = |y1 − φ_h(y0)| = c h^(p+1)(1 + a h + b
h² + …). With r = √2 its slope s(h) = log_r e(rh)/e(h) is p + 1 + αh + βh² + …, and Richardson's
extrapolation

    t(h) = (r s(h) − s(rh))/(r − 1) = p + 1 − r β h² + O(h³)

removes αh. From h to rh the error of t doubles, so it is about t(rh) − t(h), and a third of t(r²h)
− t(h). The interval is t(h) plus or minus the larger of 2|t(rh) − t(h)| and |t(r²h) − t(h)|, two or
three times the error, to cover higher terms. If rounding, a solver's stated tolerance and the flow
change errors by at most R, they change s by at most (R/e(rh) + R/e(h))/ln r. The interval is
enlarged by this change of both slopes in the formula of t. Powers of h are whole numbers, so an
interval refutes an order only if it is narrow and contains a whole number.

The same formulas are used with r = 2 and r = 4. These need step sizes farther apart, but rounding
changes their slopes less. The narrowest of the three intervals counts. If a coefficient is wrong in
a late digit, the error has a term of a lower power of h that dominates only at small h. So errors
at finer steps than those that confirm an order are compared with a sum of two powers (`_slower`).
The finest step sizes with a narrow interval decide. The unit of h is that in which the slope of the
field is 2 (`sepv.law.units`). A slope below ½ is no order, because y1 = y0 for h = 0. It comes from
a tolerance that was not stated, and finer steps are left out. Errors κh with a constant κ, however
small, are told from such tolerances by their regularity (`sepv.properties._orders.consistency`).

A damped system without noise, y′ = B∇H − γy, has a flow too, and the same is measured on it.

**Memory.** The order of a scheme that carries a state is that of its error at a fixed time T,
because its first step may have a lower order than a path (`path_errors`). The error of a path of
N = T/h steps, divided by N, is the mean error of its steps. It is c h^(p+1)(1 + a h + …) again
(Hairer, Nørsett and Wanner, *Solving Ordinary Differential Equations I*, II.8 and III.9), so the
same formulas judge it. Rounding errors R of a step grow by at most e^(LT) until T, with the slope
L of the field. So they change the mean error by at most R e^(LT).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from sepv.properties._failed_step import first_failed
from sepv.properties._orders.consistency import KappaLimit, limit
from sepv.properties._orders.convergence import failed_path
from sepv.properties._orders.local_errors import cases
from sepv.properties._orders.local_orders import SOLVER_CLEAR, SOLVER_FLOOR, STEP_ROUNDING_FACTOR
from sepv.properties._problems_of import NO_START

from sepv.core.newton import Status
from sepv.errors import Skipped
from sepv.exact import FlowFailure, exact_flow
from sepv.law import Verdict
from sepv.law.cases.case import quiet, quiet_problem
from sepv.law.cases.users_problems import items, sources
from sepv.law.units import units_of
from sepv.problem import Array, Problem, damping_of, one_field, sample_states
from sepv.record import EPS
from sepv.schemes import Scheme, guarded
from sepv.simulate import advance, run_chunk

# Step sizes in the problem's unit of time, √2 apart: from 4, where high orders are far above
# rounding, to 2⁻¹³.
QUIET_RATIO = 2.0**0.5
QUIET_SIZES = 4.0 * QUIET_RATIO ** -np.arange(31.0)
# Step sizes, in the same unit, that are for consistency alone.
CONSISTENCY_STEPS = 2.0 ** -np.array([14.0, 15.0, 16.0])
# The largest step size from which consistency is extrapolated.
NEAR_ZERO = 2.0**-4
# The number of step sizes in a window, which give four slopes and three extrapolations.
WINDOW_SIZES = 5
# Numbers of steps of a path from 0 to T = τ, the problem's unit of time, for a scheme with memory.
# There LT = 2.
QUIET_PATH_STEPS, QUIET_PATH_GROWTH = 2 ** np.arange(10), float(np.exp(2.0))
# Distances of the step sizes of a window in QUIET_SIZES, for the ratios √2, 2 and 4.
WINDOW_STRIDES = (1, 2, 4)
QUIET_STATES = 3
# The largest half-widths of an interval that may confirm an order (half of the distance of orders)
# or refute one.
CONFIRMING_HALF_WIDTH, REFUTING_HALF_WIDTH = 0.5, 0.25
# A solver's unstated tolerance is relative to y, to y1 − y0 or to a force, so it causes errors
# proportional to 1 or h. Errors that fall faster than h^TOLERANCE_MAX_POWER do not come from a
# tolerance, however small they are.
TOLERANCE_MAX_POWER = 1.5
# An interval that refutes must contain a whole number or be at most WHOLE_POWER_DISTANCE away from
# one. Else it shows no power of h.
WHOLE_POWER_DISTANCE = 0.05
# Squares of errors must fit a sum of two powers of h up to the relative deviation FIT_DEVIATION, at
# FIT_MIN_SIZES or more step sizes. Not derived: simulated errors of solvers with an unstated
# tolerance hardly ever fit as well at as many step sizes.
FIT_DEVIATION, FIT_MIN_SIZES = 0.03, 9
# Larger errors, in units of length, are far from any power of h, and are not used.
LARGEST_USED_ERROR = 2.0**-4
# The number of random members of a family of systems that are tested beside the problems with
# names.
FAMILY_MEMBERS = 2
# Step sizes h, in the problem's unit of time, that are changed to h(1 ± STEP_NUDGE). In 32 bits
# these are at most a quarter of a unit of the last place apart, in 64 bits millions of such units.
PROBED_SIZES = 1 / np.array([3.0, 5.0, 7.0, 11.0, 13.0])
STEP_NUDGE = 2.0**-28
# A step that moves y by MOVING_SHARE |y| or more must show the change of h by STEP_NUDGE, which
# changes y1 by 2⁻³⁷ |y| or more.
MOVING_SHARE = 2.0**-10


@dataclass(frozen=True)
class Order:
    """The power p + 1 of h in the errors from one state (in `value` ± `half`),
    with a verdict and a description.

    If errors are rounding or show no power, `value` is NaN. If `value` is a lower bound, `half` is
    NaN.
    """

    verdict: Verdict
    value: float = float("nan")
    half: float = float("nan")
    text: str = ""

    @property
    def order(self) -> int | None:
        """The order p, a whole number; None if no power of h was found."""
        return round(self.value) - 1 if np.isfinite(self.half) else None


def judge(h: Array, e: Array, least: float, rounding: float, floor: float) -> Order:
    """Judge if errors e (L,) from one state fall at least like the power `least` of h.

    Sizes h fall by factors QUIET_RATIO.

    Errors below `rounding` are not used. Errors below `floor` refute a power only if they fall
    faster than h^TOLERANCE_MAX_POWER.
    """
    if e.size and not np.any(e > floor):
        return Order(Verdict.HOLDS, text=f"below {floor:.1e}, which is rounding")
    used = int(np.argmin([*(e > rounding), False]))
    first = int(np.argmax(e < LARGEST_USED_ERROR))
    for last in range(used - 1, first + WINDOW_SIZES - 2, -1):  # begin with the finest window
        windows = [slice(last - (WINDOW_SIZES - 1) * n, last + 1, n) for n in WINDOW_STRIDES]
        tried = [_extrapolated(h[w], e[w], rounding) for w in windows if w.start >= first]
        found = min(tried, key=lambda order: order.half)
        if not found.half <= CONFIRMING_HALF_WIDTH or found.value < CONFIRMING_HALF_WIDTH:
            continue
        if found.value - found.half >= least:
            return _slower(h, e, found, last, used, least, rounding) or replace(found, verdict=Verdict.HOLDS)
        whole = abs(found.value - round(found.value)) <= found.half + WHOLE_POWER_DISTANCE
        certain = (
            whole
            and found.half <= REFUTING_HALF_WIDTH
            and (e[last] > floor or found.value > TOLERANCE_MAX_POWER)
        )
        if certain and found.value + found.half < least:
            return replace(found, verdict=Verdict.VIOLATED)
    return _falls(h, e, used, least, rounding) or Order(
        Verdict.INCONCLUSIVE, text=f"no clear power of h at {used} step sizes above rounding"
    )


def _extrapolated(h: Array, e: Array, rounding: float) -> Order:
    """Estimate the power of h in errors e (WINDOW_SIZES,) at falling h, extrapolated to h = 0,
    with its interval.
    """
    r = h[0] / h[1]
    s = np.log(e[:-1] / e[1:]) / np.log(r)
    off = rounding * (1 / e[:-1] + 1 / e[1:]) / np.log(r)
    t = (r * s[1:] - s[:-1]) / (r - 1)
    # From h to rh the errors of t at least double.
    half = max(2 * abs(t[-1] - t[-2]), abs(t[-1] - t[-3])) + (r * off[-1] + off[-2]) / (r - 1)
    text = f"h^{t[-1]:.2f} ± {half:.2f} for h = {h[0]:.1e} … {h[-1]:.1e}"
    return Order(Verdict.INCONCLUSIVE, float(t[-1]), float(half), text)


def _slower(
    h: Array, e: Array, found: Order, last: int, used: int, least: float, rounding: float
) -> Order | None:
    """Return a violation if errors change from a confirmed power of h to a lower power q at finer
    steps, else None.

    The error is then |A h^q + C h^(p+1)| with vectors A and C, so that e²/h^(2q) is a polynomial of
    degree two in h^(p+1−q), where C may vary with h. This must fit all errors far above rounding at
    the step sizes that confirmed the power (to `last`) and at finer ones, and A must cause most of
    the two finest errors. Errors by a solver's tolerance do not fit: they scatter, or fall more
    slowly than h².
    """
    power, fine = round(found.value), slice(max(last - WINDOW_SIZES + 1, 0), used)
    certain = e[fine] > rounding / (5 * FIT_DEVIATION)
    x, E = h[fine][certain] / h[used - 1], e[fine][certain]
    for q in range(2, min(power, int(np.ceil(least)))):
        squares, allowed = (E / x**q) ** 2, FIT_DEVIATION + 2 * rounding / E
        y = x ** (power - q)
        rows = np.stack([np.ones_like(x), y, y**2, y**2 * x], axis=1) / (squares * allowed)[:, None]
        sizes = np.linalg.norm(rows, axis=0)
        parts = np.linalg.lstsq(rows / sizes, 1 / allowed, rcond=None)[0]
        off = np.abs(rows / sizes @ parts - 1 / allowed)
        if len(x) >= FIT_MIN_SIZES and off.max() <= 1 and parts[0] / sizes[0] > squares[-2] / 2:
            text = f"h^{q} for h < {h[last]:.1e}, after {found.text}"
            return Order(Verdict.VIOLATED, float(q), 0.0, text)
    return None


def _falls(h: Array, e: Array, used: int, least: float, rounding: float) -> Order | None:
    """Return "holds" with a lower bound of the power of h:
    the slope from an error to the first error below `rounding`.

    Of the errors e[:used] above rounding, the one with the largest slope is taken. None if this
    slope is below `least`.
    """
    if not 0 < used < e.size:
        return None
    bounds = np.where(
        e[:used] < LARGEST_USED_ERROR, np.log(e[:used] / rounding) / np.log(h[:used] / h[used]), 0.0
    )
    k = int(np.argmax(bounds))
    if bounds[k] < least:
        return None
    text = f"h^{bounds[k]:.2f} at least, from {e[k]:.1e} at h = {h[k]:.1e} to rounding at {h[used]:.1e}"
    return Order(Verdict.HOLDS, float(bounds[k]), text=text)


@dataclass(frozen=True)
class StepErrors:
    """Errors (S, L) of one step of a problem from S states at L falling step sizes,
    in the problem's unit of length.

    Those of a scheme with memory are mean errors of the steps of a path, whose rounding errors
    `growth` multiplies.
    """

    problem: Problem
    h: Array
    errors: Array
    starts: Array
    scale: float
    flow: float
    steps: int
    failed: str = ""
    growth: float = 1.0
    near_zero: Array = field(
        default_factory=lambda: np.zeros(0)
    )  # step sizes (K,) near 0, in the unit of time
    differences: Array | tuple[Array, ...] = ()  # y1 − φ_h from each state at these step sizes, (S, K, d)


def path_errors(scheme: Scheme, problem: Problem) -> StepErrors:
    """Compute the errors at T of paths from QUIET_STATES states of a problem,
    divided by their numbers of steps QUIET_PATH_STEPS.

    A step size is used if no path with this step size or a smaller one failed.
    """
    units, asked = units_of(problem), guarded(scheme)
    starts = np.array(list(sample_states(problem, units.length))[:QUIET_STATES])
    try:
        flows = [exact_flow(problem, units.time, y, dense=True) for y in starts]
    except FlowFailure as failure:
        raise Skipped(f"the exact flow from a state near y0 is not known until T: {failure}") from failure
    rows, steps, failed = list[list[float]](), 0, ""
    for count in QUIET_PATH_STEPS.tolist():
        h, none, row = units.time / count, np.zeros((count, 0, 1)), list[float]()
        for y, flow in zip(starts, flows, strict=True):
            ends = run_chunk(asked, problem, y, h, none, None, track=False)
            failed = failed_path(scheme, problem, ends, h, none, range(1)) or failed
            row.append(float(np.linalg.norm(ends.y[:, 0] - flow.y)) / count)
            if ends.status[0] != Status.CONVERGED:
                row, rows = [], []
                break
        steps += count * len(starts)
        rows += [row] * bool(row)
    errors = np.array(rows).reshape(-1, len(starts)).T / units.length
    sizes = units.time / QUIET_PATH_STEPS[len(QUIET_PATH_STEPS) - len(rows) :]
    scale, flow_error = float(np.max(np.abs(starts))) / units.length, max(f.error for f in flows)
    return StepErrors(
        problem, sizes, errors, starts.T, scale, flow_error / units.length, steps, failed, QUIET_PATH_GROWTH
    )


def step_errors(scheme: Scheme, problem: Problem) -> StepErrors:
    """Compute the errors of one step from QUIET_STATES states of a problem, against the exact flow,
    at falling step sizes.

    A step size is used if no step of this size or a smaller one failed, and if the exact flow
    exists for this time. The sizes CONSISTENCY_STEPS are left out if one of them fails.
    """
    units, asked = units_of(problem), guarded(scheme)
    starts = np.array(list(sample_states(problem, units.length))[:QUIET_STATES]).T
    h = np.concatenate([QUIET_SIZES, CONSISTENCY_STEPS]) * units.time
    while h.size > CONSISTENCY_STEPS.size:
        try:
            flows = [exact_flow(problem, h, y, dense=True) for y in starts.T]
            break
        except FlowFailure:
            h = h[1:]
    else:
        h, flows = h[:0], []
    rows: list[Array] = []
    steps, failed, none = 0, "", np.zeros((0, starts.shape[1]))
    first, usual = 0, max(h.size - CONSISTENCY_STEPS.size, 0)
    for k, size in enumerate(h):
        y, status, *_ = advance(asked, problem, starts, float(size), none)
        steps += starts.shape[1]
        if not (stuck := first_failed(scheme, problem, starts, float(size), none, status)):
            rows.append((y - np.stack([f.y[:, k] for f in flows], axis=1)) / units.length)
        elif k < usual:
            first, rows, failed = k + 1, [], f"h = {size:.2g}: {stuck}"
        else:
            break
    kept, differences = h[first : first + len(rows)], np.array(rows).reshape(len(rows), *starts.shape)
    errors = np.linalg.norm(differences[: usual - first], axis=1).T
    near = kept <= NEAR_ZERO * units.time
    scale, flow = float(np.max(np.abs(starts))) / units.length, max((f.error for f in flows), default=0.0)
    return StepErrors(
        problem, kept[: usual - first], errors, starts, scale, flow / units.length, steps, failed,
        near_zero=kept[near] / units.time, differences=np.moveaxis(differences[near], 2, 0),
    )  # fmt: skip


def rounds_step_sizes(scheme: Scheme, problem: Problem) -> float | None:
    """Return a step size h that the scheme rounds to 32 bits or fewer, or None.

    Steps of h(1 − 2⁻²⁸) and h(1 + 2⁻²⁸) must differ by 2⁻²⁷ h|f|, which is far above the rounding
    of y1. If h is rounded to 24 binary digits, both steps are equal in every digit for seven of
    eight h. The error of a step is then up to 2⁻²⁴ h|f| for h → 0, which is no order. By its slope
    it cannot be distinguished from a solver's tolerance.
    """
    if scheme.dtype != "float64" or scheme.solver_tolerance > STEP_NUDGE:  # a stated tolerance is as coarse
        return None
    units, asked = units_of(problem), guarded(scheme)
    starts = np.array(list(sample_states(problem, units.length))[:QUIET_STATES]).T
    none = np.zeros((0, starts.shape[1]))
    alike, probes = list[float](), 0
    for h in PROBED_SIZES * units.time:
        (below, first, *_), (above, second, *_) = (
            advance(asked, problem, starts, float(h * factor), none)
            for factor in (1 - STEP_NUDGE, 1 + STEP_NUDGE)
        )
        moved = np.linalg.norm(below - starts, axis=0) > MOVING_SHARE * np.linalg.norm(starts, axis=0)
        shown = (first == Status.CONVERGED) & (second == Status.CONVERGED) & moved
        if np.any(shown):
            probes += 1
            alike += [float(h)] * bool(np.all(below[:, shown] == above[:, shown]))
    return alike[0] if 2 * len(alike) > probes else None


def orders(scheme: Scheme, found: StepErrors, least: float) -> list[Order]:
    """Judge if the errors of one step, from each state, fall like the power `least` of h."""
    tolerance = scheme.solver_tolerance
    rounding = found.growth * (STEP_ROUNDING_FACTOR * EPS + 2 * tolerance) * found.scale + 2 * found.flow
    floor = SOLVER_CLEAR * (SOLVER_FLOOR * EPS + tolerance) * found.scale
    judged = [judge(found.h, e, least, rounding, floor) for e in found.errors]
    if scheme.dtype != "float64" or not len(found.differences):
        return judged
    # A stated tolerance of the force makes a limit of its size.
    limits = [limit(found.near_zero, D, rounding) for D in found.differences]
    return [
        own if at_zero is None or at_zero.is_zero or tolerance else _inconsistent(at_zero, own)
        for own, at_zero in zip(judged, limits, strict=True)
    ]


def _inconsistent(at_zero: KappaLimit, judged: Order) -> Order:
    size = float(np.max(np.abs(at_zero.value)))
    text = (
        f"{judged.text}, and {size:.1e} h for h → 0 (± {at_zero.bound:.0e}): y1 − y0 is not hf(y0) to first order. Do "
        "the weights add to 1?"
    )
    return Order(Verdict.VIOLATED, 1.0, 0.0, text)


def quiet_problems(scheme: Scheme) -> tuple[Problem, ...]:
    """Return problems without noise: those the scheme names and random members of its families,
    else standard ones.

    If there are no such problems, raise Skipped.
    """
    own = sources(scheme)
    listed = [p for item in own for p in item.problems] if own else list(cases(scheme.systems))
    members = [member for item in own if item.space is not None for member in _members(item.text)]
    found = {
        id(p): p for p in (quiet_problem(p) for p in (*listed, *members) if damping_of(p) or one_field(p))
    }
    if not found:
        raise Skipped(NO_START)
    return tuple(found.values())


@lru_cache(maxsize=16)
def _members(family: str) -> tuple[Problem, ...]:
    """Make FAMILY_MEMBERS random systems of a family, from states of size 1,
    with a full mass matrix or inertia tensor.
    """
    space = items(family)[0].space
    assert space is not None
    where = {"mass": ("full",), "inertia": ("any tensor",)}
    where |= {"degree of H": ("3–4",), "|y|": ("1",), "given as": ("data",), "h": ("> 0",)}
    found = [q for _, case in space.part(where).cases(0) if (q := quiet(case)) is not None]
    chosen = sorted(found, key=lambda case: -len(case.y))[:FAMILY_MEMBERS]
    return tuple(
        replace(case.build()[0], initial=case.y, name=f"random {family} {n}", check=False)
        for n, case in enumerate(chosen, 1)
    )
