"""Remark 2.1, Lemma 3.1: |ζ| ≤ A_h = √(2k|ln h|), moments are bounded, k is large enough,
steps use all |ζ| ≤ A_h.

Normal increments √h ξ are truncated to √h ζ. The paper prints the bound of Remark 2.1 with "=", but
it is "≤", as here.

The scheme must use the increments that it declares: at every h its step must respond to each
ΔW_j in every sixteenth of [−√h A_h, 0] and [0, √h A_h]. Of these the innermost, the outermost
and one more are tested. The response |∂y1/∂ΔW_j| of y1 = y0 + Δf + ½Δ²f′f + O(Δ³) is c_j|f|(1 ±
x), x = L(h + c_j√h A_h) with L ≥ |f′|. So the largest is at most (1 + x)/(1 − x) times the
smallest, 1.3 for x ≤ INCREMENT_REACH, and 2 is allowed. If a scheme itself clips at less than 31/32
of A_h, that is with k′ < 0.93 k, its response in the outermost sixteenth is less than half of the
largest.

Step sizes h are drawn from 2⁻⁶⁰ to ½. If x > INCREMENT_REACH, H is divided by a number
(`sepv.properties._orders.any_step`). For users' problems and an H that is no polynomial data, the
range of h ends at x = INCREMENT_REACH instead. There h, also in A_h, is in the problem's own unit
of time. A scheme that clips by h without this unit is judged only up to its clip. Responses below a
solver's possible error are not judged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from sepv.properties._orders.any_step import scaled
from sepv.properties._orders.local_errors import problems_for
from sepv.properties._orders.local_orders import SOLVER_CLEAR, SOLVER_FLOOR
from sepv.properties._problems_of import units_for
from sepv.reference.increments import lost_variance, moment, truncated_moment

from sepv.errors import Skipped
from sepv.law import Effort, Finding, Law, Run, Verdict, about_noise, require
from sepv.law.units import rates_at
from sepv.problem import Array, PolynomialSystem, Problem
from sepv.record import EPS
from sepv.schemes import Scheme, ask, point_law, takes
from sepv.simulate import truncation as bounded
from sepv.simulate import wiener

TRUNCATION_STEPS = tuple(2.0**-n for n in range(1, 21))
# The number of step sizes for each noise, and their range in units of time. No two noises have the
# same step sizes.
SIZES_OF_NOISE, TRUNCATION_MIN, TRUNCATION_MAX = 11, 2.0**-60, 0.5
INCREMENT_PARTS, INCREMENT_REACH = 16, 1 / 8


def run(law: Law, scheme: Scheme, this_run: Run) -> Finding:
    """Measure increments truncated with the scheme's k, for h from 1/2 to 2⁻²⁰,
    and the step's responses to them.
    """
    k, points = scheme.truncation, point_law(scheme.increments)
    if points is not None:
        text = f"{points.name} increments are bounded by {points.bound:.4g} √h: there is nothing to truncate"
        return law.finding(Verdict.NOT_APPLICABLE, message=text)
    if k is None:
        return law.finding(Verdict.NOT_APPLICABLE, message="the scheme takes its increments untruncated")
    order = scheme.mean_square_order
    if order is not None and k < 2 * order:
        # E|ξ − ζ|² ≤ C h^k |ln h|^½ causes a local rms error h^((k+1)/2), and order p needs
        # h^(p + 1/2).
        return law.finding(
            Verdict.VIOLATED,
            defect=float(k),
            bound=2 * order,
            at_least=True,
            message=f"truncation k = {k} costs the claimed mean-square order {order:g}: it needs k ≥ {2 * order:g}",
            witness={"truncation": k},
        )
    worst, checks = (0.0, 1.0, ""), 0
    for h in TRUNCATION_STEPS:
        for ratio, text in _ratios(h, k, this_run.effort.seed):
            checks += 1
            if not ratio <= worst[0]:
                worst = (ratio, 1.0, text)
    responses = list(_responses(scheme, k, this_run.effort.seed))
    if not responses:
        text = "no step responds to an increment by more than its possible error: nothing shows a clip"
        return law.finding(Verdict.NOT_APPLICABLE, message=text)
    for response in responses:
        checks += 1
        if not response[0] <= worst[0]:
            worst = (response[0], 1.0, response[1])
    verdict = Verdict.VIOLATED if not worst[0] <= 1 else Verdict.HOLDS
    message = worst[2] if verdict is Verdict.VIOLATED else ""
    return law.finding(
        verdict, defect=worst[0], bound=1.0, checks=checks, message=message,
        witness={"truncation": k, "seed": this_run.effort.seed},
        replay=f"--law {law.name} --seed {this_run.effort.seed}",
    )  # fmt: skip


def _ratios(h: float, k: int, seed: int) -> list[tuple[float, str]]:
    """Return |ζ|, the lost variance and the moments of ζ, each divided by its bound,
    with descriptions.
    """
    raw = wiener.increments(seed, T=h, steps=1, noises=1, paths=512)
    # Random draws ξ hardly reach A_h, so multiples of the draws are added.
    zeta = bounded.truncate(np.concatenate([raw, 8 * raw]), h, k) / math.sqrt(h)
    bound = bounded.truncation_bound(h, k)
    loss = float(lost_variance(h, k))
    allowed = (1 + 2 * math.sqrt(2 * k * abs(math.log(h)))) * h**k
    ratios = [
        # The bound is enlarged by roundings of √h, of the product and of the quotient.
        (
            float(np.max(np.abs(zeta))) / (bound * (1 + 4 * 2.0**-53)),
            f"|ζ| exceeds A_h = {bound!r} at h = {h!r}",
        ),
        (loss / allowed, f"E[ξ² − ζ²] = {loss:.6g} exceeds {allowed:.6g} at h = {h!r}"),
    ]
    for p in (1, 2, 3, 4, 8):
        ratio = float(truncated_moment(h, k, p) / moment(p))
        ratios.append((ratio, f"E|ζ|^{p} exceeds E|ξ|^{p} by the factor {ratio!r} at h = {h!r}"))
    return ratios


def _responses(scheme: Scheme, k: int, seed: int) -> Iterator[tuple[float, str]]:
    """Yield ½ max/min of the responses |∂y1/∂ΔW_j| (allowed: 1), and a text, for each problem,
    noise and h.
    """
    skipped: list[Skipped] = []
    problems, rng = problems_for(scheme), np.random.default_rng((seed, 2))
    count = sum(np.count_nonzero(problem.c) for problem in problems)
    # Each noise has one h in each of SIZES_OF_NOISE parts of the range. Within a part, no two
    # noises have the same place.
    places = rng.permuted(np.tile(np.arange(count), (SIZES_OF_NOISE, 1)), axis=1) + rng.random(
        (SIZES_OF_NOISE, count)
    )
    shares = iter(((np.arange(SIZES_OF_NOISE)[:, None] + places / count) / SIZES_OF_NOISE).T)
    for problem in problems:
        drawn = [next(shares) for _ in range(np.count_nonzero(problem.c))]
        try:
            for j, share in zip(np.flatnonzero(problem.c), drawn, strict=True):
                for posed, h, A in _steps(scheme, problem, int(j), k, share):
                    found = _weakest(
                        scheme, posed, h, A, int(j), int(rng.integers(1 - INCREMENT_PARTS, INCREMENT_PARTS))
                    )
                    if found is None:
                        continue
                    size, place = found
                    text = (
                        f"{problem.name}, h = {h!r}: the step does not respond to ΔW_{j + 1} beyond {place:.3g} √h "
                        f"as elsewhere, and k = {k} lets increments through up to {A:.3g} √h"
                    )
                    yield size, text
        except Skipped as skip:  # schemes may refuse some problems
            skipped.append(skip)
    if len(skipped) == len(problems):
        raise skipped[0]


def _steps(
    scheme: Scheme, problem: Problem, j: int, k: int, shares: Array
) -> Iterator[tuple[Problem, float, float]]:
    """Yield for noise j the problem (H divided if a step is too long), h and A_h,
    at `shares` of the range of log h.
    """
    time, slope = units_for(scheme, problem).time, rates_at(problem, np.array(problem.initial))[1]

    def clip(h: float) -> float:
        # Remark 2.1 needs h < 1. A scheme that clips by h in seconds may have h > 1 here: its |ln
        # h| is used too.
        return math.sqrt(2 * k * min(abs(math.log(t)) for t in (h / time, h)))

    def reach(h: float) -> float:
        return float(slope * (h + problem.c[j] * math.sqrt(h) * clip(h)))

    low, high = TRUNCATION_MIN * time, TRUNCATION_MAX * time
    given = bool(scheme.problems) or not isinstance(problem.data, PolynomialSystem)
    while given and reach(high) > INCREMENT_REACH:
        high /= 2
    for h in low * (high / low) ** shares:
        posed = scaled(
            problem, 1.0 if given else min(1.0, 2.0 ** math.floor(math.log2(INCREMENT_REACH / reach(h))))
        )
        assert posed is not None
        yield posed, float(h), clip(h)


def _weakest(
    scheme: Scheme, problem: Problem, h: float, A: float, j: int, between: int
) -> tuple[float, float] | None:
    """Return ½ max/min of |∂y1/∂ΔW_j| over parts of [−A, A]√h, one of them `between`,
    and the minimum's |ΔW_j|/√h.

    None if the scheme refuses such steps, or if all responses are below its possible error, as at a
    rest point.
    """
    edges = {
        -INCREMENT_PARTS,
        1 - INCREMENT_PARTS,
        -1,
        0,
        1,
        INCREMENT_PARTS - 1,
        INCREMENT_PARTS,
        between,
        between + 1,
    }
    number = np.array(sorted(edges))
    xi = A * number / INCREMENT_PARTS
    y = np.repeat(np.asarray(problem.initial, dtype=np.float64)[:, None], xi.size, axis=1)
    dW = np.zeros((problem.noises, xi.size))
    dW[j] = np.sqrt(h) * xi
    if not all(takes(scheme, problem, y[:, i], h, dW[:, i]) for i in range(xi.size)):
        return None
    if scheme.batched:
        ends = ask(scheme, problem, y, h, dW)
    else:
        ends = np.stack([ask(scheme, problem, y[:, i], h, dW[:, i]) for i in range(xi.size)], axis=1)
    parts = np.flatnonzero(np.diff(number) == 1)
    responses = np.linalg.norm(np.diff(ends, axis=1), axis=0)[parts]
    if np.max(responses) <= SOLVER_CLEAR * (SOLVER_FLOOR * EPS + scheme.precision) * np.max(np.abs(ends)):
        return None
    least = int(np.argmin(responses))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = 0.5 * float(np.max(responses) / responses[least])
    return ratio, float(np.min(np.abs(xi[parts[least] : parts[least] + 2])))


def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    """Run the law again with the seed of a witness (a stored counterexample),
    so that it draws the same steps.
    """
    return run(law, scheme, Run(Effort(seed=int(witness.get("seed", 0)))))


law = Law(
    name="truncation",
    statement="increments √h ζ have |ζ| ≤ A_h = √(2k|ln h|), k ≥ 2p for mean-square order p, and steps clip no further",
    source="Rem. 2.1",
    unit="share",
    cost=0.1,
    steps=792,
    run=about_noise(run),
    replay=replay,
    middle="it is about increments, and about the response of one step to them",
)


def test_truncation(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
