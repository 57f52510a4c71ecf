"""Tests of one small step at step sizes h drawn from the whole range in which laws about small h
apply.

Below this range a fault could not be distinguished from rounding. Let L be a bound of |f′|. Above
the range x = L(h + Σ c_j|ΔW_j|) is not small, and statements about small h have no meaning. For
polynomial data, H is multiplied at such h by a ν < 1 (a longer unit of time), which makes x as
small as needed. So a scheme that is wrong in some interval of h is also tested at h in this
interval.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from sepv.properties._failed_step import row
from sepv.properties._orders.local_errors import step_sizes, two_noises
from sepv.properties._orders.local_orders import LOCAL_MARGIN, SOLVER_CLEAR, SOLVER_FLOOR, strong_order
from sepv.properties._problems_of import problems_of, units_for

from sepv.core.newton import Status
from sepv.errors import Skipped
from sepv.exact import FlowFailure, exact_flow
from sepv.law import Run
from sepv.problem import (
    Array,
    PolynomialSystem,
    Problem,
    column,
    one_field,
    scaled_damping,
)
from sepv.problems import started
from sepv.record import EPS, poly
from sepv.schemes import Scheme, guarded
from sepv.simulate import advance

# Step sizes are drawn from STEP_SIZE_PAIRS equal parts of the range, at most 2.1 octaves apart, so
# that no decade is left out. The range is from 2⁻⁴⁰, where an error of size h is 1e-12 of y, to
# 2⁻², where A_h is 1.66 for k = 1.
STEP_SIZE_PAIRS, ANY_STEP_MIN, ANY_STEP_MAX = 36, 2.0**-40, 2.0**-2
# The ratio of the two step sizes of a pair.
STEP_RATIO = 4.0
# Factors on the c_j, used in turn: the problem's own noises, larger ones and smaller ones.
NOISE_FACTORS = (1.0, 16.0, 1 / 16)
# The upper end of the range in the problem's own time, as a share of the coarsest step size for
# slopes. Errors differ from the first term of their expansion by O(x), and slopes from its power by
# O(x).
RANGE_UPPER_END = 2.0**-6
# If y1 depends only on hf and ΔW_jf, errors in the same unit of time are equal. The factor
# ANY_STEP_FACTOR is for schemes that choose between two formulas with different constants.
ANY_STEP_FACTOR = 2.0
# Errors are cut off at this size, so that their squares stay finite.
LARGEST_ERROR = 1e100


def drawn(rng: np.random.Generator, low: float, high: float, count: int) -> Array:
    """Draw `count` numbers, one from each of as many equal parts of [log low, log high]."""
    share = (np.arange(count) + rng.random(count)) / count
    return np.asarray(low * (high / low) ** share)


def scaled(problem: Problem, factor: float, louder: float = 1.0) -> Problem | None:
    """Return a problem with H, H_j, vectors, damping times `factor` and c_j times `louder`;
    None if it is not data.
    """
    data = problem.data
    if factor == louder == 1:
        return problem
    if not isinstance(data, PolynomialSystem) or problem.initial is None:
        return None
    changed = replace(
        data,
        hamiltonian=poly.scale(factor, data.hamiltonian),
        noise=tuple(louder * c for c in data.noise),
        noise_hamiltonians=tuple(poly.scale(factor, H) for H in data.noise_hamiltonians),
        noise_vectors=tuple(tuple(factor * g for g in vector) for vector in data.noise_vectors),
        damping=scaled_damping(data.damping, factor),
    )
    found: Problem = started(changed, problem.name, np.asarray(problem.initial).tolist())
    return found


@dataclass(frozen=True, eq=False)
class Pair:
    """Errors of two steps, h and h / STEP_RATIO, for a problem whose H and noise were multiplied
    (`_pairs`).
    """

    problem: Problem
    h: float
    unit: float
    louder: float
    errors: Array  # (2,)
    floor: float

    def slope(self) -> float:
        """Return the slope between both errors.

        It is a lower bound, because errors below `floor` count as `floor`.
        """
        coarse, fine = np.maximum(self.errors, self.floor)
        return float(np.log(coarse / fine) / np.log(STEP_RATIO))

    def growth(self, other: Pair, order: float) -> float:
        """Bound the ratio of this pair's error to that of `other`,
        if both are sums of K_ab u^a v^b with K_ab ≥ 0.

        Here 2a + b = 2p + 1 with p = `order`. In the problem's own unit of time u is the finer h,
        and v = Σ c_j√u.
        """
        longer = np.sqrt(self.unit * self.h / (other.unit * other.h))
        return float((longer * max(1.0, self.louder / other.louder)) ** (2 * order + 1))


def lower_order(scheme: Scheme, run: Run) -> tuple[tuple[float, float, str] | None, int]:
    """Return (slope, needed slope, text) of an error that falls too slowly, or None,
    and the number of steps made.

    In the problem's own unit of time a scheme of order p has errors Σ K_ab u^a v^b (1 + O(√h)),
    with K_ab independent of the unit (a, b, u, v: see `Pair.growth`). So a pair's error is bounded
    by those of pairs with the same noise, or else with the problem's own: pairs of the right slope,
    and the longest pair with an error below the floor. A pair violates the law if its slope is too
    low and its error exceeds ANY_STEP_FACTOR times this bound. The slope does not suffice: a scheme
    that divides steps above some length has small errors of slope ½ there. If no pair has the right
    slope, no violation is found here, because then the slope that the law itself measures is wrong.
    """
    if scheme.asks:
        return None, 0
    listed = problems_of(scheme)
    if listed is None:
        if one_field not in scheme.systems.facts:
            return None, 0
        listed = (two_noises(),)
    steps = 0
    for problem in listed:
        if not one_field(problem) or not problem.noises:
            continue
        try:
            pairs = list(_pairs(scheme, problem, run.effort.seed))
        except (Skipped, FlowFailure):
            continue
        steps += 8 * len(pairs)
        if (found := _judged(scheme, problem, pairs)) is not None:
            return found, steps
    return None, steps


def _judged(scheme: Scheme, problem: Problem, pairs: list[Pair]) -> tuple[float, float, str] | None:
    order = strong_order(scheme, column(problem))
    needed = order + 0.5 - LOCAL_MARGIN
    visible = [pair for pair in pairs if pair.errors[1] > pair.floor]
    right = [pair for pair in visible if pair.slope() >= needed]
    for pair in (pair for pair in visible if pair.slope() < needed):
        louder = pair.louder if any(p.louder == pair.louder for p in right) else 1.0
        beside = [p for p in right if p.louder == louder]
        # Of the steps with an error below the floor the longest is used, as if its error were the
        # floor.
        hidden = [p for p in pairs if p.louder == louder and p not in visible]
        beside += sorted(hidden, key=lambda p: p.unit * p.h)[-1:] if beside else []
        most = max((max(p.floor, p.errors[1]) * pair.growth(p, order) for p in beside), default=np.inf)
        if pair.errors[1] > ANY_STEP_FACTOR * most:
            text = (
                f"{problem.name}, H times {pair.unit:.3g}, c = {row(pair.problem.c)}: the rms error falls from "
                f"{pair.errors[0]:.3g} to {pair.errors[1]:.3g} between h = {pair.h:.6g} and {pair.h / STEP_RATIO:.6g}, "
                f"with slope {pair.slope():.2f}, {needed:g} needed; "
                f"at other h it is at most {most:.3g} in the same units"
            )
            return pair.slope(), needed, text
    return None


def _pairs(scheme: Scheme, problem: Problem, seed: int) -> Iterator[Pair]:
    """Yield pairs of steps from the initial state, with the four increments ±ξ√h, ±ξ′√h;
    all pairs share ξ and ξ′.
    """
    rng, units = np.random.default_rng((seed, 20140203)), units_for(scheme, problem)
    order, m = strong_order(scheme, column(problem)), problem.noises
    xi = rng.uniform(0.5, 1.6, (m, 2)) * rng.choice([-1.0, 1.0], (m, 2))
    xi = np.concatenate([xi, -xi], axis=1)
    start = np.asarray(problem.initial, dtype=np.float64)
    top = RANGE_UPPER_END * float(step_sizes(order)[0])
    made = []
    given = bool(scheme.problems) or scaled(problem, 0.5) is None
    largest = top * units.time if given else ANY_STEP_MAX
    for n, h in enumerate(drawn(rng, ANY_STEP_MIN * largest / ANY_STEP_MAX, largest, STEP_SIZE_PAIRS)):
        louder = 1.0 if given else NOISE_FACTORS[n % len(NOISE_FACTORS)]
        unit = 1.0 if given else min(1.0, top / (h * max(1.0, louder) ** 2))
        # In the time s = t/τ, τ = `unit`, the system is dy = τf(ds + Σ c_j/√τ dW_j).
        posed = scaled(problem, unit, louder / np.sqrt(unit))
        assert posed is not None
        made.append((posed, float(h), unit, louder))
    times = [
        unit * posed.random_step(size, np.sqrt(size) * xi)
        for posed, h, unit, _ in made
        for size in (h, h / STEP_RATIO)
    ]
    found = exact_flow(problem, np.concatenate(times), start, dense=True)
    ends = iter(np.split(found.y, len(times), axis=1))
    scale = float(np.max(np.abs(start)))
    floor = SOLVER_CLEAR * (SOLVER_FLOOR * EPS + scheme.precision) * scale + 2 * found.error
    asked, y0 = guarded(scheme), np.repeat(start[:, None], xi.shape[1], axis=1)
    for posed, h, unit, louder in made:
        errors, failed = [], False
        for size in (h, h / STEP_RATIO):
            y, status, *_ = advance(asked, posed, y0, size, np.sqrt(size) * xi)
            apart = np.minimum(np.abs(y - next(ends)), LARGEST_ERROR)
            errors.append(float(np.sqrt(np.mean(np.sum(apart**2, axis=0)))))
            failed = failed or bool(np.any(status != Status.CONVERGED))
        if not failed:
            yield Pair(posed, h, unit, louder, np.array(errors), floor)
