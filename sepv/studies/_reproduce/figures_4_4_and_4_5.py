"""§4.3, Figures 4.4 and 4.5: the stochastic mathematical pendulum with two noises."""

from __future__ import annotations

import numpy as np

from sepv.problem import Array
from sepv.studies._picture import Axis
from sepv.studies._reproduce import order, runs
from sepv.studies._reproduce.record import Job, Panel, Results, Size, Statement, decide, series
from sepv.verification._orders.convergence import jackknife_half

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

# A few turns of the pendulum that turns over, and the other's swing still visible.
WINDOW = 15.0

_PARAMETERS = {"p0": 0.2, "q0": 1.0, "c": [1.0, 0.5], "h": H, "T": STEPS * H}


def jobs(size: Size) -> list[Job]:
    """Six long runs, the errors of six schemes, and those of a reference with a fine step."""
    return [*order.jobs(ORDER, size), *order.fine_jobs(FINE, size), *RUNS.jobs(size)]


def long_time(results: Results) -> list[Panel]:
    """Figure 4.4: energy, its zoom, position."""
    found = RUNS.found(results)
    return [_energy(found), _zoom(found["midpoint"], found["energy-preserving"]), _position(found)]


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
        statements=(almost, *_walk(midpoint)),
        description="The energy of the midpoint scheme wanders about its start; that of the energy-preserving scheme "
        "does not move.",
        numbers={
            "steps": midpoint.checkpoints.tolist(),
            "rms energy error of the midpoint scheme": _rms(midpoint).tolist(),
        },
    )


def _rms(run: runs.Run) -> Array:
    return np.sqrt(np.mean((run.energies - run.energy[0]) ** 2, axis=1))


def _walk(run: runs.Run) -> list[Statement]:
    """Whether symplecticity bounds the midpoint scheme's energy error, or it walks: rms over samples against time.

    A symplectic scheme keeps a modified Hamiltonian, but one for each step size: with a random step there is no
    common one. To leading order the energy moves by Δ³g(y) a step, with noise in Δ³: a random walk, rms ∝ √t.

    Only times after the first period count: a bounded error also grows until then, from 0 to its bound.
    """
    n, exponent, error = growth(run)
    text = "This behaviour of the midpoint scheme could result from its symplecticity"
    criterion = (
        "symplecticity with a fixed step bounds the energy error: after the first period exponent 0; a random walk "
        f"has 1/2. Decided after {DOUBLINGS} doublings of the time, where the interval of {1 - WALK_LEVEL:.1%} is on "
        "one side of 1/4"
    )
    if not n.size:
        return [Statement(text, "§4.3", "open", f"t = {run.steps * run.h:g} is too short to tell", criterion)]
    rms = _rms(run)[np.isin(run.checkpoints, n)]
    return [
        Statement(
            text=text,
            source="§4.3",
            verdict=decide(exponent + error < 0.25, exponent - error > 0.25),
            measured=f"over {run.energies.shape[1]} samples the rms energy error grows like t^({exponent:.2f} ± "
            f"{error:.2f}), from {rms[0]:.2g} at t = {n[0] * run.h:g} to {rms[-1]:.2g} at t = {n[-1] * run.h:g}",
            criterion=criterion,
            correction="with a random step the modified Hamiltonian changes from step to step: the energy error is a "
            "random walk, rms of the order h √t, small on [0, 500] and not bounded. Symplecticity does exclude a "
            "drift: the mean of a step's error is of the order h² and a bracket {H, ·}, which averages out",
        )
    ]


# Two-sided level of the interval of an exponent: a run says the wrong thing once in a thousand.
WALK_LEVEL = 1e-3
# A bounded error oscillates: between two times its size may double, which is a slope of 1 over one doubling and of at
# most 1/4 over four.
DOUBLINGS = 4


def growth(run: runs.Run) -> tuple[Array, float, float]:
    """Steps after the first period, the exponent of the rms energy error over them, half its interval at WALK_LEVEL.

    The interval is a jackknife over samples with Student's quantile. No steps where they span fewer than DOUBLINGS.
    """
    from scipy.special import ellipk

    # A pendulum of energy H = 2k² − 1 has the period 4K(k²).
    period = 4 * float(ellipk(0.5 * (run.energy[0] + 1)))
    late = run.checkpoints * run.h >= period
    n, squares = run.checkpoints[late], (run.energies[late] - run.energy[0]) ** 2
    samples = squares.shape[1]
    if n.size <= DOUBLINGS or samples < 3:
        return n[:0], 0.0, np.inf
    x = np.log(n) - np.mean(np.log(n))
    total = squares.sum(axis=1)
    left_out = 0.5 * (x @ np.log((total[:, None] - squares) / (samples - 1))) / (x @ x)
    exponent = 0.5 * float(x @ np.log(total / samples)) / float(x @ x)
    return n, exponent, jackknife_half(left_out, WALK_LEVEL)


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
