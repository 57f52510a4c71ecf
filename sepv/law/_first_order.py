"""The first-order response of a step beside the true field, component by component:
it names the cause of many faults.

A consistent step has y1 − y0 = h f_0(y0) + Σ_j c_jΔW_j f_j(y0) + higher orders in h and ΔW ~ √h,
with the fields f_j of the system (all equal to B∇H for (1.1)). Two limits as h → 0 are measured
from a few states y0:

- drift: (y1 − y0)/h with ΔW = 0, which is f_0 + O(h); the values for h and h/2 are extrapolated;
- noise j: half the difference of the ends for ΔW_j = √h and ΔW_j = −√h, divided by c_j√h. Terms of
  even powers of ΔW_j cancel, so that it is f_j + O(h).

If a component moves by another share of its field than 1, the share names the cause: 0.50 is half a
kick, −1.00 a wrong sign, a mass is a missing factor. If the share changes like a power of h, the
scheme multiplies by that power.

**Itô's correction.** The mean of y1 − y0 over ΔW_j = ±√h is h(f_0 + s) + O(h²), s = ½Σ_j
c_j²f_j′f_j, for every scheme with the right limit: a scheme in Itô's form adds hs, one in
Stratonovich's form has it from ΔW_j². The share of s in the mean is measured too. A drift that
differs from f_0 by s alone is right.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from sepv.errors import SepvError, UsageError
from sepv.law.units import units_of
from sepv.problem import (
    Array,
    Problem,
    drift,
    ito_drift,
    mechanics,
    noise_field,
    sample_states,
)
from sepv.schemes import Scheme, StatefulStep, ask_next

# The step size in the problem's unit of time, and the factor of a second one, which shows powers
# of h.
SHARES_H, FINER_FACTOR = 2.0**-12, 2.0**-4
# A component is not measured from a state where its field is smaller than MEASURED_FIELD_SHARE of
# the largest component.
MEASURED_FIELD_SHARE = 1e-3
# Shares are right within SHARE_TOLERANCE: errors are O(h) = O(SHARES_H). A power of h of at least
# NAMED_MIN_POWER is named.
SHARE_TOLERANCE, NAMED_MIN_POWER = 0.01, 0.2
# The number of components that are listed if they differ, and the number of earlier steps of a
# scheme with memory.
LISTED_DIFFERENCES, EARLIER_STEPS = 8, 7
# Itô's correction is right within this share: its error is O(h) relative to it, and it is smaller
# than the drift.
CORRECTION_TOLERANCE = 0.05


def first_order(scheme: Scheme, problem: Problem) -> list[str]:
    """Lines about components that do not move like the fields of a problem; empty if all do,
    or nothing was measured.

    For a scheme that carries a state, steps from the middle of a path are measured too.
    """
    with np.errstate(all="ignore"):
        lines = _wrong(scheme, problem, 0)
        if lines or not isinstance(scheme.step, StatefulStep):
            return lines
        later = _wrong(scheme, problem, EARLIER_STEPS)
    return (
        [f"the first step is right, later ones are not; step {EARLIER_STEPS + 1}: {later[0]}", *later[1:]]
        if later
        else []
    )


def _wrong(scheme: Scheme, problem: Problem, before: int) -> list[str]:
    """The lines of `first_order` about a step that comes after `before` other steps."""
    unit = units_of(problem).time
    lines = []
    for j in range(1 + problem.noises):
        shares = [_shares(scheme, problem, j, size * SHARES_H * unit, before) for size in (1.0, FINER_FACTOR)]
        lines.append(_line(problem, j, shares[0], shares[1], SHARES_H * unit))
    correction = (
        np.nan if any(lines[1:]) or before else _correction(scheme, problem, FINER_FACTOR * SHARES_H * unit)
    )
    if abs(correction - 1) <= CORRECTION_TOLERANCE:
        lines[0] = ""
    elif not any(lines) and not np.isnan(correction):
        lines.append(
            f"the mean of y1 has {correction:.2f} of Itô's correction ½ Σ c_j² f_j′f_j, where Stratonovich's equation "
            "has 1.00: the increments ΔW_j² are missing or counted twice"
        )
    return [line for line in lines if line]


def _correction(scheme: Scheme, problem: Problem, h: float) -> float:
    """The share of Itô's correction s in the mean of y1 − y0; NaN if s is unknown,
    small or not measured.
    """
    if not problem.noises:
        return np.nan
    found = []
    for y in sample_states(problem, units_of(problem).length):
        with suppress(SepvError, ArithmeticError):
            further = _mean(scheme, problem, y, h) - _field(problem, y, 0)
            s = ito_drift(problem, y) - drift(problem, y)
            if np.max(np.abs(s)) > MEASURED_FIELD_SHARE * np.max(np.abs(_field(problem, y, 0))):
                share = float(further @ s / (s @ s))
                # A mean that has another part besides s is no matter of Itô's correction.
                along = np.linalg.norm(further - share * s) <= CORRECTION_TOLERANCE * np.linalg.norm(s)
                found.append(share if along else np.nan)
    return float(np.median(found)) if found else np.nan  # NaN if one is NaN


def _mean(scheme: Scheme, problem: Problem, y: Array, h: float) -> Array:
    """(E[y1] − y0)/h for independent ΔW_j = ±√h, up to O(h): from steps with one nonzero ΔW_j
    each.
    """
    none = np.zeros(problem.noises)
    still = ask_next(scheme, problem, y, None, h, none)[0]
    total = still - y
    for j in range(problem.noises):
        noise = none.copy()
        noise[j] = math.sqrt(h)
        ends = [ask_next(scheme, problem, y, None, h, sign * noise)[0] for sign in (1, -1)]
        total = total + (ends[0] - still + ends[1] - still) / 2
    return np.asarray(total / h)


def _shares(scheme: Scheme, problem: Problem, j: int, h: float, before: int) -> Array:
    """The shares (S, d) of the field of part j (0: drift, else noise j) by which components move,
    from S states.

    Components whose field is small, and states from which a step fails, are NaN.
    """
    found = []
    for y0 in sample_states(problem, units_of(problem).length):
        share = np.full(problem.dimension, np.nan)
        with suppress(SepvError, ArithmeticError):
            y, moved = _moved(scheme, problem, y0, j, h, before)
            field = _field(problem, y, j)
            known = np.abs(field) > MEASURED_FIELD_SHARE * np.max(np.abs(field))
            noise = 4 * scheme.solver_tolerance * np.max(np.abs(y)) / (h if j == 0 else math.sqrt(h))
            known &= SHARE_TOLERANCE * np.abs(field) > noise
            share[known] = moved[known] / field[known]
        found.append(share)
    return np.array(found)


def _moved(scheme: Scheme, problem: Problem, y0: Array, j: int, h: float, before: int) -> tuple[Array, Array]:
    """A state y on a path from y0, after `before` steps without noise,
    and the response of the next step from y.
    """

    def end(h: float, noise: float) -> tuple[Array, Array]:
        y, state, dW = y0, None, np.zeros(problem.noises)
        for _ in range(before):
            y, state = ask_next(scheme, problem, y, state, h, dW)
        if j:
            dW[j - 1] = noise
        return y, ask_next(scheme, problem, y, state, h, dW)[0]

    if j:
        y, ahead = end(h, math.sqrt(h))
        return y, (ahead - end(h, -math.sqrt(h))[1]) / (2 * math.sqrt(h))
    y, y1 = end(h, 0.0)
    middle, half = end(h / 2, 0.0)
    return y, (4 * (half - middle) - (y1 - y)) / h


def _field(problem: Problem, y: Array, j: int) -> Array:
    """The drift f_0 at y (j = 0), with damping, or the field c_j f_j of noise j, (d,)."""
    return np.asarray(problem.c[j - 1] * noise_field(problem, j - 1, y)) if j else drift(problem, y)


def _line(problem: Problem, j: int, coarse: Array, fine: Array, h: float) -> str:
    """The line about part j, from the shares with h and with FINER_FACTOR times h;
    empty if all known shares are 1.
    """
    known = ~np.isnan(coarse) & ~np.isnan(fine)
    if not known.any() or np.all(np.abs(fine[known] - 1) <= SHARE_TOLERANCE):
        return ""
    part = "h f" if j == 0 else f"c{j} ΔW{j} f{j if problem.noises > 1 else ''}"
    ratios = np.abs(fine[known] / coarse[known])
    powers = np.log(ratios[np.isfinite(ratios) & (ratios > 0)]) / math.log(FINER_FACTOR)
    if powers.size and abs(float(np.median(powers))) > NAMED_MIN_POWER:
        power = float(np.median(powers))
        size = float(np.median(np.abs(coarse[known])))
        if power < -1 + NAMED_MIN_POWER and j == 0:
            return f"y1 − y0 does not vanish with h and ΔW: at h = {h:.2g} it is {size:.2g} times h f"
        return (
            f"as h → 0 the share of {part} by which y moves is like h^{power:.2f}: {size:.2g} at h = {h:.2g}"
        )
    values = {name: fine[:, i][known[:, i]] for i, name in enumerate(names(problem)) if known[:, i].any()}
    shown = {name: _range(v) for name, v in values.items()}
    if len(set(shown.values())) == 1:
        return f"as h → 0 y moves by {next(iter(shown.values()))} of {part}"
    wrong = {
        n: s
        for n, s in shown.items()
        if len(shown) <= LISTED_DIFFERENCES or np.any(np.abs(values[n] - 1) > SHARE_TOLERANCE)
    }
    first, *others = list(wrong.items())[:LISTED_DIFFERENCES]
    rest = "".join(f", {name} by {share}" for name, share in others)
    return f"as h → 0 {first[0]} moves by {first[1]} of {part}{rest}"


def _range(values: Array) -> str:
    low, high = float(np.min(values)), float(np.max(values))
    if high - low <= SHARE_TOLERANCE * max(1.0, abs(high)):
        return _share((low + high) / 2)
    return f"{_share(low)} to {_share(high)}"


def _share(value: float) -> str:
    return f"{round(value, 2) + 0.0:.2f}"  # a share that rounds to 0 has no sign


def names(problem: Problem) -> Iterator[str]:
    """The names of the components of y: p and q of a mechanical problem, else y1, y2 and so on."""
    try:
        first = mechanics(problem).positions_first
    except (UsageError, SepvError):
        return iter([f"y{i + 1}" for i in range(problem.dimension)])
    n = problem.dimension // 2
    return iter([f"{v}{k + 1 if n > 1 else ''}" for v in ("qp" if first else "pq") for k in range(n)])
