"""The energy of a method without noise over many periods: its trend,
and the power of h of its oscillation.

**No trend.** Along an orbit of a symplectic or reversible method
(`sepv.properties._orders.integrable`) the energy is quasi-periodic, H(y_n) = Σ_k f_k e^{ikω̃hn}, up
to exp(−c/h). With weights w_j ∝ sin⁴(πj/N), the mean energy over a window of N steps from step τ is
f_0 + Σ_{k≠0} f_k e^{ikω̃hτ} W(kω̃hN/2π), with the transform W of the weights,

    |W(x)| ≤ 1/(πx |x² − 1||x²/4 − 1|)     for x > 2 periods in the window.

Let W_k be W at kω̃hN/2π. Two such means, τ steps apart, differ by at most 2 Σ|f_k||W_k|. Because
|W_k| falls like k⁻⁵, the Cauchy-Schwarz inequality bounds this by 2 L √(2 (1 + 2⁻¹⁰ + …)) times the
rms of the oscillation, with L = |W_1|. The rms is at most half of the range A, the largest minus
the least value. So the bound LEAK_FACTOR L A, LEAK_FACTOR = 4, is more than twice what theory
gives. This allows for harmonics k of at least the number of steps in a period, which look like slow
waves and are at most 1e-4 of all harmonics (`integrable.HARMONICS_TAIL`). L is evaluated at 7/8 of
MEAN_PERIODS, because the method's frequency ω̃ differs from the flow's by less than an eighth. The
random walk of rounding and the sum of a solver's tolerances are added to the bound. A trend of r a
step moves the mean by rτ. It is detected if it amounts to LEAK_FACTOR L A over 1.5 windows, which
is the whole oscillation in four hundred periods.

A mean that moves further shows a trend if the movement also grows with τ: the confidence interval
of its exponent (`sepv.properties._growth`) must exclude bounded growth. The theory is for small h.
If the energy moves by more than GROSS_SHARE times the kinetic energy, h is halved first.

**The power of h.** Let e_n = H(y_n) − H(y_0), n ≤ N, over a fixed time, with weights w_n. y_n has
an expansion in powers of h (Hairer, Lubich and Wanner, II.8), and the weights vanish to fourth
order at both ends, so that the rms of e about its mean is A(h) = c h^p(1 + αh + βh² + …). The slope
s(h) = log₂ A(h)/A(h/2) is p + αh/(2 ln 2) + …. The error of s(h/2) is half of that of s(h), or a
quarter for a symmetric method, so |s(h/2) − p| ≤ |s(h/2) − s(h)|. The interval is s(h/2) ± 2|s(h/2)
− s(h)|, enlarged by rounding in both slopes. Two intervals in a row below p − ½ refute the order p.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from sepv.properties._failed_step import first_failed
from sepv.properties._growth import exponent, grows, kind_of, rounding_walk
from sepv.properties._orders.integrable import Orbits

from sepv.core.newton import Status
from sepv.law import Verdict
from sepv.problem import Array, Problem, energy_change
from sepv.record import EPS
from sepv.schemes import Scheme, guarded
from sepv.simulate import Carried, advance

# The number of periods in a window, for the mean (MEAN_PERIODS) and for the oscillation
# (OSCILLATION_PERIODS).
MEAN_PERIODS, OSCILLATION_PERIODS = 4, 2
# Distances between the first mean and the others, in windows. With more effort (`--deep`) they are
# longer.
WINDOW_DISTANCES = (0.1875, 0.375, 0.75, 1.5)
# The bound of a movement of the mean, in units of L A (see the docstring of the module).
LEAK_FACTOR = 4.0
# If the energy changes by more than GROSS_SHARE times the largest kinetic energy, theory needs
# shorter steps: h is halved, at most MAX_HALVED times, before a trend is reported.
GROSS_SHARE, MAX_HALVED = 1 / 8, 2
# Heuristic: an oscillation shows no power of h if its slope over the last three step sizes is lower
# than the least one by SLOPE_DROP. Else 1 + αh + … would change eightfold although a period has 56
# or more steps.
SLOPE_DROP = 1.0
# The largest number of step sizes, each half of the one before, and the least number for a verdict.
ENERGY_MAX_SIZES, ENERGY_MIN_SIZES = 5, 3


class EnergyPath:
    """H(y_n) − H(y_0) on paths from states (d, M), computed up to the largest n requested so far.

    If a step fails, `Stopped` is raised.
    """

    def __init__(self, scheme: Scheme, problem: Problem, states: Array, h: float) -> None:
        self.scheme, self.problem, self.h, self.y = scheme, problem, h, states.copy()
        self.asked, self.carried = guarded(scheme), Carried(scheme)
        self.none = np.zeros((0, states.shape[1]))
        self.found = [np.zeros(states.shape[1])]

    def errors(self, steps: int) -> Array:
        """Return the energy errors H(y_n) − H(y_0) of M paths for n = 0, …, steps,
        as an array (steps + 1, M).
        """
        while len(self.found) <= steps:
            value, status, *_ = advance(self.asked, self.problem, self.y, self.h, self.none, self.carried)
            if np.any(status != Status.CONVERGED):
                words = first_failed(self.scheme, self.problem, self.y, self.h, self.none, status)
                raise Stopped(f"step {len(self.found)}, {words}", np.array(self.found))
            with np.errstate(over="ignore", invalid="ignore"):
                self.found.append(self.found[-1] + energy_change(self.problem, self.y, value))
            self.y = value
        return np.array(self.found[: steps + 1])


@dataclass
class Stopped(Exception):
    """A step failed. `words` describes the step, `errors` are the energy errors before it."""

    words: str
    errors: Array


@dataclass(frozen=True)
class JudgedEnergy:
    """The judgement of the energy's trend or power of h: a verdict, a text, and `share`,
    a size over its limit.
    """

    verdict: Verdict
    share: float = 0.0
    text: str = ""
    steps: int = 0
    # `kept`: H is constant up to rounding. `gross`: H moves so far that the step is too long for
    # the theory.
    kept: bool = False
    gross: bool = False
    # The step size, and the energy errors of the first path.
    h: float = 0.0
    errors: Array = field(default_factory=lambda: np.empty(0), repr=False)


def weights(steps: int) -> Array:
    """Return the N + 1 weights of a mean over N = `steps` steps, proportional to sin⁴(πj/N),
    with sum 1.
    """
    found = np.sin(np.pi * np.arange(steps + 1) / steps) ** 4
    return np.asarray(found / np.sum(found))


def leakage(periods: float) -> float:
    """Bound the mean of a wave of size 1, by `weights` over a window that has at least
    `periods` > 2 of its periods.
    """
    return 1 / (np.pi * periods * (periods**2 - 1) * (periods**2 / 4 - 1))


def means(errors: Array, window: int, offsets: list[int]) -> Array:
    """Return weighted means (L, M) of errors (N, M) over windows that begin at the L `offsets`."""
    w = weights(window)
    return np.stack([w @ errors[n : n + window + 1] for n in offsets])


def allowed_rounding(scheme: Scheme, problem: Problem, states: Array, steps: int) -> float:
    """Bound the change of H over `steps` steps by rounding and by the tolerance that a scheme
    states for its solver.
    """
    size = float(np.max(np.sum(np.abs(problem.gradient(states) * states), axis=0)))
    walk = rounding_walk(problem, states, steps) * scheme.eps / EPS
    return walk + scheme.solver_tolerance * steps * size


def trend(scheme: Scheme, orbits: Orbits, paths: int, longer: int = 1) -> JudgedEnergy:
    """Judge how far the mean over a window moves in `longer` × 1.5 windows. If H moves by too much,
    h is halved.
    """
    for halved in range(MAX_HALVED + 1):
        found = _trend(scheme, orbits, paths, longer, 2**halved)
        if found.verdict is Verdict.HOLDS or not found.gross:
            break
    return found


def _trend(scheme: Scheme, orbits: Orbits, paths: int, longer: int, finer: int) -> JudgedEnergy:
    problem, states, h = orbits.problem, orbits.of(paths), orbits.h / finer
    path, window = EnergyPath(scheme, problem, states, h), MEAN_PERIODS * orbits.steps * finer
    offsets = [round(share * longer * window) for share in WINDOW_DISTANCES]
    kinetic = orbits.kinetic
    try:
        first = path.errors(window)
        swing = np.ptp(first, axis=0)
        rounding = allowed_rounding(scheme, problem, states, window)
        if np.max(swing) <= rounding:
            text = f"H moves by {np.max(swing):.2g} at most in {window} steps, which is rounding"
            return JudgedEnergy(Verdict.HOLDS, 0.0, text, window * states.shape[1], kept=True)
        errors = path.errors(window + offsets[-1])
    except Stopped as stopped:
        far = float(np.max(np.nan_to_num(np.abs(stopped.errors), nan=np.inf)))
        gross = far > GROSS_SHARE * kinetic
        if far <= kinetic:
            return JudgedEnergy(Verdict.ERROR, text=stopped.words, gross=gross)
        text = f"H is off by {far:.2g} before {stopped.words}"
        return JudgedEnergy(Verdict.VIOLATED, far / kinetic, text, gross=gross)
    moved = means(errors, window, [0, *offsets])
    moved = moved[1:] - moved[0]
    bounds = LEAK_FACTOR * leakage(MEAN_PERIODS * 7 / 8) * swing
    bounds = bounds + 2 * allowed_rounding(scheme, problem, states, window + offsets[-1])
    share = np.max(np.abs(moved), axis=0) / bounds
    k = int(np.argmax(share))
    gross = bool(np.max(np.abs(errors)) > GROSS_SHARE * kinetic)
    slope = exponent(np.array(offsets, dtype=np.float64), moved)
    verdict = Verdict.HOLDS
    text = f"the mean moves by {np.max(np.abs(moved[:, k])):.2g} of {bounds[k]:.2g} allowed in {offsets[-1]} steps"
    if not share[k] <= 1:
        verdict = Verdict.VIOLATED if grows(*slope) else Verdict.INCONCLUSIVE
        kind = kind_of(*slope)
        text += f", as n^({slope[0]:.2f} ± {slope[1]:.2f})" + (f", {kind}" if kind != "open" else "")
    text += f"; h = {h:.3g}, where H swings by {swing[k]:.2g}"
    steps = states.shape[1] * (window + offsets[-1])
    return JudgedEnergy(verdict, float(share[k]), text, steps, gross=gross, h=h, errors=errors[:, 0])


def power(scheme: Scheme, orbits: Orbits, least: float, known: JudgedEnergy) -> JudgedEnergy:
    """Judge the power of h of the energy's oscillation on one path against `least`,
    with more step sizes as needed.

    For one of the step sizes the judgement of the trend, `known`, has the path already.
    """
    problem, states = orbits.problem, orbits.of(1)
    sizes, rounding, steps = list[float](), list[float](), 0
    for level in range(ENERGY_MAX_SIZES):
        many, h = OSCILLATION_PERIODS * orbits.steps * 2**level, orbits.h / 2**level
        if h == known.h and known.errors.size > many:
            errors = known.errors[: many + 1]
        else:
            try:
                errors = EnergyPath(scheme, problem, states, h).errors(many)[:, 0]
            except Stopped as stopped:
                return JudgedEnergy(Verdict.ERROR, text=stopped.words)
            steps += many
        w = weights(many)
        sizes.append(float(np.sqrt(w @ (errors - w @ errors) ** 2)))
        rounding.append(allowed_rounding(scheme, problem, states, many))
        found = judged_power(sizes, rounding, least)
        if found.verdict is not Verdict.INCONCLUSIVE:
            break
    return replace(found, steps=steps)


def judged_power(sizes: list[float], rounding: list[float], least: float) -> JudgedEnergy:
    """Judge oscillations `sizes` at h, h/2, …, with bounds `rounding`:
    inconclusive if more step sizes may decide.
    """
    text = f"oscillations {', '.join(f'{size:.2g}' for size in sizes)} at h, h/2, …"
    if sizes[-1] <= rounding[-1]:
        return JudgedEnergy(Verdict.HOLDS, 0.0, f"{text}: the last one is rounding")
    if len(sizes) < ENERGY_MIN_SIZES:
        return JudgedEnergy(Verdict.INCONCLUSIVE, 1.0, text)
    value, half = _slope(sizes[-ENERGY_MIN_SIZES:], rounding[-ENERGY_MIN_SIZES:])
    text += f": h^{value:.2f} ± {half:.2f}"
    if value - half >= least:
        return JudgedEnergy(Verdict.HOLDS, 2 ** (least - value + half), text)
    short = 2 ** (least - value - half)
    if short > 1 and len(sizes) > ENERGY_MIN_SIZES:
        before = _slope(sizes[-ENERGY_MIN_SIZES - 1 : -1], rounding[-ENERGY_MIN_SIZES - 1 : -1])
        if sum(before) < least:
            return JudgedEnergy(Verdict.VIOLATED, short, text)
    fall = 0.5 * float(np.log2(sizes[-3] / sizes[-1]))
    if len(sizes) == ENERGY_MAX_SIZES and fall < least - SLOPE_DROP:
        return JudgedEnergy(Verdict.VIOLATED, 2 ** (least - fall), f"{text}: it does not fall")
    return JudgedEnergy(Verdict.INCONCLUSIVE, 1.0, text)


def _slope(sizes: list[float], rounding: list[float]) -> tuple[float, float]:
    """Return the slope log₂ A(h/2)/A(h/4) and its interval's half-width,
    for oscillations `sizes` A at h, h/2, h/4.
    """
    slopes = np.log2(np.array(sizes[:-1]) / sizes[1:])
    off = np.array(rounding) / sizes / np.log(2)
    return float(slopes[1]), 2 * abs(float(slopes[1] - slopes[0])) + float(off @ (2, 5, 3))
