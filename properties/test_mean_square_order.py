"""Theorems 3.3 and 3.4: mean-square order, measured against the exact flow at the random time.

The law is violated only if two slopes have confidence intervals below the order: the slope of the
rms error and that of a quantile of the error, which does not depend on the tails
(`sepv.properties._orders.convergence.mean_square_order`).
"""

from __future__ import annotations

import math
from typing import Any

from sepv.properties._orders.convergence import StrongErrors, above_floor, floors, mean_square_order
from sepv.properties._orders.local_orders import unclaimed
from sepv.properties._sampled import pathwise
from sepv.properties._sequential import Assess, Assessment, hold_level, is_tilted, judge
from sepv.properties._setups import noncommuting, setups_for

from sepv.law import Effort, Finding, Law, Run, Verdict, require
from sepv.problem import Problem, column
from sepv.schemes import Scheme, order_of

# Orders of one-step methods for (1.1) are multiples of ½. If the interval of the slope is above p
# − MEAN_SQUARE_MARGIN, the middle between p and the next lower order, it rejects the lower order.
# The margin also allows for the pre-asymptotic part of a slope, which is below 0.06 for the paper's
# schemes at these step sizes.
MEAN_SQUARE_MARGIN = 0.25


def assessing(claimed: float | None, tilted: bool, hold: float = 0.0) -> Assess:
    """Make the test that slopes of the error are above the claimed order less MEAN_SQUARE_MARGIN.

    The slopes are that of the rms error and, except for weighted (`tilted`) samples, that of a
    quantile. The law holds if an interval with error probability alpha, or `hold` if larger, lies
    above this bound.
    """

    def assess(problem: Problem, errors: StrongErrors, alpha: float, more: float) -> Assessment:
        kind = column(problem)
        order = order_of(claimed, kind, unclaimed(kind))
        bound = order - MEAN_SQUARE_MARGIN
        usable = above_floor(errors)
        if usable.sum() < 2:
            return at_the_floor(errors, order)
        value, low, high = mean_square_order(errors, alpha, more=more, weighted=tilted)
        if hold > alpha:
            low = mean_square_order(errors, hold, more=more, weighted=tilted)[1]
        verdict = Verdict.HOLDS if low > bound else Verdict.VIOLATED if high < bound else Verdict.INCONCLUSIVE
        apart = f", reference wrong by {errors.reference:.1e}" if errors.reference else ""
        text = f"{value:.3g} in [{low:.3g}, {high:.3g}]{apart}"
        return Assessment(
            verdict, value, low, high, bound, text, max(order_above(low), order * (low > bound))
        )

    return assess


def order_above(low: float) -> float:
    """Return the largest multiple p of ½ with p − MEAN_SQUARE_MARGIN < `low`,
    the lower end of a slope's interval, or 0.

    The interval proves the order p with the confidence of the run, whatever order is claimed.
    """
    return max(0.0, math.ceil(2 * (low + MEAN_SQUARE_MARGIN) - 1) / 2) if math.isfinite(low) else 0.0


def at_the_floor(errors: StrongErrors, order: float) -> Assessment:
    """Judge errors at the rounding floor: a bound C h^p with tiny C holds,
    so nothing contradicts the order.

    If only the error of the coarsest step is above the floor, it must fall to the floor as fast as
    the order demands.
    """
    usable, rms, floor, bound = above_floor(errors), errors.rms(), floors(errors), order - MEAN_SQUARE_MARGIN
    if not usable.any():
        text = "errors at the rounding floor at every step size"
        return Assessment(Verdict.HOLDS, math.inf, math.inf, math.inf, bound, text, order)
    fall = math.log(rms[0] / floor[-1]) / math.log(errors.h[0] / errors.h[-1]) if usable[0] else -math.inf
    verdict = Verdict.HOLDS if fall > bound else Verdict.INCONCLUSIVE
    text = f"errors at the rounding floor but for one step size, a slope of at least {fall:.3g}"
    return Assessment(verdict, fall, fall, math.inf, bound, text, order if verdict is Verdict.HOLDS else None)


def run(law: Law, scheme: Scheme, this_run: Run) -> Finding:
    """Compare the slope of the error with the claimed order (default: 1, ½ for noncommuting
    noises).
    """
    hold = hold_level(scheme, this_run)
    setups = (*setups_for(scheme, this_run.effort), *noncommuting(scheme))
    return judge(
        law, scheme, this_run, assessing(scheme.mean_square_order, is_tilted(scheme), hold), setups=setups
    )


def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    """Repeat the run of a witness (a stored counterexample), with its seed and number of paths."""
    return run(law, scheme, Run(Effort(seed=int(witness["seed"]), paths=int(witness["paths"]))))


law = Law(
    name="mean-square-order",
    statement="the rms error over paths is O(h^p) for the claimed mean-square order p (default: 1 or ½)",
    source="Thm 3.3, 3.4",
    unit="slope",
    cost=0.3,
    steps=129000,
    # For nine of ten seeds the early look (few paths) decides. If not, the next look takes 43,008
    # steps.
    spared=8064,
    run=pathwise(run),
    replay=replay,
    statistical=True,
)


def test_mean_square_order(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
