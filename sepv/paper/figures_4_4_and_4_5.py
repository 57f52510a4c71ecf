"""§4.3, Figures 4.4 and 4.5: the stochastic mathematical pendulum with two noises."""

from __future__ import annotations

from typing import Any

import numpy as np

from sepv import problems, schemes
from sepv.pictures import TIME_AXIS, Axis, power
from sepv.properties import GROWTH_LEVEL
from sepv.properties import growth_exponent as exponent
from sepv.studies import SLOPE_DOUBLINGS, Growth, growth

from . import judge, order, runs
from .record import Job, Panel, Results, Size, Statement, points, series

PENDULUM_LOSERS = ("euler-maruyama", "euler-heun", "milstein")
PENDULUM_KEEPERS = ("discrete-gradient", "energy-preserving")
PENDULUM_SCHEMES = (*PENDULUM_LOSERS, "midpoint", *PENDULUM_KEEPERS)
# The number of samples; one is drawn. Further samples cost explicit schemes nothing, and the
# midpoint rule little.
PENDULUM_SAMPLES = {"energy-preserving": 1, "discrete-gradient": 1, "midpoint": 32}
PENDULUM_RUNS = runs.LongRuns(
    "4.4", "pendulum", 2.0**-6, 32_000, PENDULUM_SCHEMES, PENDULUM_SAMPLES, others=64
)
NOT_SAID = "(ours) not said in §4.3"
PENDULUM_ORDER = order.Setting(
    "4.5", PENDULUM_RUNS.problem, T=2.0, steps=(32, 64, 128, 256, 512), samples=1000,
    title="Pendulum: order", source="Figure 4.5", place="§4.3, Theorem 3.4",
    chosen=("step sizes 2^-4 to 2^-8", "the exact solution instead of the midpoint scheme with h = 2^-12"),
    same=(("energy-preserving", "discrete-gradient", NOT_SAID, "B is constant and H(p, q) separates"),),
)  # fmt: skip
PENDULUM_FINE = order.Setting(
    "4.5", PENDULUM_RUNS.problem, T=2.0, steps=(128, 512, 1024, 2048, 4096, 8192), samples=256,
    schemes=("midpoint", "milstein"),
    title="Pendulum: what a fine-step reference hides",
    source="Figure 4.5, the paper's own kind of reference", place="§4.3",
)  # fmt: skip

# The mean energy of the midpoint scheme, with the larger steps that show its drift within T = 512.
MEAN_H, MEAN_STEPS, MEAN_PATHS = (2.0**-3, 2.0**-4), 4096, 4000

# The window holds a few turns of a pendulum that turns over, and the bounded swing remains visible.
PENDULUM_WINDOW = 15.0

_PENDULUM_PARAMETERS = {"p0": 0.2, "q0": 1.0, "c": [1.0, 0.5], "h": PENDULUM_RUNS.h}


def jobs(size: Size) -> list[Job]:
    """The jobs: long runs, mean energies of the midpoint scheme, errors at T,
    and errors of a fine-step reference.
    """
    # The number of steps is a power of two, so that each time is half of the next.
    T = max(MEAN_H) * 2 ** (size.steps(MEAN_STEPS).bit_length() - 1)
    given = {"T": T, "paths": size.samples(MEAN_PATHS), **size.given}
    # A batch of thousands of paths costs six times as much as one path.
    cost = T * runs.STEP_SECONDS["midpoint"] * 6
    means = [Job(("4.4", "mean", str(h)), mean_energy, {"h": h, **given}, cost / h) for h in MEAN_H]
    return [
        *order.jobs(PENDULUM_ORDER, size),
        *order.fine_jobs(PENDULUM_FINE, size),
        *PENDULUM_RUNS.jobs(size),
        *means,
    ]


def long_time(results: Results) -> list[Panel]:
    """The panels of Figure 4.4: energy of all schemes, energy of two schemes enlarged, mean energy,
    and position.
    """
    by_scheme = PENDULUM_RUNS.by_scheme(results)
    parameters = _PENDULUM_PARAMETERS | {"T": by_scheme["midpoint"].steps * PENDULUM_RUNS.h}
    mean = _mean({h: results["4.4", "mean", str(h)] for h in MEAN_H})
    return [
        _energy(by_scheme, parameters),
        _zoom(by_scheme, parameters),
        mean,
        _position(by_scheme, parameters),
    ]


def convergence(results: Results) -> list[Panel]:
    """The panels of Figure 4.5: errors against the exact solution,
    and against a scheme with a fine step.
    """
    return [order.panel(PENDULUM_ORDER, results), order.fine_panel(PENDULUM_FINE, results)]


def _energy(by_scheme: dict[str, runs.SampledRun], parameters: dict[str, Any]) -> Panel:
    judged = {n: by_scheme[n] for n in (*PENDULUM_LOSERS, *PENDULUM_KEEPERS)}
    return Panel(
        key="4.4-energy", title="Pendulum: energy above the rest position", source="Figure 4.4, left",
        x=TIME_AXIS, y=Axis("energy H + 1", log=True),
        series=tuple(runs.curve(r, r.energy + 1) for r in by_scheme.values()), parameters=parameters,
        chosen=("H + 1, the energy above the rest position, on a logarithmic axis",),
        statements=tuple(runs.statements(judged, "energy", PENDULUM_KEEPERS, "§4.3")),
        description="The explicit schemes gain energy; midpoint, discrete gradient and energy-preserving scheme "
        "cannot be told from a horizontal line.",
    )  # fmt: skip


def _zoom(by_scheme: dict[str, runs.SampledRun], parameters: dict[str, Any]) -> Panel:
    midpoint = by_scheme["midpoint"]
    moved = float(np.max(np.abs(midpoint.energy - midpoint.energy[0])))
    above = float(midpoint.energy[0] + 1)
    limit = runs.DRIFT_FACTOR * runs.bound(midpoint, "energy")
    almost = Statement(
        "The energy along the midpoint scheme remains almost constant over this long time interval", "§4.3",
        judge.decide(limit < moved / abs(midpoint.energy[0]) and moved < 0.1 * above, moved > 0.5 * above),
        f"it moves by up to {moved:.2g} on this sample, where the energy above rest is {above:.2g}",
        "more than rounding, less than a tenth of the energy above rest (our choice for “almost”)",
    )  # fmt: skip
    rms = np.sqrt(np.mean((midpoint.energies - midpoint.energy[0]) ** 2, axis=1))
    return Panel(
        key="4.4-energy-zoom", title="Pendulum: energy, zoom", source="Figure 4.4, middle",
        x=TIME_AXIS, y=Axis("energy H"), parameters=parameters,
        series=tuple(runs.curve(r, r.energy) for r in (midpoint, by_scheme["energy-preserving"])),
        statements=(almost, _walk(midpoint)),
        description="The energy of the midpoint scheme wanders about its start; that of the energy-preserving scheme "
        "does not move.",
        numbers={
            "steps": midpoint.checkpoints.tolist(),
            "rms energy error of the midpoint scheme": rms.tolist(),
        },
    )  # fmt: skip


def _walk(run: runs.SampledRun) -> Statement:
    """The statement that the midpoint scheme's energy error grows like √t,
    decided by its rms over samples.

    Times in the first period do not count, because there a bounded error also grows, from 0 to its
    bound.
    """
    from scipy.special import ellipk

    # A pendulum of energy H = 2k² − 1 has the period 4K(k²).
    late = run.checkpoints * run.h >= 4 * float(ellipk(0.5 * (run.energy[0] + 1)))
    times, errors = run.checkpoints[late] * run.h, run.energies[late] - run.energy[0]
    verdict: judge.Verdict = "open"
    measured = f"t = {run.steps * run.h:g} is too short to tell"
    if times.size > SLOPE_DOUBLINGS and errors.shape[1] >= 3:
        value, half = exponent(times, errors)
        rms = np.sqrt(np.mean(errors**2, axis=1))
        verdict = judge.decide(value - half > 0.25, value + half < 0.25)
        measured = (
            f"over {errors.shape[1]} samples the rms energy error grows like t^({value:.2f} ± {half:.2f}), from "
            f"{rms[0]:.2g} at t = {times[0]:g} to {rms[-1]:.2g} at t = {times[-1]:g}"
        )
    return Statement(
        "The energy error of the midpoint scheme is not bounded: it walks, as √t", NOT_SAID, verdict, measured,
        "after the first period a bounded error has exponent 0, and a random walk 1/2. Decided after "
        f"{SLOPE_DOUBLINGS} doublings of the time, where the interval of {1 - GROWTH_LEVEL:.1%} is on one side of 1/4",
    )  # fmt: skip


def mean_energy(h: float, T: float, paths: int, seed: int, engine: str) -> Growth:
    """The midpoint scheme's mean energy error against time, over `paths` paths up to time T."""
    return growth(schemes.midpoint, problems.pendulum(), h=h, T=T, paths=paths, seed=seed, engine=engine)


def _mean(growth_by_step: dict[float, Growth]) -> Panel:
    """The panel of E[H] along the midpoint scheme, whose small drift is compared with theory for
    symplectic maps.
    """
    curves, rates, agree, ends = [], [], [], []
    for h, row in growth_by_step.items():
        name, theory = f"h = {power(h, 2)}", row.derived
        assert theory is not None
        mean, rms = theory.at(row.times)
        curves += [
            points(f"mean, {name}", row.times, np.abs(row.mean), "midpoint", group=f"mean, {name}"),
            series(f"theory, mean, {name}", row.times, mean, group=f"mean, {name}"),
            points(f"rms, {name}", row.times, row.rms, "midpoint", group=f"rms, {name}"),
            series(f"theory, rms, {name}", row.times, rms, group=f"rms, {name}"),
        ]
        rate, half = row.drift
        agree.append(abs(rate - theory.drift) <= half)
        rates.append(f"{rate:.2g} ± {half:.1g} at {name}, where theory has {theory.drift:.2g}")
        last = zip(row.times[-5::2], row.mean[-5::2], row.error[-5::2], strict=True)
        ends.append(
            f"{name}: E[H] − H(y0) = " + ", ".join(f"{m:.3g} ± {e:.1g} at t = {t:g}" for t, m, e in last)
        )
    coarse, paths = growth_by_step[max(growth_by_step)], next(iter(growth_by_step.values())).paths
    statements = (
        Statement("This behaviour of the midpoint scheme could result from its symplecticity", "§4.3",
                  judge.decide(all(agree) and coarse.drifts, not all(agree)),
                  f"over {paths} paths the mean of H drifts by {', and by '.join(rates)}, per unit of time",
                  "a symplectic map keeps area, and the energy then drifts by (1/T) d(T D)/dH alone, of order h², "
                  f"where D is its diffusion and T the period; the intervals of {1 - GROWTH_LEVEL:.1%} contain it, "
                  "and that of the larger step excludes 0"),
        Statement("The mean energy of the midpoint scheme drifts", NOT_SAID, judge.decide(coarse.drifts, False),
                  "; ".join(ends) + " (± one standard error)",
                  f"the interval of {1 - GROWTH_LEVEL:.1%} of the drift between T/4 and T excludes 0; by theory the "
                  "drift is of the order h² t"),
    )  # fmt: skip
    return Panel(
        key="4.4-energy-mean", title="Pendulum: mean energy of the midpoint scheme",
        source="Figure 4.4, over many paths",
        x=Axis("time t", log=True), y=Axis("mean and rms of H − H(y0)", log=True), series=tuple(curves),
        parameters={**_PENDULUM_PARAMETERS, "h": list(growth_by_step), "T": float(coarse.times[-1]), "paths": paths},
        chosen=("larger steps than the figure's: the drift falls as h², the walk that hides it as h",),
        statements=statements,
        description="The rms grows along √t. The mean is smaller: it starts from an offset and grows in proportion "
        "to t. The curves of theory lie on both.",
        numbers={
            f"{h:g}": {
                "t": r.times.tolist(), "mean": r.mean.tolist(), "error": r.error.tolist(), "rms": r.rms.tolist(),
            }
            for h, r in growth_by_step.items()
        },
    )  # fmt: skip


def _position(by_scheme: dict[str, runs.SampledRun], parameters: dict[str, Any]) -> Panel:
    shown, others = ("energy-preserving", "euler-heun"), ("discrete-gradient", "midpoint")
    # A pendulum that cannot turn over stays within |q| ≤ arccos(−H), Remark 3.5.
    reach = float(np.arccos(-by_scheme[shown[0]].energy[0]))
    largest = {n: float(np.max(np.abs(r.y[1]))) for n, r in by_scheme.items()}
    (ours, heun), rest = (largest[n] for n in shown), [largest[n] for n in others]
    stays = ours <= reach * (1 + 1e-10)
    statements = (
        Statement("A good long time stability of the proposed scheme can be observed, which Euler-Heun's method does "
                  "not have", "§4.3", judge.decide(stays and heun > np.pi, not stays),
                  f"largest |q|: {ours:.4f} and {heun:.3g}; arccos(−H) = {reach:.4f}",
                  "within arccos(−H) for the one; the other turns over, |q| > π"),
        Statement("A good long time stability of the discrete gradient and the midpoint methods is also observed",
                  "§4.3", judge.at_most(max(rest), 1.1 * reach, np.pi),
                  "largest |q|: " + " and ".join(f"{q:.4f}" for q in rest),
                  "within 1.1 arccos(−H): the midpoint scheme keeps the energy almost only"),
    )  # fmt: skip
    return Panel(
        key="4.4-position", title="Pendulum: position", source="Figure 4.4, right",
        x=TIME_AXIS, y=Axis("angle q in radians"), window=PENDULUM_WINDOW,
        series=tuple(series(n, by_scheme[n].t, by_scheme[n].y[1], n) for n in shown), parameters=parameters,
        chosen=(f"|q| ≤ {PENDULUM_WINDOW:g}; the angle of Euler-Heun goes on to {heun:.0f}",), statements=statements,
        description="The angle of the energy-preserving scheme oscillates in a constant band; the pendulum of "
        "Euler-Heun turns over and its angle wanders off.",
    )  # fmt: skip
