"""For friction with a quadratic V the stationary mean and covariance of a scheme differ from the exact ones by O(h^q).

q is the claimed weak order, 1 without a claim (D. Talay, Stochastics and Stochastics Reports 29, 1990). Both
distributions are computed and not sampled (`sepv.properties._stationary`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from sepv.properties._orders.local_orders import judge_slope
from sepv.properties._stationary import Stationary, balanced, of_step

from sepv.errors import Unasked
from sepv.files import finite
from sepv.problem import Array
from sepv.record import EPS
from sepv.schemes import Scheme, order_of
from sepv.verification import Effort, Finding, Law, Run, Verdict, require

# Step sizes in units of 1/|λ| for the fastest eigenvalue λ of the drift. Coarser ones are unstable for some schemes.
SIZES = 2.0 ** -np.arange(1.0, 9.0)
# Half of the distance of orders: the error is a series in whole powers of h.
MARGIN = 0.5
# Errors below ROUNDING eps times the condition of the equations may be rounding, and above CLEAR times that are not.
ROUNDING, CLEAR = 64.0, 16.0


def error(found: Stationary, wanted: Stationary) -> float:
    """The largest error of a mean, and of a covariance, in standard deviations of the exact distribution."""
    sizes = np.sqrt(np.diag(wanted.covariance))
    off = (found.covariance - wanted.covariance) / np.outer(sizes, sizes)
    return float(max(np.max(np.abs(off)), np.max(np.abs((found.mean - wanted.mean) / sizes))))


def words(name: str, found: Stationary, wanted: Stationary, h: float) -> str:
    """Both covariances at one step size."""
    pair = " ".join(f"{v:.6g}" for v in np.diag(found.covariance))
    return f"{name}: variances {pair} at h = {h:.3g}, exact {' '.join(f'{v:.6g}' for v in np.diag(wanted.covariance))}"


def run(law: Law, scheme: Scheme, this_run: Run) -> Finding:
    """Judge the power of h in the error of the stationary distribution, on each problem with a quadratic V."""
    order = order_of(scheme.weak_order, "additive")
    lines, slopes, measured, checks = list[str](), [], list[dict[str, Any]](), 0
    why = ""
    try:
        for problem, wanted in balanced(scheme, this_run.effort.seed):
            h, errors, condition, last = list[float](), list[float](), 1.0, ""
            for share in SIZES:
                size = float(share * wanted.time)
                found = of_step(scheme, problem, size, wanted)
                checks += 1 + 2 * problem.dimension
                if isinstance(found, str):
                    why, h, errors = found, [], []
                    continue
                h.append(size)
                errors.append(error(found, wanted))
                condition = max(condition, found.condition, wanted.condition)
                last = last if len(h) > 1 else words(problem.name, found, wanted, size)
            if not h:
                lines.append(f"{problem.name}: skipped, {why}")
                continue
            rounding = (ROUNDING * EPS + scheme.precision) * condition
            seen = judge_slope(np.array(h), np.array(errors), order - MARGIN, rounding, CLEAR * rounding)
            slopes.append(seen)
            measured.append(
                {
                    "problem": problem.name,
                    "h": h,
                    "error": errors,
                    "slope": finite(seen.value),
                    "needed": order - MARGIN,
                }
            )
            lines.append(f"{problem.name}: {seen.text}, {order - MARGIN:g} needed")
            if seen.verdict is not Verdict.HOLDS:
                lines += [last, f"errors {_row(errors)} for h = {_row(h)}"]
    except Unasked as reason:
        return law.finding(Verdict.NOT_APPLICABLE, message=reason.reason)
    if not slopes:
        return law.finding(Verdict.NOT_APPLICABLE, message=why)
    verdict = next(
        (v for v in (Verdict.VIOLATED, Verdict.INCONCLUSIVE) if any(s.verdict is v for s in slopes)),
        Verdict.HOLDS,
    )
    worst = min((s.value for s in slopes if s.verdict is verdict), default=np.nan)
    return law.finding(
        verdict, defect=worst if np.isfinite(worst) else None, bound=order - MARGIN, at_least=True, checks=checks,
        message="\n".join(lines), witness={"measured": measured}, replay=f"--law {law.name}",
    )  # fmt: skip


def _row(values: list[float] | Array) -> str:
    return ", ".join(f"{v:.3g}" for v in values)


def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:  # noqa: ARG001 - it has nothing random
    """Measure again: a witness is the measured errors."""
    return run(law, scheme, Run(Effort()))


law = Law(
    name="equilibrium",
    statement="with friction and quadratic V, the stationary mean and covariance are exact up to O(h^q)",
    source="Talay (1990)",
    unit="slope",
    cost=0.2,
    middle="a step with a state is no map of y alone",
    run=run,
    replay=replay,
)


def test_equilibrium(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
