"""§4.1, Figures 4.1 and 4.2: the stochastic harmonic oscillator."""

from __future__ import annotations

from typing import Any

import numpy as np

from sepv import problems, schemes
from sepv.exact import exact_flow
from sepv.problem import Array
from sepv.record._binary64 import EPS
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener
from sepv.studies._picture import Axis
from sepv.studies._reproduce import order, runs
from sepv.studies._reproduce.record import SENTENCE, Job, Panel, Results, Size, Statement, decide, series

PROBLEM = "harmonic-oscillator"
STEPS, H = 100_000, 1e-2
SHOWN = ("euler-maruyama", "energy-preserving", "milstein", "euler-heun")
# Explicit steps cost the same for one sample and for 64: growth is then measured, not seen once.
RUNS = runs.LongRuns("4.1", PROBLEM, H, STEPS, SHOWN, {"energy-preserving": 1}, others=64)
ORDER = order.Setting("4.2", PROBLEM, T=5.0, steps=(80, 160, 320, 640), samples=5000)
# The reference that the text names, on fewer samples.
FINE = order.Setting(
    "4.2", PROBLEM, T=5.0, steps=(5120, 10240, 20480, 40960, 81920), samples=128,
    schemes=("milstein", "energy-preserving"),
)  # fmt: skip
# Four radii of the energy circle: the others grow by a thousand in the same time.
WINDOW = 0.9


def jobs(size: Size) -> list[Job]:
    """Four long runs, and the errors of six schemes."""
    return [*order.jobs(ORDER, size), *order.fine_jobs(FINE, size), *RUNS.jobs(size)]


def long_time(results: Results) -> list[Panel]:
    """Figure 4.1: phase space, energy, position."""
    found = RUNS.found(results)
    preserving = found["energy-preserving"]
    parameters: dict[str, Any] = {"x0": 0.1, "p0": 0.2, "c": 1.0, "h": H, "N": preserving.steps}
    return [part(found, parameters) for part in (_phase_space, _energy, _position)]


def _phase_space(found: dict[str, runs.Run], parameters: dict[str, Any]) -> Panel:
    preserving = found["energy-preserving"]
    shown = [series(n, _inside(r.y)[1], _inside(r.y)[0], n, "points") for n, r in found.items()]
    angle = np.linspace(0, 2 * np.pi, 181)
    radius = np.hypot(0.1, 0.2)
    circle = series("exact: the energy circle", radius * np.cos(angle), radius * np.sin(angle))
    off = float(np.max(np.abs(np.hypot(*preserving.y) / radius - 1)))
    limit = runs.rounding_bound(preserving.steps)
    circle_kept = Statement(
        text="The numerical solutions given by the energy-preserving scheme remain on the initial energy circle",
        source="§4.1",
        verdict=decide(off <= limit, off > 1e3 * limit),
        measured=f"largest relative distance from the circle {off:.1e}",
        criterion=f"8 eps √N = {limit:.1e}",
    )
    return Panel(
        key="4.1-phase-space",
        title="Oscillator: phase space",
        source="Figure 4.1, left",
        x=Axis("position x"),
        y=Axis("momentum p"),
        series=(circle, *shown),
        parameters=dict(parameters),
        chosen=(
            f"|x|, |p| ≤ {WINDOW:g}, beyond which the explicit schemes go on to the end of the run",
            "at most 250 points of each solution are drawn (the paper: not all)",
        ),
        statements=(circle_kept, _cayley(), _not_suited(found)),
        description="The energy-preserving scheme stays on the circle of the initial energy; the others leave it.",
        equal=True,
        window=WINDOW,
    )


def _energy(found: dict[str, runs.Run], parameters: dict[str, Any]) -> Panel:
    first = ("energy-preserving", "euler-maruyama", "milstein", "euler-heun")
    said = runs.statements({n: found[n] for n in first}, "energy", first[:1], "§4.1")
    grown = [_growth(found[n]) for n in first[1:]]
    statements = [said[0], *(s for pair in zip(said[1:], grown, strict=True) for s in pair)]
    return Panel(
        key="4.1-energy",
        title="Oscillator: energy",
        source="Figure 4.1, middle",
        x=Axis("time t"),
        y=Axis("energy H", log=True),
        series=tuple(runs.curve(r, r.energy) for r in found.values()),
        parameters=dict(parameters),
        chosen=("a logarithmic axis, because the energies grow or decay exponentially",),
        statements=tuple(statements),
        description=f"One horizontal line, the energy-preserving scheme; of the others {_courses(found)}.",
    )  # fmt: skip


def _position(found: dict[str, runs.Run], parameters: dict[str, Any]) -> Panel:
    shown = ("energy-preserving", "euler-heun")
    last = 30.0 if found[shown[0]].steps * H > 60 else found[shown[0]].steps * H
    preserving, heun = (found[name] for name in shown)
    exact = exact_flow(problems.by_name(PROBLEM), preserving.theta).y[1]
    radius = np.hypot(0.1, 0.2)
    bounded = float(np.max(np.abs(preserving.y[1]))) <= radius * (1 + runs.rounding_bound(preserving.steps))
    stable = Statement(
        text="The position of the energy-preserving method shows its long time stability, that of Euler-Heun does not",
        source="§4.1",
        verdict=decide(bounded and float(np.max(np.abs(heun.y[1]))) > 2 * radius, not bounded),
        measured=f"largest |x|: {np.max(np.abs(preserving.y[1])):.4f} and {np.max(np.abs(heun.y[1])):.3g}; "
        f"the circle's radius is {radius:.4f}",
        criterion="within the radius of the energy circle for the one, beyond twice that for the other",
    )  # fmt: skip
    others = {n: float(np.max(np.abs(found[n].y[1]))) for n in ("euler-maruyama", "milstein")}
    similar = Statement(
        text="The other numerical schemes offer similar behaviour as that of Euler-Heun's method",
        source="§4.1",
        verdict=decide(
            min(others.values()) > 2 * radius,
            max(others.values()) <= 2 * radius and preserving.steps >= STEPS,
        ),
        measured="; ".join(f"largest |x| of {SENTENCE[n]} {x:.3g}" for n, x in others.items()),
        criterion="beyond twice the radius of the energy circle, as Euler-Heun's",
    )
    gap = np.abs(preserving.y[1] - exact)
    return Panel(
        key="4.1-position",
        title="Oscillator: position",
        source="Figure 4.1, right",
        x=Axis("time t"),
        y=Axis("position x"),
        series=tuple(series(n, found[n].t, found[n].y[1], scheme=n) for n in shown),
        parameters=dict(parameters),
        chosen=(
            f"|x| ≤ {WINDOW:g}; Euler-Heun's position goes on to {np.max(np.abs(heun.y[1])):.2g}",
            "the exact solution is not drawn: at this length it fills the same band",
        ),
        window=WINDOW,
        statements=(stable, similar),
        description="The energy-preserving position oscillates in a constant band; that of Euler-Heun grows.",
        numbers={
            f"largest error of x of the energy-preserving scheme until t = {last:g}": float(
                np.max(gap[preserving.t <= last])
            ),
            "the same over the whole run": float(np.max(gap)),
        },
    )


def convergence(results: Results) -> list[Panel]:
    """Figure 4.2."""
    reason = "§4.1 and §3.3", "the Hamiltonian is quadratic"
    panel = order.panel(
        ORDER,
        results,
        title="Oscillator: order",
        source="Figure 4.2",
        place="§4.1, Theorem 3.4",
        chosen=("step sizes 2^-4 to 2^-7", "the exact solution instead of Milstein's scheme with h = 2^-14"),
        same=[("energy-preserving", other, *reason) for other in ("midpoint", "discrete-gradient")],
    )
    fine = order.fine_panel(
        FINE, results, source="Figure 4.2, the paper's own kind of reference", stated="§4.1"
    )
    return [panel, fine]


def _cayley() -> Statement:
    """The explicit formula of §4.1 against a step of the scheme."""
    h, problem = H, problems.by_name(PROBLEM)
    dW = bounded.truncate(wiener.increments(1, T=h, steps=1, noises=1, paths=256)[0], h)
    p, x = np.repeat(np.array(problem.initial)[:, None], 256, axis=1)
    delta = h + dW[0]
    printed = np.stack([-delta * x + (1 - delta**2 / 4) * p, (1 - delta**2 / 4) * x + delta * p]) / (
        1 + delta**2 / 4
    )
    gap = float(np.max(np.abs(schemes.energy_preserving.step(problem, np.stack([p, x]), h, dW) - printed)))
    limit = 8 * EPS * 0.2
    return Statement(
        text="Scheme (2.2) reduces to the explicit formula of §4.1",
        source="§4.1",
        verdict=decide(gap <= limit, gap > 1e3 * limit),
        measured=f"largest difference over 256 steps {gap:.1e}",
        criterion=f"8 roundings of y, {limit:.1e}",
    )  # fmt: skip


def _courses(found: dict[str, runs.Run]) -> str:
    """Factors by which the energies of the samples end above or below their start."""
    ends = {SENTENCE[n]: r.energy[-1] / r.energy[0] for n, r in found.items() if n != "energy-preserving"}
    parts = (
        f"{name} {'grows to' if q > 1 else 'falls to'} {q:.2g} times its start" for name, q in ends.items()
    )
    return ", ".join(parts)


def growth_per_step(name: str, h: float) -> tuple[float, float]:
    """Mean and variance of ln(H_n+1/H_n), by the energy of one step from any state (the problem is linear).

    With S = ΔŴ the quotient is (1 − h/2)² + (h + S)² for Euler-Maruyama, (1 − S²/2)² + (h + S)² for Milstein and
    (1 − (hS + S²)/2)² + (h + S)² for Euler-Heun.
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(80)
    S = np.sqrt(h) * np.clip(nodes, *bounded.truncation_bound(h, 2) * np.array([-1, 1]))
    real = {"euler-maruyama": h / 2 + 0 * S, "milstein": S**2 / 2, "euler-heun": (h * S + S**2) / 2}[name]
    ln, w = np.log((1 - real) ** 2 + (h + S) ** 2), weights / weights.sum()
    mean = float(w @ ln)
    return mean, float(w @ (ln - mean) ** 2)


def _growth(run: runs.Run) -> Statement:
    """The mean of ln H over all samples against the growth that the formula of the scheme has."""
    mean, variance = growth_per_step(run.scheme, run.h)
    logs: Array = np.log(run.energies[-1] / run.energy[0])
    expected, spread = mean * run.steps, np.sqrt(variance * run.steps / logs.size)
    distance = abs(float(np.mean(logs)) - expected) / spread
    return Statement(
        text=f"(ours) The mean of ln H of {SENTENCE[run.scheme]} grows as its formula predicts",
        source="the scheme's step, squared",
        verdict=decide(distance <= 4, distance > 6),
        measured=f"mean of ln(H_N/H_0) over {logs.size} samples {np.mean(logs):.2f}",
        criterion=f"expected {expected:.2f} ± {spread:.2f}; within 4 of these (a false alarm in 16000)",
    )


def _not_suited(found: dict[str, runs.Run]) -> Statement:
    ratios = {SENTENCE[n]: r.energy / r.energy[0] for n, r in found.items() if n != "energy-preserving"}
    left = [bool(r.max() > 2 or r.min() < 0.5) for r in ratios.values()]
    return Statement(
        text="Euler-Maruyama's, Euler-Heun's and Milstein's methods are not appropriate for simulations of the "
        "stochastic oscillator over long time intervals",
        source="§4.1",
        # Over a shorter run than the paper's, small growth says nothing.
        verdict=decide(all(left), not any(left) and found["milstein"].steps >= STEPS),
        measured="; ".join(f"{name}: H/H_0 from {r.min():.2g} to {r.max():.2g}" for name, r in ratios.items()),
        criterion="the energy of the sample leaves the factor 2 around its start",
    )  # fmt: skip


def _inside(y: Array, points: int = 250) -> Array:
    """At most so many of the states that are in the window."""
    seen = y[:, np.max(np.abs(y), axis=0) <= WINDOW]
    return seen[:, :: max(1, -(-seen.shape[1] // points))]


PANELS = {"4.1": long_time, "4.2": convergence}
