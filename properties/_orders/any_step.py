"""Laws about one small step, at steps h drawn from the whole range where they can speak.

From below the range ends where a fault could not be told from rounding. From above it ends where a statement about
small h loses its meaning: with L a bound of |f′| and fields c_jf, where x = L(h + Σ c_j|ΔW_j|) is no longer small. A
problem that is polynomial data is posed in a longer unit of time there, H → νH, which makes x as small as needed for
any h: so a scheme that is wrong in some window of h, in its own units, is met in it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from sepv.properties._failed_step import row
from sepv.properties._orders.local_errors import step_sizes, two_noises
from sepv.properties._orders.local_orders import CLEAR, FLOOR, MARGIN, strong_order

from sepv.errors import Skipped
from sepv.exact import FlowFailure, exact_flow
from sepv.problem import (
    Array,
    HamiltoniansProblem,
    PolynomialSystem,
    Problem,
    StructuresProblem,
    Systems,
    column,
    damping_of,
)
from sepv.problems import started
from sepv.record import EPS, poly
from sepv.schemes import Scheme, guarded
from sepv.simulate import advance
from sepv.solve import Status
from sepv.verification._cases.users_problems import problems_of
from sepv.verification._law import Run
from sepv.verification._units import units_for

# Pairs of step sizes, one drawn from each of as many equal parts of the range: at most 2.1 octaves are between two, so
# that no decade is left out. From 2⁻⁴⁰, where an error of order 1 is 1e-12 of y, to 2⁻², where A_h is 1.66 for k = 1.
PAIRS, SMALLEST, LARGEST = 36, 2.0**-40, 2.0**-2
# The ratio of the two step sizes of a pair.
APART = 4.0
# Factors on c_j, in turn: the problem's own noises, and larger and smaller ones.
LOUDER = (1.0, 16.0, 1 / 16)
# The range's upper end in the problem's own time, as a share of the coarsest step of a slope: errors are O(x) from the
# first term of their expansion, and slopes change by O(x).
FINER = 2.0**-6
# Errors in the same units of time are equal for every formula of hf and ΔW_jf. The room is for schemes that are not
# such a formula, but choose between two of different constants.
ROOM = 2.0
# Larger errors are cut to this size, so that their squares stay finite.
MOST = 1e100


def drawn(rng: np.random.Generator, low: float, high: float, count: int) -> Array:
    """Draw `count` numbers, one from each of as many equal parts of [log low, log high]."""
    share = (np.arange(count) + rng.random(count)) / count
    return np.asarray(low * (high / low) ** share)


def scaled(problem: Problem, factor: float, louder: float = 1.0) -> Problem | None:
    """The problem with H, H_j, vectors and damping times `factor` and c_j times `louder`; None without data."""
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
        damping=factor * data.damping,
    )
    found: Problem = started(changed, problem.name, np.asarray(problem.initial).tolist())
    return found


@dataclass(frozen=True, eq=False)
class Pair:
    """Errors of a step of h and of one of h / APART, in a unit of time in which h is `unit` times as long."""

    problem: Problem
    h: float
    unit: float
    louder: float
    errors: Array  # (2,)
    floor: float

    def slope(self) -> float:
        """The order in h; of errors below the floor the one to the floor, which is a lower bound."""
        coarse, fine = np.maximum(self.errors, self.floor)
        return float(np.log(coarse / fine) / np.log(APART))

    def growth(self, other: Pair, order: float) -> float:
        """The most by which a sum of terms u^a v^b, 2a + b = 2p + 1, with positive factors is larger than in `other`.

        u is the finer h in the problem's own unit of time, v = Σ c_j√u in that unit: all that an error of order p has.
        """
        longer = np.sqrt(self.unit * self.h / (other.unit * other.h))
        return float((longer * max(1.0, self.louder / other.louder)) ** (2 * order + 1))


def lower_order(scheme: Scheme, run: Run) -> tuple[tuple[float, float, str] | None, int]:
    """Find a slope that is too low at some h: the slope, the one needed and both in words, or None; and the steps made.

    In the problem's own unit of time a right scheme's error is Σ K_ab u^a v^b (1 + O(√h)), 2a + b = 2p + 1, with the
    same K_ab whatever that unit is. So a pair accuses where its slope is that of a lower order, and its error exceeds
    by ROOM what follows from the pairs of the right slope with the same noise, or else the problem's own, and from the
    longest step whose error may be as large as the floor. Both are needed: a scheme that divides steps beyond a length
    of its own has small errors there, with a slope of ½. Where no pair has the right slope nobody is accused: there
    the slope of the law itself is wrong.
    """
    if scheme.asks:
        return None, 0
    listed = problems_of(scheme)
    if listed is None:
        if scheme.systems not in (Systems.SINGLE, Systems.NAMBU):
            return None, 0
        listed = (two_noises(),)
    steps = 0
    for problem in listed:
        if (
            isinstance(problem, (HamiltoniansProblem, StructuresProblem))
            or damping_of(problem)
            or not problem.noises
        ):
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
    needed = order + 0.5 - MARGIN
    visible = [pair for pair in pairs if pair.errors[1] > pair.floor]
    right = [pair for pair in visible if pair.slope() >= needed]
    for pair in (pair for pair in visible if pair.slope() < needed):
        louder = pair.louder if any(p.louder == pair.louder for p in right) else 1.0
        beside = [p for p in right if p.louder == louder]
        # The longest step with an error below the floor: it could have had one as large as that.
        hidden = [p for p in pairs if p.louder == louder and p not in visible]
        beside += sorted(hidden, key=lambda p: p.unit * p.h)[-1:] if beside else []
        most = max((max(p.floor, p.errors[1]) * pair.growth(p, order) for p in beside), default=np.inf)
        if pair.errors[1] > ROOM * most:
            text = (
                f"{problem.name}, H times {pair.unit:.3g}, c = {row(pair.problem.c)}: the rms error falls from "
                f"{pair.errors[0]:.3g} to {pair.errors[1]:.3g} between h = {pair.h:.6g} and {pair.h / APART:.6g}, with "
                f"slope {pair.slope():.2f}, {needed:g} needed; at other h it is at most {most:.3g} in the same units"
            )
            return pair.slope(), needed, text
    return None


def _pairs(scheme: Scheme, problem: Problem, seed: int) -> Iterator[Pair]:
    """The pairs of a problem, from its initial state, at four increments ±ξ√h, ±ξ′√h that are the same for all."""
    rng, units = np.random.default_rng((seed, 20140203)), units_for(scheme, problem)
    order, m = strong_order(scheme, column(problem)), problem.noises
    xi = rng.uniform(0.5, 1.6, (m, 2)) * rng.choice([-1.0, 1.0], (m, 2))
    xi = np.concatenate([xi, -xi], axis=1)
    start = np.asarray(problem.initial, dtype=np.float64)
    top = FINER * float(step_sizes(order)[0])
    made = []
    given = bool(scheme.problems) or scaled(problem, 0.5) is None
    largest = top * units.time if given else LARGEST
    for n, h in enumerate(drawn(rng, SMALLEST * largest / LARGEST, largest, PAIRS)):
        louder = 1.0 if given else LOUDER[n % len(LOUDER)]
        unit = 1.0 if given else min(1.0, top / (h * max(1.0, louder) ** 2))
        # With t = τs, c_j√τ is the coefficient of the same noise.
        posed = scaled(problem, unit, louder / np.sqrt(unit))
        assert posed is not None
        made.append((posed, float(h), unit, louder))
    times = [
        unit * posed.random_step(size, np.sqrt(size) * xi)
        for posed, h, unit, _ in made
        for size in (h, h / APART)
    ]
    found = exact_flow(problem, np.concatenate(times), start, dense=True)
    ends = iter(np.split(found.y, len(times), axis=1))
    scale = float(np.max(np.abs(start)))
    floor = CLEAR * (FLOOR * EPS + scheme.precision) * scale + 2 * found.error
    asked, y0 = guarded(scheme), np.repeat(start[:, None], xi.shape[1], axis=1)
    for posed, h, unit, louder in made:
        errors, failed = [], False
        for size in (h, h / APART):
            y, status, *_ = advance(asked, posed, y0, size, np.sqrt(size) * xi)
            apart = np.minimum(np.abs(y - next(ends)), MOST)
            errors.append(float(np.sqrt(np.mean(np.sum(apart**2, axis=0)))))
            failed = failed or bool(np.any(status != Status.CONVERGED))
        if not failed:
            yield Pair(posed, h, unit, louder, np.array(errors), floor)
