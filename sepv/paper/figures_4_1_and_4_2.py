"""§4.1, Figures 4.1 and 4.2: the stochastic harmonic oscillator."""

from __future__ import annotations

from typing import Any

import numpy as np

from sepv import problems, schemes
from sepv.exact import exact_flow
from sepv.pictures import TIME_AXIS, Axis
from sepv.problem import Array
from sepv.record import EPS
from sepv.simulate import truncation as bounded
from sepv.simulate import wiener

from . import judge, order, runs
from .record import SENTENCE, Job, Panel, Results, Size, Statement, series

EXPLICIT_SCHEMES = ("euler-maruyama", "milstein", "euler-heun")
OSCILLATOR_SCHEMES = ("euler-maruyama", "energy-preserving", "milstein", "euler-heun")
# Explicit steps cost the same for one sample and for 64, so that the growth of H is measured over
# samples.
OSCILLATOR_RUNS = runs.LongRuns(
    "4.1", "harmonic-oscillator", 1e-2, 100_000, OSCILLATOR_SCHEMES, {"energy-preserving": 1}, others=64
)
_SAME_BECAUSE = "§4.1 and §3.3", "the Hamiltonian is quadratic"
OSCILLATOR_ORDER = order.Setting(
    "4.2", OSCILLATOR_RUNS.problem, T=5.0, steps=(80, 160, 320, 640), samples=5000,
    title="Oscillator: order", source="Figure 4.2", place="§4.1, Theorem 3.4",
    chosen=("step sizes 2^-4 to 2^-7", "the exact solution instead of Milstein's scheme with h = 2^-14"),
    same=(("energy-preserving", "midpoint", *_SAME_BECAUSE), ("energy-preserving", "discrete-gradient",
        *_SAME_BECAUSE)),
)  # fmt: skip
# Errors against a scheme with a fine step, the kind of reference that §4.1 names, on fewer samples.
OSCILLATOR_FINE = order.Setting(
    "4.2", OSCILLATOR_RUNS.problem, T=5.0, steps=(5120, 10240, 20480, 40960, 81920), samples=128,
    schemes=("milstein", "energy-preserving"), title="Oscillator: what a fine-step reference hides",
    source="Figure 4.2, the paper's own kind of reference", place="§4.1",
)  # fmt: skip
CIRCLE_RADIUS = float(np.hypot(0.1, 0.2))
# The window reaches to four radii of the energy circle, while solutions of other schemes grow a
# thousandfold.
OSCILLATOR_WINDOW = 0.9


def jobs(size: Size) -> list[Job]:
    """The jobs of both figures: four long runs, and the errors of six schemes at the end time T."""
    return [
        *order.jobs(OSCILLATOR_ORDER, size),
        *order.fine_jobs(OSCILLATOR_FINE, size),
        *OSCILLATOR_RUNS.jobs(size),
    ]


def long_time(results: Results) -> list[Panel]:
    """The panels of Figure 4.1: phase space, energy and position along one sample."""
    by_scheme = OSCILLATOR_RUNS.by_scheme(results)
    parameters = {
        "x0": 0.1,
        "p0": 0.2,
        "c": 1.0,
        "h": OSCILLATOR_RUNS.h,
        "N": by_scheme["energy-preserving"].steps,
    }
    return [part(by_scheme, parameters) for part in (_phase_space, _energy, _position)]


def convergence(results: Results) -> list[Panel]:
    """The panels of Figure 4.2: strong errors against the exact solution,
    and against a scheme with a fine step.
    """
    return [order.panel(OSCILLATOR_ORDER, results), order.fine_panel(OSCILLATOR_FINE, results)]


def _phase_space(by_scheme: dict[str, runs.SampledRun], parameters: dict[str, Any]) -> Panel:
    preserving, angle = by_scheme["energy-preserving"], np.linspace(0, 2 * np.pi, 181)
    circle = series("exact: the energy circle", CIRCLE_RADIUS * np.cos(angle), CIRCLE_RADIUS * np.sin(angle))
    off = float(np.max(np.abs(np.hypot(*preserving.y) / CIRCLE_RADIUS - 1)))
    limit = runs.rounding_bound(preserving.steps)
    statement = Statement(
        "The numerical solutions given by the energy-preserving scheme remain on the initial energy circle", "§4.1",
        judge.at_most(off, limit, 1e3 * limit), f"largest relative distance from the circle {off:.1e}",
        f"8 eps √N = {limit:.1e}",
    )  # fmt: skip
    return Panel(
        key="4.1-phase-space", title="Oscillator: phase space", source="Figure 4.1, left",
        x=Axis("position x"), y=Axis("momentum p"), equal=True, window=OSCILLATOR_WINDOW,
        series=(circle, *(series(n, x, p, n, "points") for n, r in by_scheme.items() for p, x in [_inside(r.y)])),
        parameters=parameters,
        chosen=(
            f"|x|, |p| ≤ {OSCILLATOR_WINDOW:g}, beyond which the explicit schemes go on to the end of the run",
            "at most 250 points of each solution are drawn (the paper: not all)",
        ),
        statements=(statement, _cayley(), _not_suited(by_scheme)),
        description="The energy-preserving scheme stays on the circle of the initial energy; the others leave it.",
    )  # fmt: skip


def _energy(by_scheme: dict[str, runs.SampledRun], parameters: dict[str, Any]) -> Panel:
    statements = [runs.statement(by_scheme["energy-preserving"], "energy", constant=True, source="§4.1")]
    courses = []
    for name in EXPLICIT_SCHEMES:
        lost = runs.statement(by_scheme[name], "energy", constant=False, source="§4.1")
        statements += [lost, _growth(by_scheme[name])]
        factor = by_scheme[name].energy[-1] / by_scheme[name].energy[0]
        courses.append(
            f"{SENTENCE[name]} {'grows to' if factor > 1 else 'falls to'} {factor:.2g} times its start"
        )
    return Panel(
        key="4.1-energy", title="Oscillator: energy", source="Figure 4.1, middle",
        x=TIME_AXIS, y=Axis("energy H", log=True), series=tuple(runs.curve(r, r.energy) for r in by_scheme.values()),
        parameters=parameters, statements=tuple(statements),
        chosen=("a logarithmic axis, because the energies grow or decay exponentially",),
        description=f"One horizontal line, the energy-preserving scheme; of the others {', '.join(courses)}.",
    )  # fmt: skip


def _position(by_scheme: dict[str, runs.SampledRun], parameters: dict[str, Any]) -> Panel:
    shown, preserving = ("energy-preserving", "euler-heun"), by_scheme["energy-preserving"]
    largest = {n: float(np.max(np.abs(r.y[1]))) for n, r in by_scheme.items()}
    ours, heun, *others = (largest[n] for n in (*shown, "euler-maruyama", "milstein"))
    stays = ours <= CIRCLE_RADIUS * (1 + runs.rounding_bound(preserving.steps))
    seen = "; ".join(f"largest |x| of {SENTENCE[n]} {largest[n]:.3g}" for n in ("euler-maruyama", "milstein"))
    statements = (
        Statement("The position of the energy-preserving method shows its long time stability, that of Euler-Heun does "
                  "not", "§4.1", judge.decide(stays and heun > 2 * CIRCLE_RADIUS, not stays),
                  f"largest |x|: {ours:.4f} and {heun:.3g}; the circle's radius is {CIRCLE_RADIUS:.4f}",
                  "within the radius of the energy circle for the one, beyond twice that for the other"),
        Statement("The other numerical schemes offer similar behaviour as that of Euler-Heun's method", "§4.1",
                  judge.decide(min(others) > 2 * CIRCLE_RADIUS,
                      max(others) <= 2 * CIRCLE_RADIUS and preserving.steps >= OSCILLATOR_RUNS.steps),
                  seen, "beyond twice the radius of the energy circle, as Euler-Heun's"),
    )  # fmt: skip
    T = preserving.steps * OSCILLATOR_RUNS.h
    last = 30.0 if T > 60 else T
    gap = np.abs(
        preserving.y[1] - exact_flow(problems.by_name(OSCILLATOR_RUNS.problem), preserving.theta).y[1]
    )
    return Panel(
        key="4.1-position", title="Oscillator: position", source="Figure 4.1, right",
        x=TIME_AXIS, y=Axis("position x"), window=OSCILLATOR_WINDOW,
        series=tuple(series(n, by_scheme[n].t, by_scheme[n].y[1], n) for n in shown), parameters=parameters,
        chosen=(
            f"|x| ≤ {OSCILLATOR_WINDOW:g}; Euler-Heun's position goes on to {heun:.2g}",
            "the exact solution is not drawn: at this length it fills the same band",
        ),
        statements=statements,
        description="The energy-preserving position oscillates in a constant band; that of Euler-Heun grows.",
        numbers={
            f"largest error of x of the energy-preserving scheme until t = {last:g}": float(
                np.max(gap[preserving.t <= last])
            ),
            "the same over the whole run": float(np.max(gap)),
        },
    )  # fmt: skip


def _cayley() -> Statement:
    """The statement that the explicit formula of §4.1 gives the same step as the energy-preserving
    scheme.
    """
    problem = problems.by_name(OSCILLATOR_RUNS.problem)
    dW = bounded.truncate(
        wiener.increments(1, T=OSCILLATOR_RUNS.h, steps=1, noises=1, paths=256)[0], OSCILLATOR_RUNS.h
    )
    start = p, x = np.repeat(np.array(problem.initial)[:, None], 256, axis=1)
    delta = OSCILLATOR_RUNS.h + dW[0]
    printed = np.stack([-delta * x + (1 - delta**2 / 4) * p, (1 - delta**2 / 4) * x + delta * p]) / (
        1 + delta**2 / 4
    )
    gap = float(
        np.max(np.abs(schemes.energy_preserving.step(problem, start, OSCILLATOR_RUNS.h, dW) - printed))
    )
    limit = 8 * EPS * 0.2
    return Statement(
        "Scheme (2.2) reduces to the explicit formula of §4.1", "§4.1", judge.at_most(gap, limit, 1e3 * limit),
        f"largest difference over 256 steps {gap:.1e}", f"8 roundings of y, {limit:.1e}",
    )  # fmt: skip


def growth_per_step(name: str, h: float) -> tuple[float, float]:
    """Mean and variance of ln(H(y_{n+1})/H(y_n)) for the oscillator,
    where they do not depend on y_n.

    With S = ΔŴ, H_n+1/H_n is (1 − h/2)² + (h + S)² for Euler-Maruyama, (1 − S²/2)² + (h + S)² for
    Milstein and (1 − (hS + S²)/2)² + (h + S)² for Euler-Heun.
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(80)
    S = np.sqrt(h) * np.clip(nodes, *bounded.truncation_bound(h, 2) * np.array([-1, 1]))
    real = {"euler-maruyama": h / 2 + 0 * S, "milstein": S**2 / 2, "euler-heun": (h * S + S**2) / 2}[name]
    ln, w = np.log((1 - real) ** 2 + (h + S) ** 2), weights / weights.sum()
    mean = float(w @ ln)
    return mean, float(w @ (ln - mean) ** 2)


def _growth(run: runs.SampledRun) -> Statement:
    """The statement on the growth of energy: the mean of ln H over samples against E[ln H] by the
    scheme's formula.
    """
    mean, variance = growth_per_step(run.scheme, run.h)
    logs: Array = np.log(run.energies[-1] / run.energy[0])
    expected, spread = mean * run.steps, np.sqrt(variance * run.steps / logs.size)
    return Statement(
        f"(ours) The mean of ln H of {SENTENCE[run.scheme]} grows as its formula predicts",
        "the scheme's step, squared", judge.at_most(abs(float(np.mean(logs)) - expected) / spread, 4, 6),
        f"mean of ln(H_N/H_0) over {logs.size} samples {np.mean(logs):.2f}",
        f"expected {expected:.2f} ± {spread:.2f}; within 4 of these (a false alarm in 16000)",
    )  # fmt: skip


def _not_suited(by_scheme: dict[str, runs.SampledRun]) -> Statement:
    ratios = {SENTENCE[n]: by_scheme[n].energy / by_scheme[n].energy[0] for n in EXPLICIT_SCHEMES}
    left = [bool(r.max() > 2 or r.min() < 0.5) for r in ratios.values()]
    return Statement(
        "Euler-Maruyama's, Euler-Heun's and Milstein's methods are not appropriate for simulations of the stochastic "
        "oscillator over long time intervals", "§4.1",
        # In a run shorter than the paper's, small growth does not refute the statement.
        judge.decide(all(left), not any(left) and by_scheme["milstein"].steps >= OSCILLATOR_RUNS.steps),
        "; ".join(f"{name}: H/H_0 from {r.min():.2g} to {r.max():.2g}" for name, r in ratios.items()),
        "the energy of the sample leaves the factor 2 around its start",
    )  # fmt: skip


def _inside(y: Array, points: int = 250) -> Array:
    """The states (d, M) that lie in the panel's window, thinned to at most `points`."""
    seen = y[:, np.max(np.abs(y), axis=0) <= OSCILLATOR_WINDOW]
    return seen[:, :: max(1, -(-seen.shape[1] // points))]
