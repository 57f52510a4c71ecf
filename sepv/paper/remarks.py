"""Remarks 3.4 and 3.5, and "one does not really need truncated random variables" of §4.1."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from sepv import problems
from sepv.core.newton import Status
from sepv.exact import exact_flow
from sepv.law import Run
from sepv.pictures import Axis, power
from sepv.problem import Array, Problem
from sepv.problems import structure
from sepv.properties import StrongErrors, local_errors
from sepv.properties import mean_square_slope as slope
from sepv.record import EPS
from sepv.schemes import continued
from sepv.schemes import energy_preserving as SCHEME
from sepv.simulate import Ensemble, ensemble, truncate, wiener

from . import judge
from .order import SLOPE_ALPHA
from .record import Job, Panel, Results, Size, Statement, points, rms_points
from .runs import coarsened, errors

# With this k of Remark 2.1 no increment of the order panel is clipped; a clipped one would add an
# error of its own.
UNCLIPPED_K = 4
REMARK_STEPS, REMARK_SAMPLES = (32, 64, 128, 256), 1000
# The end time, the number of paths and the step sizes for Lotka-Volterra: by this time every path
# has a refused step.
LOST_T, LOST_PATHS, LOST_H = 512.0, 48, (2.0**-7, 2.0**-8, 2.0**-9)
REMARK_TIMES = tuple(2.0**k for k in range(10))
SENTENCE_OF_SET = {
    "pendulum": "the set |p| ≤ √(p0² + 4) contains the numerical trajectories of the pendulum",
    "rigid-body": "the convex hull of the ellipsoid H(y) = H(y0) contains those of the rigid body",
}
SET_STEPS, SET_H, SET_PATHS = 512, 2.0**-6, 64
CLIP_PROBLEMS, CLIP_T, CLIP_STEPS = (
    ("harmonic-oscillator", "pendulum", "lotka-volterra"),
    1.0,
    (4, 8, 16, 32, 64, 128),
)


def sublinear() -> Problem:
    """A problem with H = (1 + p²)^¾ + (1 + q²)^¾: H and f ~ |y|^½ are unbounded,
    all derivatives of f are bounded.
    """

    def root(x: Array) -> Array:
        return np.sqrt(np.sqrt(1 + x * x))

    def mean(y0: Array, y1: Array) -> Array:
        # (b³ − a³)/(y1 − y0) with b⁴ − a⁴ = y1² − y0², without cancellation. No quadrature rule is
        # exact for this mean.
        a, b = root(y0), root(y1)
        return (y0 + y1) * (a * a + a * b + b * b) / ((a + b) * (a * a + b * b))

    return Problem(
        dimension=2, structure=structure, hamiltonian=lambda y: root(y[0]) ** 3 + root(y[1]) ** 3, noise=(1.0,),
        mean_gradient=mean, initial=(0.5, 1.0), name="sublinear",
    )  # fmt: skip


def sublinear_errors(samples: int, seed: int) -> StrongErrors:
    """The errors at T = 1 of (2.1) on the problem `sublinear`;
    all step sizes have the same Wiener paths.
    """
    scheme = replace(SCHEME, truncation=UNCLIPPED_K)
    return errors(scheme, sublinear(), T=1.0, steps=REMARK_STEPS, samples=samples, seed=seed)


def sublinear_step() -> list[float]:
    """The slopes against h of |E[y1 − φ]| and (E|y1 − φ|²)^½ after one step of (2.1),
    where φ is the exact solution.
    """
    errors = local_errors(SCHEME, sublinear(), Run())
    # The three smallest steps with errors well above rounding; these errors are 1e-6 and less.
    usable = [n for n, e in enumerate(errors.mean) if e > 1e4 * EPS][-3:]
    return [judge.slope(errors.h[usable], e[usable]) for e in (errors.mean, errors.rms)]


def casimir_loss(h: float, steps: int, paths: int, seed: int, engine: str) -> dict[str, Any]:
    """Measure by how much (2.1) changes the Casimir C along paths of Lotka-Volterra,
    and which steps it refuses.

    The result has the mean of C(y) − C(y0) at `REMARK_TIMES` over the paths without a refused step
    so far, the times of the refused steps, and the number of refused steps for which
    `sepv.schemes.continued` finds a solution.
    """
    problem = problems.lotka_volterra()
    assert problem.nambu is not None
    times = [t for t in REMARK_TIMES if t <= steps * h]
    sample = ensemble(SCHEME, problem, h=h, steps=steps, paths=paths, seed=seed, times=times, engine=engine)
    before = float(problem.nambu.casimir(np.array(problem.initial)))
    failed = np.where(sample.failed_step < 0, steps, sample.failed_step) * h
    means = []
    for k, t in enumerate(times):
        lost = problem.nambu.casimir(sample.states[:, k, failed >= t]) - before
        means.append(float(np.mean(lost)) if lost.size else np.nan)
    return {
        "T": steps * h,
        "t": times,
        "mean": means,
        "failed": sorted(float(t) for t, s in zip(failed, sample.failed_step, strict=True) if s >= 0),
        "solvable": _solvable(sample, problem, h, steps, seed),
    }


def _solvable(sample: Ensemble, problem: Problem, h: float, steps: int, seed: int) -> int:
    """The number of steps that the solver refused, but that it solves if the solution is followed
    from Δ = 0.
    """
    count, follow = 0, continued(SCHEME).solve
    assert follow is not None
    for path in np.flatnonzero(sample.failed_step >= 0):
        whole = wiener.increments(seed, T=steps * h, steps=steps, noises=1, paths=range(path, path + 1))
        dW = truncate(whole[sample.failed_step[path]], h, SCHEME.truncation)
        count += int(follow(problem, sample.y[:, [path]], h, dW).status[0] == Status.CONVERGED)
    return count


def furthest(problem: str, seed: int, engine: str) -> dict[str, float]:
    """The largest |p|/√(p0² + 4) (pendulum) or √(H(y)/H(y0)) along paths:
    1 is the boundary of Remark 3.5's set.

    The result has this number for paths of (2.1), and for exact solutions with the same noise.
    """
    system = problems.by_name(problem)
    start = np.array(system.initial)
    times = np.arange(1, SET_STEPS + 1) * SET_H
    raw = wiener.increments(seed, T=times[-1], steps=SET_STEPS, noises=system.noises, paths=range(SET_PATHS))
    sample = ensemble(SCHEME, system, h=SET_H, steps=SET_STEPS, dW=raw, times=times, engine=engine)
    theta = times[:, None] + np.einsum("j,njm->nm", system.c, np.cumsum(raw, axis=0))
    exact = exact_flow(system, theta.ravel()).y

    def share(y: Array) -> float:
        if problem == "pendulum":
            return float(np.max(np.abs(y[0])) / np.sqrt(start[0] ** 2 + 4))
        return float(np.sqrt(np.max(system.hamiltonian(y)) / system.hamiltonian(start)))

    scheme = sample.states.reshape(start.size, -1)
    return {"(2.1)": share(scheme), "exact": share(exact)}


def failing(problem: str, truncated: bool, samples: int, seed: int, engine: str) -> list[float]:
    """The fraction of samples with a step that is not solved up to T = 1,
    with or without truncation of the noise.
    """
    system, k, shares = problems.by_name(problem), 2 if truncated else None, []
    fine = wiener.increments(seed, T=CLIP_T, steps=CLIP_STEPS[-1], noises=system.noises, paths=range(samples))
    for count, raw in coarsened(fine, CLIP_STEPS):
        ends = ensemble(SCHEME, system, h=CLIP_T / count, steps=count, dW=raw, truncation=k, engine=engine)
        shares.append(float(np.mean(ends.status != 0)))
    return shares


def jobs(size: Size) -> list[Job]:
    """The jobs: order if H is unbounded, Casimir of Lotka-Volterra,
    failed steps with and without truncation.
    """
    samples, sublinear = (
        size.samples(REMARK_SAMPLES),
        {"samples": size.samples(REMARK_SAMPLES), "seed": size.seed},
    )
    lost = {
        h: {"h": h, "steps": size.steps(round(LOST_T / h)), "paths": LOST_PATHS, **size.given} for h in LOST_H
    }
    clip = {
        (n, t): {"problem": n, "truncated": t, "samples": samples}
        for n in CLIP_PROBLEMS
        for t in (True, False)
    }
    return [
        Job(("theory", "sublinear"), sublinear_errors, sublinear, 2.0),
        Job(("theory", "sublinear step"), sublinear_step, {}, 0.5),
        *(Job(("theory", "lost", str(h)), casimir_loss, arguments, 2.0) for h, arguments in lost.items()),
        *(
            Job(("theory", "sets", name), furthest, {"problem": name, **size.given}, 2.0)
            for name in SENTENCE_OF_SET
        ),
        *(
            Job(("theory", "clip", n, str(t)), failing, {**a, **size.given}, 1.0)
            for (n, t), a in clip.items()
        ),
    ]


def panels(results: Results) -> list[Panel]:
    """The panels: one for each remark."""
    sets = [_in_the_set(name, results["theory", "sets", name]) for name in SENTENCE_OF_SET]
    lost = _lost(results)
    return [
        _sublinear(results["theory", "sublinear"], results["theory", "sublinear step"]),
        replace(lost, statements=(*lost.statements, *sets)),
        _clipped(results),
    ]


def _sublinear(errors: StrongErrors, local: list[float]) -> Panel:
    measured = slope(errors, SLOPE_ALPHA)
    order = judge.interval_near(measured.low, measured.high, 1, 0.25)
    statement = Statement(
        "The results extend to cases where H is not bounded, f is sublinear and its derivatives are bounded",
        "Remark 3.4",
        judge.every(order, judge.above(local[0], 1.75, 1.5), judge.above(local[1], 1.25, 1.0)),
        f"H = (1 + p²)^¾ + (1 + q²)^¾: slope {measured.value:.3f} in [{measured.low:.3f}, {measured.high:.3f}] of "
        f"errors at T = 1; mean and mean-square error of one step have slopes {local[0]:.2f} and {local[1]:.2f}",
        "the 99 % interval lies within 1 ± 1/4, the others above 7/4 and 5/4",
    )  # fmt: skip
    return Panel(
        key="theory-unbounded-hamiltonian", title="A Hamiltonian that is not bounded", source="Remark 3.4",
        series=(rms_points(SCHEME.name, 1.0 / np.array(errors.steps), errors.squared, SCHEME.name),),
        parameters={"H": "(1 + p²)^¾ + (1 + q²)^¾", "c": 1.0, "y0": [0.5, 1.0], "T": 1.0, "k": UNCLIPPED_K},
        chosen=(
            f"k = {UNCLIPPED_K}: a clipped increment is an error of its own, "
            "which a thousand samples do not average out",
        ),
        slopes=(0.5, 1.0), statements=(statement,), description="Mean-square errors fall along slope one.",
        numbers={"rms": errors.rms().tolist(), "slope": measured.value, "failures": list(errors.failures)},
    )  # fmt: skip


def _in_the_set(name: str, reached: dict[str, float]) -> Statement:
    # (2.1) keeps H up to a relative error of 8 eps √N, and `reached` has square roots of H/H(y0).
    limit = 1 + 8 * EPS * SET_STEPS**0.5
    return Statement(
        SENTENCE_OF_SET[name], "Remark 3.5", judge.at_most(max(reached.values()), limit, limit + 1e-3),
        f"(2.1) goes {reached['(2.1)']:.6f} of the way to the boundary, exact solutions {reached['exact']:.6f} "
        f"({SET_PATHS} paths, t ≤ {SET_STEPS * SET_H:g})",
        "at most 1, and the rounding of H",
    )  # fmt: skip


def _lost(results: Results) -> Panel:
    losses = {h: results["theory", "lost", str(h)] for h in LOST_H}
    failed = {h: len(f["failed"]) for h, f in losses.items()}
    h0, T = 2.0**-8, losses[2.0**-8]["T"]  # the paper's step
    at = {t: m for t, m in zip(losses[h0]["t"], losses[h0]["mean"], strict=True) if t in (1.0, 8.0, 64.0)}

    def fate(h: float) -> str:
        text = f"h = 2^{np.log2(h):.0f}: a step of {failed[h]} of {LOST_PATHS} paths is refused by t = {T:g}"
        if not failed[h]:
            return text
        return (
            f"{text}, the first at t = {min(losses[h]['failed']):.0f}, where continuation solves "
            f"{losses[h]['solvable']} of these steps"
        )

    statement = Statement(
        "(ours) Paths of (2.1) for Lotka-Volterra stay where their steps have solutions, at the paper's h = 2^-8",
        "Remark 3.5",
        judge.decide(T >= LOST_T and not failed[h0], failed[h0] - losses[h0]["solvable"] > LOST_PATHS // 2),
        "; ".join(fate(h) for h in LOST_H) + "; mean of C(y) − C(y0) at h = 2^-8: "
        + ", ".join(f"{v:.2g} at t = {t:g}" for t, v in at.items()),
        f"no step is refused by t = {LOST_T:g}; refuted where more than half of the paths come to a step of which "
        "continuation from Δ = 0 finds no solution either",
        "the Casimir ln y1 + bd ln y2 − d ln y3, which keeps the exact solution in a compact set, is lost steadily by "
        "(2.1)",
    )  # fmt: skip
    return Panel(
        key="theory-lotka-volterra-casimir", title="Lotka-Volterra: the Casimir that (2.1) loses", source="Remark 3.5",
        x=Axis("time t", log=True), y=Axis("mean of C(y0) − C(y)", log=True),
        series=tuple(
            points(f"h = {power(h, 2)}", f["t"], -np.array(f["mean"])) for h, f in losses.items()
        ),
        parameters={"c": 0.5, "y0": [1.0, 1.9, 0.5], "paths": LOST_PATHS, "T": T},
        chosen=(f"means over the paths that are alive, of {LOST_PATHS}",), statements=(statement,),
        description="The mean loss grows in proportion to time, and falls with the step size.",
        numbers={f"{h:g}": f for h, f in losses.items()},
    )  # fmt: skip


def _clipped(results: Results) -> Panel:
    h = CLIP_T / np.array(CLIP_STEPS)
    shares = {
        f"{name}, {'k = 2' if k else 'not truncated'}": results["theory", "clip", name, str(k)]
        for name in CLIP_PROBLEMS
        for k in (True, False)
    }
    free = shares["harmonic-oscillator, not truncated"]
    none = f"no step fails at h = {h[0]:g} to {h[-1]:g} without truncation"
    statement = Statement(
        "For the oscillator one does not really need truncated random variables: the method is well defined", "§4.1",
        judge.at_most(max(free), 0, 0), f"shares of failed samples {free}" if any(free) else none,
        "no sample has a step that fails",
    )  # fmt: skip
    return Panel(
        key="theory-truncation", title="Samples with a step that fails, with and without truncation",
        source="Remark 2.1, §4.1", y=Axis("share of samples"),
        series=tuple(points(name, h, share) for name, share in shares.items()),
        parameters={"T": CLIP_T, "N": list(CLIP_STEPS)}, statements=(statement,), numbers=shares,
        description="Oscillator and pendulum never fail. Lotka-Volterra fails at large steps with and without "
        "truncation.",
    )  # fmt: skip
