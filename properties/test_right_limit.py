"""The scheme converges to the Stratonovich solution of (1.1),
and not to another process such as the Itô solution.

The error is projected on the directions in which y(T) moves if the limit has too much drift, noise
or Itô's correction. This gives the share by which each of these is wrong. Shares are extrapolated
to h = 0 from three step sizes. Their confidence intervals are widened by the change of a share if
the coarsest step size is left out. The law holds if with confidence the shares of drift and noise
are less than LIMIT_RESOLUTION and the rms error falls with h. It is violated if a share differs
from zero by more than LIMIT_MIN_SHARE, or if neither the rms error nor a quantile of the error
falls.

A strong noise c hides the drift: if f has the slope L, the drift moves y by 1/(c√L) times as much
as the noise does. If the drift causes less than 1/COARSE_DRIFT_RATIO of all movement, it may
therefore be wrong by LIMIT_RESOLUTION/COARSE_DRIFT_RATIO of all movement. The law "local-mean"
judges the drift alone. Movements by rounding alone are not judged.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from sepv.properties._orders.convergence import StrongErrors, above_floor, floors, mean_square_order
from sepv.properties._orders.means import leading, limit_errors
from sepv.properties._sampled import pathwise, sparing
from sepv.properties._sequential import Assess, Assessment, is_tilted, judge

from sepv.errors import Skipped
from sepv.law import Effort, Finding, Law, Run, Verdict, require
from sepv.problem import Array, Problem, column
from sepv.schemes import Scheme, order_of

# An error by the share LIMIT_RESOLUTION of drift or noise must be detected; SPARED_RESOLUTION if
# the scheme takes one state at a time.
LIMIT_RESOLUTION, SPARED_RESOLUTION = 0.01, 0.02
# A smaller share is no violation, because powers of h that the extrapolation neglects could cause
# it.
LIMIT_MIN_SHARE = 0.001
# The least order of the rms error: half-way between order ½ and 0, the order of a scheme with a
# wrong limit.
LEAST_ORDER = 0.25
# A drift that causes less than 1/COARSE_DRIFT_RATIO of the movement is judged more coarsely. No
# problem of the suite has one.
COARSE_DRIFT_RATIO = 4.0


def assessing(
    tilted: bool, orders: tuple[float, ...] = (1.0,), resolution: float = LIMIT_RESOLUTION
) -> Assess:
    """Make the test of a limit: the shares and the fall of the error have the error probability
    alpha/2 each.

    The shares (`limit_errors`) by which drift and noise are wrong are means over paths. For a
    scheme of weak order 1 or more they expand in whole powers of h. For lower orders they may
    expand in powers of h^½ (as by differences over a length √h), and more paths are needed. If
    several `orders` are possible, a limit must be wrong by each of them.
    """

    def assess(problem: Problem, errors: StrongErrors, alpha: float, more: float) -> Assessment:
        for order in orders:
            of_noise = order_of(order, column(problem))
            assessment = _assessed(problem, errors, alpha, more, of_noise)
            if assessment.verdict is not Verdict.VIOLATED:
                break
        return assessment

    def _assessed(
        problem: Problem, errors: StrongErrors, alpha: float, more: float, order: float
    ) -> Assessment:
        if not above_floor(errors).any():
            text = "errors at the rounding floor at every step size"
            return Assessment(Verdict.HOLDS, 0.0, 0.0, 0.0, resolution, text)
        names, samples, sizes = limit_errors(errors, problem)
        if not names:
            raise Skipped(f"{problem.name} stands still at its initial state")
        limit = leading(samples, errors.h if order >= 1 else np.sqrt(errors.h), 0)
        half, off = limit.half(alpha / 2, more), np.abs(limit.value)
        sure, most = off - half - limit.remainder, off + half + limit.remainder
        hidden, rounding = _hidden(names, sizes), np.max(floors(errors)) / sizes
        least = np.maximum(LIMIT_MIN_SHARE * hidden, rounding)
        falls = stays = False
        if above_floor(errors).sum() >= 2:
            _, low, high = mean_square_order(errors, alpha / 2, more=more, weighted=tilted)
            falls, stays = low > LEAST_ORDER, high < LEAST_ORDER
        else:
            falls = bool(above_floor(errors)[0])  # errors of all finer steps are rounding
        # Of the shares that are certainly too large, the one that moves y most is reported.
        k = int(np.argmax(np.where(sure > least, sure * sizes, -np.inf)))
        if sure[k] > least[k]:
            text = f"{names[k]} of the limit is wrong by {100 * limit.value[k]:.3g} ± {100 * half[k]:.2g} %"
            return Assessment(
                Verdict.VIOLATED, off[k], sure[k], most[k], max(least[k], half[k] + limit.remainder[k]), text
            )
        text = ", ".join(
            f"{n} {100 * v:.2g} ± {100 * e:.2g} %" for n, v, e in zip(names, limit.value, half, strict=True)
        )
        text = f"limit off by: {text},"
        judged = [n for n, name in enumerate(names) if name in ("drift", "noise")]
        for n in [n for n in judged if hidden[n] > 1 or rounding[n] > resolution]:
            text += f" the {names[n]} moves y by {sizes[n] / np.max(sizes):.1e} of all,"
        # The largest possible share of drift or noise, relative to the factor by which it is judged
        # more coarsely.
        worst = max(float(most[n] / hidden[n]) if rounding[n] <= resolution else 0.0 for n in judged)
        if stays:
            text = f"the error does not fall; {text}"
            return Assessment(Verdict.VIOLATED, worst, worst, worst, resolution, text)
        verdict = Verdict.HOLDS if falls and worst < resolution else Verdict.INCONCLUSIVE
        return Assessment(verdict, worst, float(np.max(sure)), worst, resolution, text)

    return assess


def _hidden(names: list[str], sizes: Array) -> Array:
    """Return factors (K,) for the allowed errors of shares:
    above 1 for a cause that moves y little, 1 for noises.
    """
    moved = np.sqrt(sum(sizes[n] ** 2 for n, name in enumerate(names) if name in ("drift", "noise")))
    alone = np.array([name.startswith("noise") for name in names])
    return np.where(alone, 1.0, np.maximum(1.0, moved / (COARSE_DRIFT_RATIO * sizes)))


def mean_orders(scheme: Scheme) -> tuple[float, ...]:
    """Return possible orders of the means: the claimed weak order,
    else the mean-square order (or ½), and 1 if larger.

    A scheme of mean-square order ½ often has the weak order 1 without claiming it.
    """
    if scheme.weak_order is not None:
        return (scheme.weak_order,)
    order = 0.5 if scheme.mean_square_order is None else scheme.mean_square_order
    return (order,) if order >= 1 else (1.0, order)


def run(law: Law, scheme: Scheme, this_run: Run) -> Finding:
    """Extrapolate to h = 0 the shares by which drift and noise are wrong, on every problem,
    and judge the limit.

    A violation must also be one if the true order is ½, whatever is claimed: such a scheme has
    shares in powers of h^½, which contradict its right limit if they are extrapolated in powers
    of h.
    """
    resolution = SPARED_RESOLUTION if sparing(scheme, this_run.effort) else LIMIT_RESOLUTION
    orders = mean_orders(scheme)
    assess = assessing(is_tilted(scheme), orders, resolution)
    confirm = assessing(is_tilted(scheme), (*orders, 0.5), resolution)
    return judge(law, scheme, this_run, assess, at_least=False, confirm=confirm)


def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    """Repeat the run of a witness (a stored counterexample), with its seed and number of paths."""
    return run(law, scheme, Run(Effort(seed=int(witness["seed"]), paths=int(witness["paths"]))))


law = Law(
    name="right-limit",
    statement="paths converge to the Stratonovich solution: drift and noise are right to 1 %",
    source="(1.1)",
    unit="share",
    cost=0.1,
    run=pathwise(run),
    replay=replay,
    statistical=True,
)


def test_right_limit(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
