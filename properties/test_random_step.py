"""The scheme (2.1) uses h and the increments ΔW_j only through the random step Δ = h + Σ_j
c_jΔW_j.
"""

from __future__ import annotations

import numpy as np

from sepv.errors import SchemeFault, Skipped, StepFailure
from sepv.law import (
    Case,
    Cases,
    Effort,
    Measurement,
    Middle,
    amplification,
    require,
    searched,
    state_ulp,
    step_residual,
)
from sepv.law.cases.clipped import clips, fits
from sepv.law.cases.of_law import only
from sepv.problem import Array, Problem, one_field
from sepv.schemes import Scheme, ask


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure the distance between steps with equal Δ,
    split into h and increments in different ways.

    Two such steps solve one equation y1 = y0 + R(y0, y1) with residuals r1 and r2, and with Δ
    rounded. Their distance e satisfies (I − ∂R/∂y1)e = r1 − r2, where `amplification` bounds (I
    − ∂R/∂y1)⁻¹.
    """
    problem, y, h, dW = case.build()
    others = splits(problem, h, dW)
    if scheme.truncation is not None and clips(scheme):
        others = [(name, a, b) for name, a, b in others if fits(problem, a, b, scheme.truncation)]
    if not others:
        raise Skipped("the case has one split of Δ only")
    y1 = ask(scheme, problem, y, h, dW)
    own_residual = step_residual(problem, y, y1, h, dW, scheme)
    amplified = amplification(scheme, case)
    unit, worst = state_ulp(y, y1), Measurement(0.0, 0.0)
    for name, other_h, other_dW in others:
        try:
            answer = ask(scheme, problem, y, other_h, other_dW)
        except (StepFailure, SchemeFault):
            if other_h:
                raise
            continue  # a scheme may refuse h = 0, which no path has
        residual = own_residual + step_residual(problem, y, answer, other_h, other_dW, scheme)
        allowed = amplified * float(residual.max())
        distance = float(np.max(np.abs(answer - y1)))
        detail = (
            f"y1 = {y1.tolist()}; with {name}, h = {other_h!r}, dW = {other_dW.tolist()}: {answer.tolist()}"
        )
        worst = max(
            worst, Measurement(distance / unit, allowed / unit, detail), key=lambda m: (m.ratio, m.bound)
        )
    return worst


# Names of splits of Δ, each with the share of h that remains in h. The noise gets the rest.
_SPLITS = (
    ("half of h in the noise", 0.5),
    ("nearly all of h in the noise", 2.0**-10),
    ("all of h in the noise", 0.0),
)


def splits(problem: Problem, h: float, dW: Array) -> list[tuple[str, float, Array]]:
    """Return other (name, h, dW) with equal Δ up to rounding: h keeps its sign,
    and |h| + Σ|c_jΔW_j| does not grow.
    """
    c = problem.c
    driven = np.flatnonzero(c)
    if not driven.size:
        return []
    j, delta, none = int(driven[-1]), float(problem.random_step(h, dW)), np.zeros_like(dW)
    pairs = []
    for name, share in _SPLITS:
        moved = dW.copy()
        moved[j] += (1 - share) * h / c[j]
        pairs.append((name, share * h, moved))
    if driven.size > 1:
        moved, i = dW.copy(), int(driven[0])
        moved[i] /= 2
        moved[j] += c[i] * moved[i] / c[j]
        pairs.append(("half of one noise in another", h, moved))
    if delta * h > 0:
        pairs.append(("all of Δ in h", delta, none))
    return [(name, a, b) for name, a, b in pairs if a != h or not np.array_equal(b, dW)]


_NO_STEP = "with several fields there is no random step Δ"
law = searched(
    name="random-step",
    statement="h and the increments act only through Δ = h + Σ c_j ΔW_j",
    source="(2.1)",
    unit="ulp of y",
    cost=0.6,
    steps=336,
    middle=Middle.MAP,
    cases=Cases(
        where={"m": ("1", "2", "3–4", "5–20")},
        blind={"degree of B": ("0",)},
        adapt=only(lambda p: p.c.any()),
        why="the problems have no noise",
        needs={one_field: _NO_STEP},
    ),
    check=check,
)


def test_random_step(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
