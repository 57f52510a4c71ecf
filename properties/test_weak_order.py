"""Weak order q: E g(y_N) − E g(y(T)) = O(h^q) for g = y_i and y_i y_j,
over paths in which both have the same noise.

These errors for all g are called means here. Each of the first three statements shows the order q
if the last is false:

- The rms error has mean-square order q, because |E g(y_N) − E g(y(T))| ≤ L (E|e|²)^½. This suffices
  for most schemes.
- The means fall faster than h^(q − ½) from the coarsest step to the finest. This uses a lower bound
  of the largest mean at the coarsest step and an upper bound at the finest.
- q ≥ 2, and at the coarsest step the part of order h^(q − 1) in the means is less than
  SMALL_MEAN_SHARE times the rms error, with confidence. If errors of paths have a lower order than
  their means, sampling cannot show the fall of the means; the law "local-weak" shows it by
  quadrature.
- The coefficient of h^(q − 1) in the means, extrapolated from three step sizes, is not zero.

The law is violated if the last statement is true and the means fall too slowly. Both conditions are
needed: a mean may vanish at the coarsest step by chance, and a small coefficient has no visible
effect at these step sizes. If the means are below their statistical error, the verdict is
`inconclusive`, with the number of paths needed. But for several Hamiltonians the law then holds if
"local-weak" holds, because errors of order ½ often hide the means there.

Where nothing has to be sampled, the slope of the exact means is judged as in "local-weak". For
increments with few values `sepv.properties._orders.weak_trees` sums E g(y_N) over all paths. For a
linear drift with additive noise, as friction has with a quadratic V, y(T) is Gaussian, and if the
step is affine, `sepv.properties._orders.gaussian_moments` computes the means of both.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from sepv.properties._orders import local_orders
from sepv.properties._orders.convergence import StrongErrors, above_floor, mean_square_order
from sepv.properties._orders.gaussian_moments import LEAST_SIZES, moment_errors_at
from sepv.properties._orders.means import Coefficient, decay, leading, moment_errors
from sepv.properties._orders.weak_trees import LEAST_RESOLUTIONS, tree_errors
from sepv.properties._sequential import Assess, Assessment, hold_level, is_tilted, judge
from sepv.properties._setups import Setup, setups_for

from sepv.errors import Skipped
from sepv.law import Effort, Finding, Law, Run, Verdict, about_noise, require
from sepv.problem import Array, Problem, Systems, column
from sepv.schemes import Scheme, has_memory, order_of, point_law

# The last words of the message about means with a significant part of too low an order.
REST_WORDS = "is left"
# Half the distance between weak orders, which are integers, because the expansion of means is in
# powers of h.
WEAK_MARGIN = 0.5
# A mean counts as small below this share of the rms error. For the schemes of weak order 1 here it
# is 0.2 to 0.5.
SMALL_MEAN_SHARE = 0.15
# Half the distance between mean-square orders, which are multiples of ½.
STRONG_MARGIN = 0.25
# The smallest part of order q − 1 that counts, relative to the largest mean at the finest step. If
# the part of order q happens to vanish, the error of extrapolation exceeds its remainder (0.009
# with hardly any noise, when c h³ remains). If means fall more slowly than the order less
# WEAK_MARGIN, the part is 0.8 or more.
LEAST_PART = 1 / 32
_WEAK_RANKS = (Verdict.VIOLATED, Verdict.ERROR, Verdict.INCONCLUSIVE, Verdict.HOLDS, Verdict.NOT_APPLICABLE)


def assessing(claimed: float | None, tilted: bool, hold: float = 0.0) -> Assess:
    """Make the test of a weak order by three intervals of error probability alpha/3 (rms error:
    `hold` if larger).
    """

    def assess(problem: Problem, errors: StrongErrors, alpha: float, more: float) -> Assessment:
        order = order_of(claimed, column(problem))
        bound = order - WEAK_MARGIN
        if not above_floor(errors).any():
            text = "errors at the rounding floor at every step size"
            return Assessment(Verdict.HOLDS, math.inf, math.inf, math.inf, bound, text, order)
        samples = moment_errors(errors)
        value, low, high = decay(samples, errors.h, alpha / 3, more)
        lower = leading(samples, errors.h, math.ceil(order) - 1)
        finest = LEAST_PART * np.max(np.abs(samples[-1].mean(axis=1))) / errors.h[-1] ** lower.power
        least = np.maximum(lower.remainder, finest)
        remains = bool(np.any(np.abs(lower.value) - lower.half(alpha / 3, more) > least))
        strong = -math.inf
        if above_floor(errors).sum() >= 2:
            strong = mean_square_order(errors, max(alpha / 3, hold), more=more, weighted=tilted)[1]
        text = f"means fall with order {value:.3g} in [{low:.3g}, {high:.3g}]"
        if strong > order - STRONG_MARGIN and not remains:
            text += f", the rms error with {strong:.3g} at least,"
            return Assessment(Verdict.HOLDS, max(value, strong), max(low, strong), high, bound, text, order)
        verdict = Verdict.INCONCLUSIVE
        if high < bound and remains:
            verdict = Verdict.VIOLATED
        elif low > bound and not remains:
            verdict = Verdict.HOLDS
        elif not remains and order > 1 and _small(samples, errors.h, lower, alpha / 3, more):
            verdict = Verdict.HOLDS
            text += (
                f", no part of order {math.ceil(order) - 1} as large as {SMALL_MEAN_SHARE} of the rms error"
            )
            return Assessment(verdict, bound, low, high, bound, text, order)
        elif remains:
            text += f", and a part of order {math.ceil(order) - 1} {REST_WORDS}"
        return Assessment(verdict, value, low, high, bound, text, order if verdict is Verdict.HOLDS else None)

    return assess


def _small(samples: Array, h: Array, lower: Coefficient, alpha: float, more: float) -> bool:
    most = (np.abs(lower.value) + lower.half(alpha, more)) * h[0] ** lower.power
    return bool(np.all(most < SMALL_MEAN_SHARE * np.sqrt(np.mean(samples[0] ** 2, axis=1))))


def run(law: Law, scheme: Scheme, this_run: Run) -> Finding:
    """Compare the weak order, from sampled paths or all paths of a discrete noise,
    with the claimed one (default 1).
    """
    order = order_of(scheme.weak_order, "general")
    if point_law(scheme.increments) is not None:
        return local_orders.judge(
            law, scheme, this_run, lambda errors: errors.weak, lambda _: order,
            lambda _, order: order - WEAK_MARGIN,
            1.0, tree_errors, LEAST_RESOLUTIONS,
        )  # fmt: skip
    setups = setups_for(scheme, this_run.effort)
    known = {setup: found for setup in setups if (found := moment_errors_at(scheme, setup))}
    rest = tuple(setup for setup in setups if setup not in known)
    if not known:
        return _sampled(law, scheme, this_run, rest)
    built = {setup.build(): errors for setup, errors in known.items()}
    found = local_orders.judge(
        law, scheme, this_run, lambda errors: errors.weak,
        lambda _: order_of(scheme.weak_order, "additive"), lambda _, order: order - WEAK_MARGIN,
        1.0, lambda _scheme, problem, _run: built[problem], LEAST_SIZES, problems=built,
    )  # fmt: skip
    if found.verdict is Verdict.VIOLATED or not rest:
        return found
    try:
        return _joined(found, _sampled(law, scheme, this_run, rest))
    except Skipped as skip:
        return replace(found, message=f"{found.message}\n{skip.reason}")


def _joined(*findings: Finding) -> Finding:
    """The worst of findings about different problems, with the texts and measurements of all."""

    def rank(finding: Finding) -> tuple[int, float]:
        apart = (finding.defect or math.inf) - (finding.bound or 0.0)
        return _WEAK_RANKS.index(finding.verdict), apart

    witness: dict[str, Any] = {}
    for finding in findings:
        witness |= finding.witness or {}
    measured = [each for f in findings for each in (f.witness or {}).get("measured", ())]
    return replace(
        min(findings, key=rank), checks=sum(f.checks for f in findings), witness=witness | {"measured": measured},
        message="\n".join(f.message for f in findings), replay=findings[-1].replay,
    )  # fmt: skip


def _sampled(law: Law, scheme: Scheme, this_run: Run, setups: tuple[Setup, ...]) -> Finding:
    """Judge sampled paths, and for several Hamiltonians one step if paths decide nothing."""
    assess = assessing(scheme.weak_order, is_tilted(scheme), hold_level(scheme, this_run))
    found = judge(law, scheme, this_run, assess, setups=setups)
    # Milstein's theorem is about one-step methods.
    undecided = (
        found.verdict is Verdict.INCONCLUSIVE and REST_WORDS not in found.message and not has_memory(scheme)
    )
    if undecided and scheme.systems is Systems.HAMILTONIANS:
        # Errors of order ½ of paths may hide the means. The paths contradict nothing, and
        # Milstein's theorem concludes from one step: G. N. Milstein, Numerical Integration of
        # Stochastic Differential Equations (1995), §9.
        one_step = local_orders.judge(
            law, scheme, this_run, lambda errors: errors.weak,
            lambda errors: order_of(scheme.weak_order, errors.column), local_orders.mean_slope, 1.0,
        )  # fmt: skip
        if one_step.verdict is Verdict.HOLDS:
            text = (
                f"{found.message}\nnot decided by paths, but by the weak error of one step (law local-weak)"
            )
            return replace(found, verdict=Verdict.HOLDS, message=text)
    return found


def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    """Repeat the run of a witness (a stored counterexample): its sampled paths,
    or the sum over all paths.
    """
    drawn: dict[str, Any] = {key: int(witness[key]) for key in ("seed", "paths") if key in witness}
    return run(law, scheme, Run(Effort(**drawn)))


law = Law(
    name="weak-order",
    statement="the errors of E[y_i] and E[y_i y_j] over paths are O(h^q) for the claimed weak order q (default: 1)",
    source="§5",
    unit="slope",
    cost=0.1,
    run=about_noise(run),
    replay=replay,
    statistical=True,
)


def test_weak_order(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
