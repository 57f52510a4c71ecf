"""Remark 2.1 and Lemma 3.1: |ζ| ≤ A_h exactly, the moment bounds by exact integrals, k large enough, no second clip.

The bound of Remark 2.1 is printed with "=" in the paper; it is "≤", as here.

The scheme must use the increments that it declares: at a small h its step must respond to each ΔW_j in every sixteenth
of [−√h A_h, √h A_h]. A step y1 = y0 + f(y0)(h + S) + O((h + |S|)²) responds with c_j|f|, up to a part of the order
of |f′| √h A_h, at most 0.03 |f′| for k = 2: half of its largest response is left everywhere. A scheme that clips at
less than 31/32 of A_h, that is with k′ < 0.93 k, responds by less than half in the last sixteenth. On a user's problem
h, also in A_h, is in the problem's own time; a scheme that clips by itself, by h alone, is judged to its own clip. A
noise that moves y by less than a solver's possible error is not judged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from sepv.reference.increments import lost_variance, moment, truncated_moment

from sepv.errors import Skipped
from sepv.problem import Problem
from sepv.record._binary64 import EPS
from sepv.schemes import Scheme, ask
from sepv.schemes._point_distributions import point_law
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener
from sepv.verification import Effort, Finding, Law, Run, Verdict, require
from sepv.verification._law import about_noise
from sepv.verification._orders.local_errors import problems_for
from sepv.verification._orders.local_orders import CLEAR, FLOOR
from sepv.verification._units import units_for

STEPS = tuple(2.0**-n for n in range(1, 21))
# Steps small enough to be nearly linear in ΔW, also with k = 12.
SMALL = (2.0**-16, 2.0**-20, 2.0**-24)
PARTS = 16


def run(law: Law, scheme: Scheme, own: Run) -> Finding:
    """Increments truncated with the scheme's k, for h from 1/2 to 2⁻²⁰."""
    k, points = scheme.truncation, point_law(scheme.increments)
    if points is not None:
        text = f"{points.name} increments are bounded by {points.bound:.4g} √h: there is nothing to truncate"
        return law.finding(Verdict.NOT_APPLICABLE, message=text)
    if k is None:
        return law.finding(Verdict.NOT_APPLICABLE, message="the scheme takes its increments untruncated")
    order = scheme.mean_square_order
    if order is not None and k < 2 * order:
        # E|ξ − ζ|² ≤ C h^k |ln h|^½ makes a local rms error h^((k+1)/2), and order p needs h^(p + 1/2).
        return law.finding(
            Verdict.VIOLATED,
            defect=float(k),
            bound=2 * order,
            at_least=True,
            message=f"truncation k = {k} costs the claimed mean-square order {order:g}: it needs k ≥ {2 * order:g}",
            witness={"truncation": k},
        )
    worst, checks = (0.0, 1.0, ""), 0
    for h in STEPS:
        for ratio, text in _ratios(h, k, own.effort.seed):
            checks += 1
            if not ratio <= worst[0]:
                worst = (ratio, 1.0, text)
    for found in _responses(scheme, k):
        checks += 1
        if not found[0] <= worst[0]:
            worst = (found[0], 1.0, found[1])
    verdict = Verdict.VIOLATED if not worst[0] <= 1 else Verdict.HOLDS
    message = worst[2] if verdict is Verdict.VIOLATED else ""
    return law.finding(
        verdict, defect=worst[0], bound=1.0, checks=checks, message=message, witness={"truncation": k}
    )


def _ratios(h: float, k: int, seed: int) -> list[tuple[float, str]]:
    """Each quantity divided by its bound, with its description."""
    raw = wiener.increments(seed, T=h, steps=1, noises=1, paths=512)
    # Draws alone would hardly reach A_h: multiples of them are added.
    zeta = bounded.truncate(np.concatenate([raw, 8 * raw]), h, k) / math.sqrt(h)
    bound = bounded.truncation_bound(h, k)
    loss = float(lost_variance(h, k))
    allowed = (1 + 2 * math.sqrt(2 * k * abs(math.log(h)))) * h**k
    found = [
        # Roundings of √h, the product and the quotient, one each.
        (
            float(np.max(np.abs(zeta))) / (bound * (1 + 4 * 2.0**-53)),
            f"|ζ| exceeds A_h = {bound!r} at h = {h!r}",
        ),
        (loss / allowed, f"E[ξ² − ζ²] = {loss:.6g} exceeds {allowed:.6g} at h = {h!r}"),
    ]
    for p in (1, 2, 3, 4, 8):
        ratio = float(truncated_moment(h, k, p) / moment(p))
        found.append((ratio, f"E|ζ|^{p} exceeds E|ξ|^{p} by the factor {ratio!r} at h = {h!r}"))
    return found


def _responses(scheme: Scheme, k: int) -> Iterator[tuple[float, str]]:
    """Half the largest response of the step over the smallest, for each problem, h and noise."""
    skipped: list[Skipped] = []
    problems = problems_for(scheme)
    for problem in problems:
        try:
            time = units_for(scheme, problem).time
            for h in (small * time for small in SMALL):
                # Remark 2.1 is about h < 1. A clip in seconds may have h > 1 here, where its |ln h| is still a number.
                A = math.sqrt(2 * k * min(abs(math.log(t)) for t in (h / time, h)))
                for j in np.flatnonzero(problem.c):
                    size, place = _weakest(scheme, problem, h, A, int(j))
                    text = (
                        f"{problem.name}, h = {h!r}: the step does not respond to ΔW_{j + 1} beyond {place:.3g} √h "
                        f"as elsewhere, and k = {k} lets increments through up to {A:.3g} √h"
                    )
                    yield size, text
        except Skipped as skip:  # schemes may refuse some problems
            skipped.append(skip)
    if len(skipped) == len(problems):
        raise skipped[0]


def _weakest(scheme: Scheme, problem: Problem, h: float, A: float, j: int) -> tuple[float, float]:
    """½ max/min of |∂y1/∂ΔW_j| over the parts of [−A, A], in √h, and the place of the minimum."""
    xi = A * np.arange(-PARTS, PARTS + 1) / PARTS
    y = np.repeat(np.asarray(problem.initial, dtype=np.float64)[:, None], xi.size, axis=1)
    dW = np.zeros((problem.noises, xi.size))
    dW[j] = np.sqrt(h) * xi
    if scheme.batched:
        ends = ask(scheme, problem, y, h, dW)
    else:
        ends = np.stack([ask(scheme, problem, y[:, i], h, dW[:, i]) for i in range(xi.size)], axis=1)
    responses = np.linalg.norm(np.diff(ends, axis=1), axis=0)
    # Differences below a solver's possible error in a step are not judged.
    if np.max(responses) < CLEAR * (FLOOR * EPS + scheme.precision) * np.max(np.abs(ends)):
        return 0.0, 0.0
    least = int(np.argmin(responses))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = 0.5 * float(np.max(responses) / responses[least])
    return ratio, float(min(abs(xi[least]), abs(xi[least + 1])))


def replay(law: Law, scheme: Scheme, _witness: dict[str, Any]) -> Finding:
    """Run again; the law has no cases."""
    return run(law, scheme, Run())


law = Law(
    name="truncation",
    statement="|ζ| ≤ A_h, the moment bounds, k ≥ 2p for mean-square order p, and a step that takes all |ζ| ≤ A_h",
    source="Rem. 2.1",
    unit="share",
    cost=0.1,
    steps=792,
    run=about_noise(run),
    replay=replay,
)


def test_truncation(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
