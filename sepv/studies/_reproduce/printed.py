"""Formulas and arguments of the paper that do not hold as printed, each with a computation as evidence.

None of them touches a theorem's conclusion for the problems of §4 at the step sizes used there.
"""

from __future__ import annotations

import math

import numpy as np

from sepv import problems
from sepv.simulate import _truncation as bounded
from sepv.studies._reproduce.record import Statement, decide


def statements() -> list[Statement]:
    """In the order of the paper."""
    return [_truncation(), _third_moment(), _ball(), _rectangle()]


def moment_gap(A: float) -> float:
    """E[ξ² − ζ²] = 2 ∫_A^∞ (x² − A²) φ(x) dx = 2[(1 − A²) Q(A) + A φ(A)] for ζ = clip(ξ, ±A)."""
    phi = math.exp(-A * A / 2) / math.sqrt(2 * math.pi)
    Q = 0.5 * math.erfc(A / math.sqrt(2))
    return 2 * ((1 - A * A) * Q + A * phi)


def _truncation() -> Statement:
    rows = []
    for exponent in (2, 6, 10):
        h = 2.0**-exponent
        A = bounded.truncation_bound(h, 2)
        rows.append((exponent, moment_gap(A), (1 + 2 * A) * h**2))
    return Statement(
        text="0 ≤ E[ξ² − ζ_h²] = (1 + 2√(2k|ln h|)) h^k",
        source="Remark 2.1",
        verdict=decide(all(left == right for _, left, right in rows), any(left < right / 2 for _, left, right in rows)),
        measured="; ".join(f"h = 2^-{e}, k = 2: left {a:.2g}, right {b:.2g}" for e, a, b in rows),
        criterion="both sides are equal; the left side is 2[(1 − A²)Q(A) + Aφ(A)], A = √(2k|ln h|)",
        correction="“≤” is meant, as in the lemma that is cited; nothing that follows uses the equality",
    )  # fmt: skip


def _third_moment() -> Statement:
    h, c = 2.0**-4, 1.0
    gap = moment_gap(bounded.truncation_bound(h, 2))
    printed, true = h**3 + 3 * c**2 * h**2, h**3 + 3 * c**2 * h**2 * (1 - gap)
    return Statement(
        text="E[(h + cΔŴ)³] = h³ + 3c²h²",
        source="proof of Theorem 3.3",
        verdict=decide(printed == true, true < printed),
        measured=f"h = 2^-4, c = 1, k = 2: left {true:.10g}, right {printed:.10g}, because E[ΔŴ²] = h (1 − {gap:.2g})",
        criterion="both sides are equal",
        correction="“≤”: the truncated increment has E[ΔŴ²] < h. The conclusion O(h²) stands",
    )


def _ball() -> Statement:
    x, p = 0.1, 0.2
    radius, distance = (x * x + p * p) / 2, math.hypot(x, p)
    return Statement(
        text="For the oscillator the convex set is the ball centred at the origin with radius (y0² + p0²)/2",
        source="Remark 3.5",
        verdict=decide(radius >= distance, radius < distance),
        measured=f"for (x0, p0) = (0.1, 0.2) that radius is {radius:.4g}, and the start is at distance {distance:.4g}",
        criterion="the ball contains the solution, which starts at (x0, p0)",
        correction="radius √(x0² + p0²): y0 is printed for x0, and the energy for the radius",
    )


def _rectangle() -> Statement:
    """An energy level of Lotka-Volterra that is not bounded, and reaches y2 → 0 where ∇H is not."""
    from scipy.special import lambertw

    system = problems.by_name("lotka-volterra")
    y0 = np.array(system.initial)
    H0 = float(system.hamiltonian(y0))
    far = []
    for y1 in (10.0, 50.0):
        # y2 + ln y2 = s has the solution W(e^s); y3 is left where it is.
        s = H0 - (2 * y1 + 2 * y0[2] - 2 * math.log(y0[2]))
        y = np.array([y1, float(lambertw(math.exp(s)).real), y0[2]])
        far.append((y, float(system.hamiltonian(y))))
    same = all(abs(H - H0) < 1e-12 * abs(H0) + 1e-13 * y[0] for y, H in far)
    return Statement(
        text="For the Lotka-Volterra system, any numerical solution can be included in a rectangle which is the "
        "product of two compact intervals, on which B and f and their derivatives are bounded",
        source="Remark 3.5; the assumption of Theorem 3.4 for §4.4",
        verdict=decide(False, same),
        measured="; ".join(f"H({y[0]:g}, {y[1]:.2g}, {y[2]:g}) = {H:.6g}" for y, H in far) + f"; H(y0) = {H0:.6g}",
        criterion="the argument is energy preservation, so the energy level would have to be bounded",
        correction="three intervals; the energy level is not bounded: y1 → ∞ with y2 → 0, where ∇H = (ab, 1 + ν/y2, …) "
        "is not bounded either. The exact solution stays away by its Casimir y1² y2 y3, which (2.1) does not keep, "
        "so that Theorem 3.4 does not cover §4.4 as it stands; the order is observed all the same",
    )  # fmt: skip
