"""Weak order: E g(y_N) against E g(y(T)) for g = y_i and y_i y_j, coupled with the exact path.

There are four statements. The first three show that a weak order q holds; the fourth, with the second, that it does
not.

- |E g(y_N) − E g(y(T))| ≤ L (E|e|²)^½: a mean-square order of q implies it. Most schemes need no more.
- The largest of the means falls from the coarsest step to the finest faster than h^(q − ½), an upper bound of the
  one against a lower bound of the other.
- q ≥ 2, and the part of order h^(q − 1) in the means is, at the coarsest step, less than SMALL times the rms error,
with confidence. Where the errors of paths are of a lower order than their means no sample sees the fall itself;
"local-weak" does, by quadrature.
- The coefficient of h^(q − 1) in the means, extrapolated from three step sizes, is not zero.

`violated` needs the fall and the coefficient. A mean that happens to vanish at the coarsest step must not be a
violation, hence the coefficient. A coefficient that is small beside the error proper does not show at these steps,
hence the fall. Where the means are within the noise, the verdict is `inconclusive`, with the number of paths needed.

With increments of a few points nothing is sampled: E g(y_N) is a sum over all paths
(`sepv.properties._orders.weak_trees`), and its error has a slope without noise.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from sepv.properties._orders import local_orders
from sepv.properties._orders.convergence import StrongErrors, above_floor, mean_square_order
from sepv.properties._orders.means import Coefficient, decay, leading, moment_errors
from sepv.properties._orders.weak_trees import ENOUGH, tree_errors
from sepv.properties._sequential import Assess, Assessment, hold_level, is_tilted, judge

from sepv.problem import Array, Problem, column
from sepv.schemes import Scheme, order_of, point_law
from sepv.verification import Effort, Finding, Law, Run, Verdict, require
from sepv.verification._law import about_noise

# Weak orders are integers (the expansion is in powers of h): half the distance to the next lower one.
MARGIN = 0.5
# Means relative to rms errors: 0.2 to 0.5 for the schemes of weak order 1 here.
SMALL = 0.15
# The margin of a mean-square slope, whose orders are multiples of ½.
STRONG_MARGIN = 0.25
# The smallest part of order q − 1, relative to the finest mean, that counts. Where the part of order q happens to
# vanish, the extrapolation leaves out more than its remainder says (0.009 with hardly any noise, when c h³ is left).
# Means that fall more slowly than the order less MARGIN have 0.8.
LEAST = 1 / 32


def assessing(claimed: float | None, tilted: bool, hold: float = 0.0) -> Assess:
    """Make the test of the three statements, a third of alpha each; `hold` is the level for the rms error's order."""

    def assess(problem: Problem, errors: StrongErrors, alpha: float, more: float) -> Assessment:
        order = order_of(claimed, column(problem))
        bound = order - MARGIN
        if not above_floor(errors).any():
            text = "errors at the rounding floor at every step size"
            return Assessment(Verdict.HOLDS, math.inf, math.inf, math.inf, bound, text, order)
        samples = moment_errors(errors)
        value, low, high = decay(samples, errors.h, alpha / 3, more)
        lower = leading(samples, errors.h, math.ceil(order) - 1)
        finest = LEAST * np.max(np.abs(samples[-1].mean(axis=1))) / errors.h[-1] ** lower.power
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
            text += f", no part of order {math.ceil(order) - 1} as large as {SMALL} of the rms error"
            return Assessment(verdict, bound, low, high, bound, text, order)
        elif remains:
            text += f", and a part of order {math.ceil(order) - 1} is left"
        return Assessment(verdict, value, low, high, bound, text, order if verdict is Verdict.HOLDS else None)

    return assess


def _small(samples: Array, h: Array, lower: Coefficient, alpha: float, more: float) -> bool:
    most = (np.abs(lower.value) + lower.half(alpha, more)) * h[0] ** lower.power
    return bool(np.all(most < SMALL * np.sqrt(np.mean(samples[0] ** 2, axis=1))))


def run(law: Law, scheme: Scheme, this_run: Run) -> Finding:
    """Compare the weak order with the claimed one, or with 1 where none is claimed."""
    order = order_of(scheme.weak_order, "general")
    if point_law(scheme.increments) is not None:
        return local_orders.judge(
            law, scheme, this_run, lambda errors: errors.weak, lambda _: order,
            lambda _, order: order - MARGIN,
            1.0, tree_errors, ENOUGH,
        )  # fmt: skip
    return judge(
        law, scheme, this_run, assessing(scheme.weak_order, is_tilted(scheme), hold_level(scheme, this_run))
    )


def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    """Run the same paths again, or the same sum over all of them."""
    drawn: dict[str, Any] = {key: int(witness[key]) for key in ("seed", "paths") if key in witness}
    return run(law, scheme, Run(Effort(**drawn)))


law = Law(
    name="weak-order",
    statement="the errors of E y_i and E y_i y_j decrease with the claimed weak order (else: order 1)",
    source="§5",
    unit="slope",
    cost=0.1,
    run=about_noise(run),
    replay=replay,
)


def test_weak_order(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
