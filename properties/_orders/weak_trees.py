"""E g(y_N) for increments with a few values, as a sum over all paths of N steps instead of a
sample.

With n values and m noises a step has K = n^m possible results, and N steps have K^N, each with its
probability. The expectation is then a finite sum. E g(y(T)) is known by quadrature, so weak errors
are exact to rounding, and fall with slope q over N = 1, 2, … steps of [0, T]. T is short, because
K^N has to be small. The test shows whether local errors add up to the claimed order. There is no
false alarm by chance.
"""

from __future__ import annotations

import numpy as np
from sepv.properties._failed_step import first_failed
from sepv.properties._orders import local_errors as local
from sepv.properties._orders.gaussian import point_rule, rule
from sepv.properties._orders.local_errors import LocalErrors, against_moments, apart
from sepv.properties._problems_of import units_for

from sepv.errors import Skipped
from sepv.law import Run
from sepv.problem import Array, PolynomialSystem, Problem
from sepv.schemes import PointLaw, Scheme, guarded, point_law
from sepv.simulate import advance

# The end time T is short enough for slopes within 0.1 of their limits (0.25 on Lotka-Volterra), and
# long enough for errors far above rounding.
TREES_T = 0.0625
TREES_STEPS = (1, 2, 3, 4, 6, 8)
# The largest number of paths of N steps. Three values make 3⁸ paths with one noise, 9⁴ with two,
# 27³ with three.
PATHS_MAX = 20000
# The least number of different N for a slope. A slope that may refute an order needs one more.
LEAST_RESOLUTIONS = 3


def tree(
    scheme: Scheme, problem: Problem, start: Array, h: float, steps: int, law: PointLaw
) -> tuple[Array, Array, str]:
    """Return the ends (d, K^N) of all paths of N = `steps` steps, their probabilities,
    and a failure's text or "".
    """
    points = point_rule(problem.noises, law)
    y, weights = start[:, None], np.ones(1)
    dW = np.sqrt(h) * points.zeta
    for _ in range(steps):
        y0, noise = np.repeat(y, dW.shape[1], axis=1), np.tile(dW, weights.size)
        y, status, *_ = advance(scheme, problem, y0, h, noise)
        failed = first_failed(scheme, problem, y0, h, noise, status)
        if failed:
            return y, weights, failed
        weights = np.outer(weights, points.weights).ravel()
    return y, weights, ""


def tree_errors(scheme: Scheme, problem: Problem, _run: Run) -> LocalErrors:
    """Return weak errors at T from the problem's initial state for h = T/N;
    raise `Skipped` for too many noises.
    """
    law = point_law(scheme.increments)
    assert law is not None
    ends = len(law.values) ** problem.noises
    counts = [n for n in TREES_STEPS if ends**n <= PATHS_MAX]
    if len(counts) < LEAST_RESOLUTIONS:
        raise Skipped(
            f"{problem.name}: {ends} ends of a step are too many to sum over {LEAST_RESOLUTIONS} steps"
        )
    weak = 1.0 if scheme.weak_order is None else scheme.weak_order
    start = np.array(problem.initial, dtype=np.float64)
    units = units_for(scheme, problem)
    end = TREES_T * units.time
    nodes = rule(problem.noises, TREES_T, None, int(2 * weak + 8))
    known = local.moments_only(problem)
    if known and not isinstance(problem.data, PolynomialSystem):
        raise Skipped(
            f"{problem.name} has no closed form, and is not given as data: its means over a time are not known"
        )
    exact, flow = local.solutions_at(problem, start[:, None], [(end, nodes)])
    asked, steps = guarded(scheme), 0
    rows: list[tuple[float, float, float, float]] = []
    failed: list[tuple[float, str]] = []
    for count in counts if exact else ():
        ways, chances, stuck = tree(asked, problem, start, end / count, count, law)
        steps += sum(ends ** (n + 1) for n in range(count))
        if stuck:
            failed.append((end / count, stuck))
            rows.clear()  # only step sizes below all failures are used
            continue
        moved = (ways - start[:, None])[:, None] / units.length
        if known:
            errors = against_moments(moved, exact[0], chances, length=units.length)
        else:
            errors = apart(
                moved, chances, (exact[0] - start[:, None, None]) / units.length, nodes.weights, weak
            )
        rows.append((end / count, *errors))
    h, mean, rms, weakly = np.array(rows).reshape(-1, 4).T
    # Rounding and solver errors of a step add up over N steps.
    scale = counts[-1] * float(np.max(np.abs(start))) / units.length
    return LocalErrors(
        problem.name,
        h,
        mean,
        rms,
        weakly,
        (nodes.degree + 1) // 2,
        scale,
        flow / units.length,
        steps,
        tuple(failed),
    )
