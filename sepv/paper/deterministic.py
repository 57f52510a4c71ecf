"""§2: without noise the energy-preserving scheme (2.1)
is the method of order two of Cohen and Hairer (2011).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sepv import problems, schemes
from sepv.exact import exact_flow
from sepv.problem import Problem

from . import judge
from .record import SENTENCE, Job, Panel, Results, Size, Statement, points

NOISELESS_SYSTEMS: dict[str, Callable[..., Problem]] = {
    "rigid-body": problems.rigid_body,
    "pendulum": problems.pendulum,
}
NOISELESS_SCHEMES = ("energy-preserving", "midpoint", "discrete-gradient")
NOISELESS_T, NOISELESS_STEPS = 1.0, (16, 32, 64, 128)


def errors(scheme: str, problem: str) -> list[float]:
    """The errors |y_N − y(T)| of a scheme without noise (c = 0),
    for each number N of steps in NOISELESS_STEPS.
    """
    method, system = schemes.PAPER[scheme], NOISELESS_SYSTEMS[problem](noise=())
    start, sizes = np.array(system.initial), []
    exact = exact_flow(system, NOISELESS_T).y
    for steps in NOISELESS_STEPS:
        y = start
        for _ in range(steps):
            y = method.step(system, y, NOISELESS_T / steps, np.empty(0))
        sizes.append(float(np.linalg.norm(y - exact)))
    return sizes


def jobs(_size: Size) -> list[Job]:
    """The jobs: one for each pair of a scheme and a problem.

    The jobs do not depend on the size of the reproduction: nothing is random, and a quick
    reproduction omits none.
    """
    return [
        Job(("theory", "deterministic", s, p), errors, {"scheme": s, "problem": p}, 0.5)
        for s in NOISELESS_SCHEMES
        for p in NOISELESS_SYSTEMS
    ]


def panels(results: Results) -> list[Panel]:
    """The panel of errors against h without noise, with slopes between neighbouring step sizes."""
    h, measured, slopes, statements = NOISELESS_T / np.array(NOISELESS_STEPS), [], {}, []
    for s, p in ((s, p) for s in NOISELESS_SCHEMES for p in NOISELESS_SYSTEMS):
        errors = np.array(results["theory", "deterministic", s, p])
        seen = -np.diff(np.log2(errors))
        measured.append(points(f"{s}, {p}", h, errors, s))
        slopes[f"{s}, {p}"] = {"errors": errors.tolist(), "slopes": seen.tolist()}
        if s == "energy-preserving":
            statements.append(Statement(
                f"{SENTENCE[s]} reduces to the method of order two for c = 0, on the {p}", "§2",
                judge.near(seen[-1], 2, 0.25, 0.5), "slopes " + ", ".join(f"{v:.2f}" for v in seen),
                "the slope between the two finest steps is within 2 ± 1/4",
            ))  # fmt: skip
    return [Panel(
        key="theory-deterministic-order", title="Without noise", source="§2", series=tuple(measured),
        parameters={"c": 0.0, "T": NOISELESS_T, "N": list(NOISELESS_STEPS)}, slopes=(1.0, 2.0),
        statements=tuple(statements),
        description="Energy-preserving and midpoint scheme have slope two. The discrete gradient scheme has slope one "
        "where B is not constant, because it takes B at the start of the step.",
        numbers=slopes,
    )]  # fmt: skip
