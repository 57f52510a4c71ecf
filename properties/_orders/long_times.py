"""The energy of a method without noise over many periods: its trend, and the power of h of its oscillation.

**No trend.** Along an orbit of a symplectic or reversible method (`sepv.properties._orders.integrable`) the energy is
quasi-periodic, H(y_n) = Σ_k f_k e^{ikω̃hn}, but for exp(−c/h). Its mean over a window of N steps with weights w_j ∝
sin⁴(πj/N) is f_0 + Σ_{k≠0} f_k e^{ikω̃hτ} W(kω̃hN/2π), W the transform of the weights,

    |W(x)| ≤ 1/(πx |x² − 1||x²/4 − 1|)     for x > 2 periods in the window.

Two such means, τ apart, differ by at most 2 Σ|f_k||W_k|. |W_k| falls like k⁻⁵, so that Cauchy and Schwarz give
2 L √(2 (1 + 2⁻¹⁰ + …)) times the rms of the oscillation, L = |W| at one harmonic, and the rms is at most half of the
largest minus the least value, A. LEAKS = 4 times L A is thus more than twice what theory leaves; the rest is for
harmonics of the number of steps in a period and more, which look like slow ones: they are below 1e-4 of all
(`integrable.TAIL`). L is taken an eighth below PERIODS, because the frequency ω̃ of the method is that of the flow up
to less than this. Rounding adds its walk, and a solver's tolerance its sum. A method with a trend of r a step moves its
mean by rτ, and a change of LEAKS L A over 1.5 windows is seen: that of the whole oscillation in four hundred periods.

A mean that moves further is a trend if it also grows: the exponent of its growth with τ, by the interval over paths of
`sepv.properties._growth`, must exclude a bounded one. Theory is for small h: a step at which the energy moves by
more than GROSS of the kinetic energy is halved first.

**The power of h.** Let e_n = H(y_n) − H(y_0), n ≤ N, on a fixed time with the same weights. y_n has an expansion in
powers of h (II.8 there), and the weights vanish to fourth order at both ends, so that the rms of e about its mean is
A(h) = c h^p(1 + αh + βh² + …). Its slope s(h) = log₂ A(h)/A(h/2) is p + αh/(2 ln 2) + …, and half of the error, or a
quarter for a symmetric method, is left in s(h/2): |s(h/2) − p| ≤ |s(h/2) − s(h)|. The interval is twice that, and what
rounding may do to both slopes. Two intervals in a row below p − ½ refute.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from sepv.properties._failed_step import first_failed
from sepv.properties._growth import exponent, grows, kind_of, rounding_walk
from sepv.properties._orders.integrable import Orbits

from sepv.problem import Array, Problem
from sepv.record import EPS
from sepv.schemes import Scheme, guarded
from sepv.simulate import Carried, advance
from sepv.solve import Status
from sepv.verification._law import Verdict

# Periods in a window, for the mean and for the oscillation.
PERIODS, SHORT = 4, 2
# Distances of the means, in windows. The last one is longer where more effort is asked.
APART = (0.1875, 0.375, 0.75, 1.5)
# The bound of a trend, in units of L A (see the module's docstring).
LEAKS = 4.0
# The change of the energy by which theory is for shorter steps, beside the largest kinetic energy, and how often it is
# halved before anything is said.
GROSS, HALVED = 1 / 8, 2
# An oscillation without a power of h, between the third last and the last size of a step: the slope there is so much
# below the least one that 1 + αh + … would change eightfold where a period has 56 steps and more. Heuristic.
IRREGULAR = 1.0
# Sizes of steps, each half of the one before, and how many of them are needed at least.
SIZES, FEWEST = 5, 3


class EnergyPath:
    """H(y_n) − H(y_0) of paths from states (d, M), as far as asked.

    Raises `Stopped` where a step failed.
    """

    def __init__(self, scheme: Scheme, problem: Problem, states: Array, h: float) -> None:
        self.scheme, self.problem, self.h, self.y = scheme, problem, h, states.copy()
        self.asked, self.carried = guarded(scheme), Carried(scheme)
        self.none, self.start = np.zeros((0, states.shape[1])), problem.hamiltonian(states)
        self.found = [np.zeros(states.shape[1])]

    def errors(self, steps: int) -> Array:
        """The errors (steps + 1, M)."""
        while len(self.found) <= steps:
            value, status, *_ = advance(self.asked, self.problem, self.y, self.h, self.none, self.carried)
            if np.any(status != Status.CONVERGED):
                words = first_failed(self.scheme, self.problem, self.y, self.h, self.none, status)
                raise Stopped(f"step {len(self.found)}, {words}", np.array(self.found))
            self.y = value
            with np.errstate(over="ignore", invalid="ignore"):
                self.found.append(self.problem.hamiltonian(value) - self.start)
        return np.array(self.found[: steps + 1])


@dataclass
class Stopped(Exception):
    """A step failed: where, and the errors so far."""

    words: str
    errors: Array


@dataclass(frozen=True)
class Judged:
    """The trend, or the power: its size as a share of what is allowed, and what was seen in words."""

    verdict: Verdict
    share: float = 0.0
    text: str = ""
    steps: int = 0
    # Two findings: the energy is kept to rounding; it moves so far that the step is not short.
    kept: bool = False
    gross: bool = False


def weights(steps: int) -> Array:
    """sin⁴(πj/N), with sum 1, (N + 1,)."""
    found = np.sin(np.pi * np.arange(steps + 1) / steps) ** 4
    return np.asarray(found / np.sum(found))


def leakage(periods: float) -> float:
    """Bound the mean of a wave of size 1 with this number of periods in the window, above 2, or a larger one."""
    return 1 / (np.pi * periods * (periods**2 - 1) * (periods**2 / 4 - 1))


def means(errors: Array, window: int, offsets: list[int]) -> Array:
    """Weighted means of errors (N, M) over windows that begin at the offsets, (L, M)."""
    w = weights(window)
    return np.stack([w @ errors[n : n + window + 1] for n in offsets])


def allowed_rounding(scheme: Scheme, problem: Problem, states: Array, steps: int) -> float:
    """Bound the movement of H in a number of steps: rounding, and the tolerance that a scheme states of its solver."""
    size = float(np.max(np.sum(np.abs(problem.gradient(states) * states), axis=0)))
    walk = rounding_walk(problem, states, steps) * scheme.eps / EPS
    return walk + scheme.solver_tolerance * steps * size


def trend(scheme: Scheme, orbits: Orbits, paths: int, longer: int = 1) -> Judged:
    """Judge the movement of the mean energy over `longer` times 1.5 windows."""
    for halved in range(HALVED + 1):
        found = _trend(scheme, orbits, paths, longer, 2**halved)
        if found.verdict is Verdict.HOLDS or not found.gross:
            break
    return found


def _trend(scheme: Scheme, orbits: Orbits, paths: int, longer: int, finer: int) -> Judged:
    problem, states, h = orbits.problem, orbits.of(paths), orbits.h / finer
    path, window = EnergyPath(scheme, problem, states, h), PERIODS * orbits.steps * finer
    offsets = [round(share * longer * window) for share in APART]
    kinetic = orbits.kinetic
    try:
        first = path.errors(window)
        swing = np.ptp(first, axis=0)
        rounding = allowed_rounding(scheme, problem, states, window)
        if np.max(swing) <= rounding:
            text = f"H moves by {np.max(swing):.2g} at most in {window} steps, which is rounding"
            return Judged(Verdict.HOLDS, 0.0, text, window * states.shape[1], kept=True)
        errors = path.errors(window + offsets[-1])
    except Stopped as stopped:
        far = float(np.max(np.nan_to_num(np.abs(stopped.errors), nan=np.inf)))
        gross = far > GROSS * kinetic
        if far <= kinetic:
            return Judged(Verdict.ERROR, text=stopped.words, gross=gross)
        text = f"H is off by {far:.2g} before {stopped.words}"
        return Judged(Verdict.VIOLATED, far / kinetic, text, gross=gross)
    moved = means(errors, window, [0, *offsets])
    moved = moved[1:] - moved[0]
    bounds = LEAKS * leakage(PERIODS * 7 / 8) * swing
    bounds = bounds + 2 * allowed_rounding(scheme, problem, states, window + offsets[-1])
    share = np.max(np.abs(moved), axis=0) / bounds
    k = int(np.argmax(share))
    gross = bool(np.max(np.abs(errors)) > GROSS * kinetic)
    slope = exponent(np.array(offsets, dtype=np.float64), moved)
    verdict = Verdict.HOLDS
    text = f"the mean moves by {np.max(np.abs(moved[:, k])):.2g} of {bounds[k]:.2g} allowed in {offsets[-1]} steps"
    if share[k] > 1:
        verdict = Verdict.VIOLATED if grows(*slope) else Verdict.INCONCLUSIVE
        kind = kind_of(*slope)
        text += f", as n^({slope[0]:.2f} ± {slope[1]:.2f})" + (f", {kind}" if kind != "open" else "")
    text += f"; h = {h:.3g}, where H swings by {swing[k]:.2g}"
    return Judged(verdict, float(share[k]), text, states.shape[1] * (window + offsets[-1]), gross=gross)


def power(scheme: Scheme, orbits: Orbits, least: float) -> Judged:
    """Judge the power of h of the energy's oscillation on one path against the least one, at as few sizes as decide."""
    problem, states = orbits.problem, orbits.of(1)
    sizes, rounding, steps = list[float](), list[float](), 0
    for level in range(SIZES):
        many = SHORT * orbits.steps * 2**level
        try:
            errors = EnergyPath(scheme, problem, states, orbits.h / 2**level).errors(many)[:, 0]
        except Stopped as stopped:
            return Judged(Verdict.ERROR, text=stopped.words)
        w, steps = weights(many), steps + many
        sizes.append(float(np.sqrt(w @ (errors - w @ errors) ** 2)))
        rounding.append(allowed_rounding(scheme, problem, states, many))
        found = judged_power(sizes, rounding, least)
        if found.verdict is not Verdict.INCONCLUSIVE:
            break
    return replace(found, steps=steps)


def judged_power(sizes: list[float], rounding: list[float], least: float) -> Judged:
    """Judge oscillations at h, h/2, …, of which rounding makes so much at most; inconclusive while more may decide."""
    text = f"oscillations {', '.join(f'{size:.2g}' for size in sizes)} at h, h/2, …"
    if sizes[-1] <= rounding[-1]:
        return Judged(Verdict.HOLDS, 0.0, f"{text}: the last one is rounding")
    if len(sizes) < FEWEST:
        return Judged(Verdict.INCONCLUSIVE, 1.0, text)
    value, half = _slope(sizes[-FEWEST:], rounding[-FEWEST:])
    text += f": h^{value:.2f} ± {half:.2f}"
    if value - half >= least:
        return Judged(Verdict.HOLDS, 2 ** (least - value + half), text)
    short = 2 ** (least - value - half)
    if short > 1 and len(sizes) > FEWEST:
        before = _slope(sizes[-FEWEST - 1 : -1], rounding[-FEWEST - 1 : -1])
        if sum(before) < least:
            return Judged(Verdict.VIOLATED, short, text)
    fall = 0.5 * float(np.log2(sizes[-3] / sizes[-1]))
    if len(sizes) == SIZES and fall < least - IRREGULAR:
        return Judged(Verdict.VIOLATED, 2 ** (least - fall), f"{text}: it does not fall")
    return Judged(Verdict.INCONCLUSIVE, 1.0, text)


def _slope(sizes: list[float], rounding: list[float]) -> tuple[float, float]:
    """s(h/2) from three sizes, and half of its interval."""
    slopes = np.log2(np.array(sizes[:-1]) / sizes[1:])
    off = np.array(rounding) / sizes / np.log(2)
    return float(slopes[1]), 2 * abs(float(slopes[1] - slopes[0])) + float(off @ (2, 5, 3))
