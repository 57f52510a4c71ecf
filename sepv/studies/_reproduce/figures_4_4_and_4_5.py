"""§4.3, Figures 4.4 and 4.5: the stochastic mathematical pendulum with two noises."""

from __future__ import annotations

import numpy as np

from sepv import problems, schemes
from sepv.studies._energy_growth import DOUBLINGS, LEVEL, Growth, exponent, growth
from sepv.studies._picture import Axis
from sepv.studies._reproduce import order, runs
from sepv.studies._reproduce.record import Job, Panel, Results, Size, Statement, decide, series

PROBLEM = "pendulum"
STEPS, H = 32_000, 2.0**-6
LOSE = ("euler-maruyama", "euler-heun", "milstein")
KEEP = ("discrete-gradient", "energy-preserving")
SHOWN = (*LOSE, "midpoint", *KEEP)
# Samples beside the one that is shown cost an explicit scheme nothing, and the midpoint rule little.
SAMPLES = {"energy-preserving": 1, "discrete-gradient": 1, "midpoint": 32}
RUNS = runs.LongRuns("4.4", PROBLEM, H, STEPS, SHOWN, SAMPLES, others=64)
ORDER = order.Setting("4.5", PROBLEM, T=2.0, steps=(32, 64, 128, 256, 512), samples=1000)
FINE = order.Setting(
    "4.5",
    PROBLEM,
    T=2.0,
    steps=(128, 512, 1024, 2048, 4096, 8192),
    samples=256,
    schemes=("midpoint", "milstein"),
)

# The mean energy of the midpoint scheme, with the larger steps that show its drift within T = 512.
MEAN_H, MEAN_STEPS, MEAN_PATHS = (2.0**-3, 2.0**-4), 4096, 4000

# A few turns of the pendulum that turns over, and the other's swing still visible.
WINDOW = 15.0

_PARAMETERS = {"p0": 0.2, "q0": 1.0, "c": [1.0, 0.5], "h": H, "T": STEPS * H}


def jobs(size: Size) -> list[Job]:
    """Six long runs, the mean energy of one, the errors of six schemes, and those of a reference with a fine step."""
    # A power of two of steps: the times are halves of each other.
    T = max(MEAN_H) * 2 ** (size.steps(MEAN_STEPS).bit_length() - 1)
    means = [
        Job(
            ("4.4", "mean", str(h)),
            mean_energy,
            {"h": h, "T": T, "paths": size.samples(MEAN_PATHS), **size.given},
            T / h * runs.COST["midpoint"] * 6,  # a batch of thousands costs six times one path
        )
        for h in MEAN_H
    ]
    return [*order.jobs(ORDER, size), *order.fine_jobs(FINE, size), *RUNS.jobs(size), *means]


def long_time(results: Results) -> list[Panel]:
    """Figure 4.4: energy, its zoom, position."""
    found = RUNS.found(results)
    zoom = _zoom(found["midpoint"], found["energy-preserving"])
    mean = _mean({h: results["4.4", "mean", str(h)] for h in MEAN_H})
    return [_energy(found), zoom, mean, _position(found)]


def convergence(results: Results) -> list[Panel]:
    """Figure 4.5, and the bias of a reference with a fine step."""
    why = "(ours) not said in §4.3", "B is constant and H(p, q) separates"
    return [
        order.panel(
            ORDER,
            results,
            title="Pendulum: order",
            source="Figure 4.5",
            place="§4.3, Theorem 3.4",
            chosen=(
                "step sizes 2^-4 to 2^-8",
                "the exact solution instead of the midpoint scheme with h = 2^-12",
            ),
            same=[("energy-preserving", "discrete-gradient", *why)],
        ),
        order.fine_panel(
            FINE, results, source="Figure 4.5, the paper's own kind of reference", stated="§4.3"
        ),
    ]


def _energy(found: dict[str, runs.Run]) -> Panel:
    judged = {n: found[n] for n in (*LOSE, *KEEP)}
    return Panel(
        key="4.4-energy",
        title="Pendulum: energy",
        source="Figure 4.4, left",
        x=Axis("time t"),
        y=Axis("energy H + 1", log=True),
        series=tuple(runs.curve(r, r.energy + 1) for r in found.values()),
        parameters=_used(found),
        chosen=("H + 1, the energy above the rest position, on a logarithmic axis",),
        statements=tuple(runs.statements(judged, "energy", KEEP, "§4.3")),
        description="The explicit schemes gain energy; midpoint, discrete gradient and energy-preserving scheme "
        "cannot be told from a horizontal line.",
    )


def _zoom(midpoint: runs.Run, preserving: runs.Run) -> Panel:
    moved = float(np.max(np.abs(midpoint.energy - midpoint.energy[0])))
    above = float(midpoint.energy[0] + 1)
    limit = runs.FAR * runs.bound(midpoint, "energy")
    almost = Statement(
        text="The energy along the midpoint scheme remains almost constant over this long time interval",
        source="§4.3",
        verdict=decide(limit < moved / abs(midpoint.energy[0]) and moved < 0.1 * above, moved > 0.5 * above),
        measured=f"it moves by up to {moved:.2g} on this sample, where the energy above rest is {above:.2g}",
        criterion="more than rounding, less than a tenth of the energy above rest (our choice for “almost”)",
    )
    return Panel(
        key="4.4-energy-zoom",
        title="Pendulum: energy, zoom",
        source="Figure 4.4, middle",
        x=Axis("time t"),
        y=Axis("energy H"),
        series=tuple(runs.curve(r, r.energy) for r in (midpoint, preserving)),
        parameters=_used({"midpoint": midpoint}),
        statements=(almost, _walk(midpoint)),
        description="The energy of the midpoint scheme wanders about its start; that of the energy-preserving scheme "
        "does not move.",
        numbers={
            "steps": midpoint.checkpoints.tolist(),
            "rms energy error of the midpoint scheme": np.sqrt(
                np.mean((midpoint.energies - midpoint.energy[0]) ** 2, axis=1)
            ).tolist(),
        },
    )


def _walk(run: runs.Run) -> Statement:
    """Whether the midpoint scheme's energy error walks or is bounded: its rms over samples against time.

    Only times after the first period count: a bounded error also grows until then, from 0 to its bound.
    """
    from scipy.special import ellipk

    # A pendulum of energy H = 2k² − 1 has the period 4K(k²).
    late = run.checkpoints * run.h >= 4 * float(ellipk(0.5 * (run.energy[0] + 1)))
    times, errors = run.checkpoints[late] * run.h, run.energies[late] - run.energy[0]
    text = "The energy error of the midpoint scheme is not bounded: it walks, as √t"
    source = "(ours) not said in §4.3"
    criterion = (
        "after the first period a bounded error has exponent 0, and a random walk 1/2. Decided after "
        f"{DOUBLINGS} doublings of the time, where the interval of {1 - LEVEL:.1%} is on one side of 1/4"
    )
    if times.size <= DOUBLINGS or errors.shape[1] < 3:
        return Statement(text, source, "open", f"t = {run.steps * run.h:g} is too short to tell", criterion)
    value, half = exponent(times, errors)
    rms = np.sqrt(np.mean(errors**2, axis=1))
    return Statement(
        text=text,
        source=source,
        verdict=decide(value - half > 0.25, value + half < 0.25),
        measured=f"over {errors.shape[1]} samples the rms energy error grows like t^({value:.2f} ± {half:.2f}), from "
        f"{rms[0]:.2g} at t = {times[0]:g} to {rms[-1]:.2g} at t = {times[-1]:g}",
        criterion=criterion,
    )


def mean_energy(h: float, T: float, paths: int, seed: int, engine: str) -> Growth:
    """The midpoint scheme's energy error over `paths` paths."""
    return growth(schemes.midpoint, problems.pendulum(), h=h, T=T, paths=paths, seed=seed, engine=engine)


def _mean(found: dict[float, Growth]) -> Panel:
    """E[H] beside the walk: the drift that symplecticity leaves."""
    curves, rates, agree = [], [], []
    for h, row in found.items():
        name = f"h = 2^{np.log2(h):.0f}"
        theory = row.derived
        assert theory is not None
        curves += [
            series(f"mean, {name}", row.times, np.abs(row.mean), scheme="midpoint", style="both"),
            series(f"rms, {name}", row.times, row.rms, scheme="midpoint", style="both"),
            *(
                series(f"theory, {kind}, {name}", row.times, values)
                for kind, values in zip(("mean", "rms"), theory.at(row.times), strict=True)
            ),
        ]
        rate, half = row.drift
        agree.append(abs(rate - theory.drift) <= half)
        rates.append(f"{rate:.2g} ± {half:.1g} at {name}, where theory has {theory.drift:.2g}")
    coarse, paths = found[max(found)], next(iter(found.values())).paths
    symplectic = Statement(
        text="This behaviour of the midpoint scheme could result from its symplecticity",
        source="§4.3",
        verdict=decide(all(agree) and coarse.drifts, not all(agree)),
        measured=f"over {paths} paths the mean of H drifts by {', and by '.join(rates)}, per unit of time",
        criterion="a symplectic map keeps area, and the energy then drifts by (1/T) d(T D)/dH alone, of order h², "
        f"where D is its diffusion and T the period; the intervals of {1 - LEVEL:.1%} contain it, and that of the "
        "larger step excludes 0",
    )
    drift = Statement(
        text="The mean energy of the midpoint scheme drifts",
        source="(ours) not said in §4.3",
        verdict=decide(coarse.drifts, False),
        measured="; ".join(
            f"h = 2^{np.log2(h):.0f}: E[H] − H(y0) = "
            + ", ".join(
                f"{m:.3g} ± {e:.1g} at t = {t:g}"
                for t, m, e in zip(row.times[-5::2], row.mean[-5::2], row.error[-5::2], strict=True)
            )
            for h, row in found.items()
        )
        + " (± one standard error)",
        criterion=f"the interval of {1 - LEVEL:.1%} of the drift between T/4 and T excludes 0; by theory the drift "
        "is of the order h² t",
    )
    return Panel(
        key="4.4-energy-mean",
        title="Pendulum: mean energy of the midpoint scheme",
        source="Figure 4.4, over many paths",
        x=Axis("time t", log=True),
        y=Axis("mean and rms of H − H(y0)", log=True),
        series=tuple(curves),
        parameters={**_PARAMETERS, "h": list(found), "T": float(coarse.times[-1]), "paths": paths},
        chosen=("larger steps than the figure's: the drift falls as h², the walk that hides it as h",),
        statements=(symplectic, drift),
        description="The rms grows along √t. The mean is smaller: it starts from an offset and grows in proportion "
        "to t. The curves of theory lie on both.",
        numbers={
            f"{h:g}": {
                "t": r.times.tolist(),
                "mean": r.mean.tolist(),
                "error": r.error.tolist(),
                "rms": r.rms.tolist(),
            }
            for h, r in found.items()
        },
    )


def _position(found: dict[str, runs.Run]) -> Panel:
    shown = ("energy-preserving", "euler-heun")
    # A pendulum that cannot turn over stays within |q| ≤ arccos(−H), Remark 3.5.
    reach = float(np.arccos(-found[shown[0]].energy[0]))
    largest = {n: float(np.max(np.abs(r.y[1]))) for n, r in found.items()}
    text = "A good long time stability of the proposed scheme can be observed, which Euler-Heun's method does not have"
    stays = largest["energy-preserving"] <= reach * (1 + 1e-10)
    stable = Statement(
        text=text,
        source="§4.3",
        verdict=decide(stays and largest["euler-heun"] > np.pi, not stays),
        measured=f"largest |q|: {largest['energy-preserving']:.4f} and {largest['euler-heun']:.3g}; "
        f"arccos(−H) = {reach:.4f}",
        criterion="within arccos(−H) for the one; the other turns over, |q| > π",
    )
    others = ("discrete-gradient", "midpoint")
    also = Statement(
        text="A good long time stability of the discrete gradient and the midpoint methods is also observed",
        source="§4.3",
        verdict=decide(
            all(largest[n] <= 1.1 * reach for n in others), any(largest[n] > np.pi for n in others)
        ),
        measured="largest |q|: " + " and ".join(f"{largest[n]:.4f}" for n in others),
        criterion="within 1.1 arccos(−H): the midpoint scheme keeps the energy almost only",
    )
    return Panel(
        key="4.4-position",
        title="Pendulum: position",
        source="Figure 4.4, right",
        x=Axis("time t"),
        y=Axis("angle q in radians"),
        series=tuple(series(n, found[n].t, found[n].y[1], scheme=n) for n in shown),
        parameters=_used(found),
        chosen=(f"|q| ≤ {WINDOW:g}; the angle of Euler-Heun goes on to {largest['euler-heun']:.0f}",),
        window=WINDOW,
        statements=(stable, also),
        description="The angle of the energy-preserving scheme oscillates in a constant band; the pendulum of "
        "Euler-Heun turns over and its angle wanders off.",
    )


def _used(found: dict[str, runs.Run]) -> dict[str, object]:
    return {**_PARAMETERS, "T": next(iter(found.values())).steps * H}


PANELS = {"4.4": long_time, "4.5": convergence}
