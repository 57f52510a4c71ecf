"""Brouwer's law: over many steps an exactly energy-preserving scheme drifts like the random walk of rounding.

A solver stopped at a tolerance leaves a residual of one sign: its energy drifts linearly.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from sepv.reference.problem import exact_problem

from sepv import problems, wiener
from sepv.candidate import guarded
from sepv.implicit import Status
from sepv.law import Effort, Finding, Law, Verdict, require
from sepv.scheme import Scheme
from sepv.simulation import advance
from sepv.tolerance import energy_ulp

H, PATHS, STEPS = 0.01, 32, 2048
CHECKPOINTS = tuple(2**n for n in range(5, 12))
# Rounding of one step of (2.1) moves the energy by about 0.3 energy ulps (root mean square), independently from
# step to step: after n steps by 0.3√n. The factor of 10 up to this bound is room for other orders of
# operations; a residual of 1e-12 with one sign reaches it after a few hundred steps.
ALLOWED = 3.0


def run(law: Law, scheme: Scheme, effort: Effort) -> Finding:
    """rms energy defect after n steps, in energy ulps over √n, at its largest; and how it grows."""
    rows, lines = [], []
    allowed = ALLOWED + scheme.solver_tolerance / np.finfo(np.float64).eps * np.sqrt(STEPS)
    for name in ("rigid-body", "pendulum"):
        defects, failed = energy_walk(scheme, name, effort.seed)
        if failed:
            return law.finding(Verdict.ERROR, checks=PATHS, message=f"{name}: {failed} paths failed")
        n = np.array(CHECKPOINTS, dtype=np.float64)
        rms = np.sqrt(np.mean(defects**2, axis=1))
        bias = float(np.mean(defects[-1]) / (np.std(defects[-1]) / np.sqrt(PATHS) + 1e-300))
        growth = float(np.polyfit(np.log(n), np.log(rms + 1e-300), 1)[0])
        rows.append(float(np.max(rms / np.sqrt(n))))
        lines.append(
            f"{name}: {rows[-1]:.3g} energy ulps·√n at most over {STEPS} steps, growth n^{growth:.2f}, "
            f"mean at the end {bias:+.1f} standard errors"
        )
    verdict = Verdict.HOLDS if max(rows) <= allowed else Verdict.VIOLATED
    return law.finding(
        verdict,
        defect=max(rows),
        bound=float(allowed),
        checks=2 * PATHS,
        message="\n".join(lines),
        witness={"seed": effort.seed, "paths": PATHS, "steps": STEPS, "h": H},
        replay=f"--law {law.name} --seed {effort.seed}",
    )


def energy_walk(scheme: Scheme, name: str, seed: int) -> tuple[np.ndarray, int]:
    """Signed energy defects in energy ulps (checkpoints, paths), H in extended precision; and failed paths."""
    problem, asked = problems.by_name(name), guarded(scheme)
    assert problem.data is not None
    exact = exact_problem(problem.data, 30)
    raw = wiener.increments(seed, T=H * STEPS, steps=STEPS, noises=problem.noises, paths=PATHS)
    dW = wiener.truncate(raw, H, scheme.truncation)
    y0 = np.array(problem.initial, dtype=np.float64)
    y = np.repeat(y0[:, None], PATHS, axis=1)
    H0, unit = exact.hamiltonian(exact.state(y0)), energy_ulp(problem, y0, y0)
    rows = []
    for n in range(STEPS):
        y, status, _ = advance(asked, problem, y, H, dW[n])
        failed = int(np.count_nonzero(status != Status.CONVERGED))
        if failed:
            return np.zeros((0, PATHS)), failed
        if n + 1 in CHECKPOINTS:
            rows.append([float(exact.hamiltonian(exact.state(state)) - H0) / unit for state in y.T])
    return np.array(rows), 0


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
