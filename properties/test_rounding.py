"""Brouwer's law: over many steps an exactly energy-preserving scheme drifts like the random walk of rounding.

A solver stopped at a tolerance leaves a residual of one sign: its energy drifts linearly.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from sepv.reference.problem import exact_problem

from sepv import problems, wiener
from sepv.candidate import guarded
from sepv.given import describe, problems_of, reach
from sepv.implicit import Status
from sepv.law import Effort, Finding, Law, Verdict, require
from sepv.problem import Problem
from sepv.scheme import Scheme
from sepv.simulation import advance
from sepv.tolerance import energy_ulp, rounding_walk

PATHS = 32
# (problem, h, steps): two long runs, and large steps, where a solver that stops early shows.
RUNS = (("rigid-body", 0.01, 2048), ("pendulum", 0.01, 2048), ("rigid-body", 0.125, 256))
# The same for schemes for Nambu systems.
NAMBU_RUNS = (RUNS[0], ("lotka-volterra", 2.0**-8, 1024), RUNS[2])
# And for several structures.
SEVERAL_RUNS = (("commuting-rotations", 0.01, 2048), ("commuting-oscillators", 0.01, 512))
FIRST = 32  # the first checkpoint; then doubled
# How many times √n of the predicted rounding of a step (`sepv.tolerance`). The core is at 1, where 32 paths measure a
# root mean square to 12 %; the rest is room for other orders of operations: a hundred roundings of y a step. A
# residual of 1e-12 with one sign reaches it after a few hundred steps.
ALLOWED = 10.0
# Paths that explode: squares of defects must still be numbers, and no rounding is an excuse there.
BEYOND, EXPLODED = 1e150, 1e100


def run(law: Law, scheme: Scheme, effort: Effort) -> Finding:
    """rms energy defect after n steps, in ulp of H over √n, at its largest; and how it grows."""
    rows, lines, broken, checks = [(0.0, 1.0)], [], [], 0
    for problem, h, steps in runs_for(scheme):
        name = problem.name
        defects, predicted = energy_walk(scheme, problem, h, steps, effort.seed)
        alive = np.isfinite(defects[-1])
        if alive.sum() < PATHS // 2:
            broken.append(f"{name}, h = {h:g}: {PATHS - alive.sum()} of {PATHS} paths failed")
            continue
        checks += int(alive.sum())
        n = FIRST * 2.0 ** np.arange(len(defects))
        rms = np.sqrt(np.mean(defects[:, alive] ** 2, axis=1))
        last = defects[-1, alive]
        bias = float(np.mean(last) / (np.std(last) / np.sqrt(last.size) + 1e-300))
        growth = float(np.polyfit(np.log(n), np.log(rms + 1e-300), 1)[0])
        allowed = ALLOWED * predicted + scheme.solver_tolerance / np.finfo(np.float64).eps * np.sqrt(steps)
        rows.append((float(np.max(rms / np.sqrt(n))), float(allowed)))
        failed = "" if alive.all() else f", {PATHS - alive.sum()} paths failed"
        lines.append(
            f"{name}, h = {h:g}, {steps} steps: at most {rows[-1][0]:.3g} ulp of H per √n, predicted {predicted:.3g}; "
            f"growth n^{growth:.2f}, mean at the end {bias:+.1f} standard errors{failed}"
        )
    worst = max(rows, key=lambda row: row[0] / row[1])
    verdict = Verdict.ERROR if broken else Verdict.HOLDS
    return law.finding(
        verdict if worst[0] <= worst[1] else Verdict.VIOLATED,
        defect=worst[0],
        bound=worst[1],
        checks=checks,
        message="\n".join(lines + broken),
        witness={"seed": effort.seed, "paths": PATHS},
        replay=f"--law {law.name} --seed {effort.seed}",
    )


def runs_for(scheme: Scheme) -> list[tuple[Problem, float, int]]:
    """(problem, h, steps): the problems that the scheme is for, with steps that their slopes allow, or its class's."""
    own = problems_of(scheme)
    if own is None:
        known = {"nambu": NAMBU_RUNS, "several": SEVERAL_RUNS}.get(scheme.systems, RUNS)
        return [(problems.by_name(name), h, steps) for name, h, steps in known]
    return [(p, 0.01 * reach(p), 2048) for p in own] + [(p, 0.125 * reach(p), 256) for p in own]


def energy_walk(
    scheme: Scheme, problem: Problem, h: float, steps: int, seed: int
) -> tuple[np.ndarray, float]:
    """Signed energy defects in ulp of H (checkpoints, paths), H in extended precision; NaN for failed paths.

    And what rounding alone moves H by in a step, in the same unit.
    """
    asked, exact = guarded(scheme), exact_problem(describe(problem), 30)
    raw = wiener.increments(seed, T=h * steps, steps=steps, noises=problem.noises, paths=PATHS)
    dW = wiener.truncate(raw, h, scheme.truncation)
    y0 = np.array(problem.initial, dtype=np.float64)
    y = np.repeat(y0[:, None], PATHS, axis=1)
    H0, unit = exact.hamiltonian(exact.state(y0)), float(energy_ulp(problem, y0, y0))
    rows, walks, alive, checkpoint = [], [], np.arange(PATHS), FIRST
    for n in range(1, steps + 1):
        value, status, _ = advance(asked, problem, y[:, alive], h, dW[n - 1][:, alive])
        alive = alive[status == Status.CONVERGED]
        y[:, alive] = value[:, status == Status.CONVERGED]
        if n == checkpoint:
            row = np.full(PATHS, np.nan)
            for k in alive:
                defect = float(exact.hamiltonian(exact.state(y[:, k])) - H0) / unit
                row[k] = max(-BEYOND, min(BEYOND, defect))
            rows.append(row)
            walk = rounding_walk(problem.gradient(y[:, alive]), y[:, alive]) / unit
            walks.append(walk if walk < EXPLODED else 0.0)
            checkpoint *= 2
        if not alive.size:
            return np.full((1, PATHS), np.nan), 0.0
    return np.array(rows), float(np.sqrt(np.mean(np.square(walks))))


def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    """The same paths again."""
    return run(law, scheme, Effort(seed=int(witness["seed"])))


law = Law(
    name="rounding",
    statement="over many steps the energy walks like √n roundings, and does not drift",
    source="Prop. 3.1",
    unit="ulp H·√n",
    run=run,
    replay=replay,
)


def test_rounding(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
