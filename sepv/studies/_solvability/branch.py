"""The branch of solutions y1(Δ) of a step's equation y1 = y0 + Δ G(y0, y1),
followed from y0 at Δ = 0 to its end.

The method is pseudo-arclength continuation (H. B. Keller, 1977) of (z, Δ) with z = y1 − y0. A step
goes along the tangent of the curve F(z, Δ) = z − Δ G = 0 and is corrected across the tangent. A
fold, where ∂F/∂z is singular and dΔ/ds changes sign, is then a point like any other. The branches
of all states y0 are followed together.

The solution y1 lies on the set {H = H(y0)}. If this set is bounded, so are all solutions, and by
the Leray-Schauder theorem the curve meets every Δ, beyond folds if need be. If it is not bounded,
solutions may end.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sepv.core.arrays import Lanes
from sepv.core.formula import IncrementFunction, JacobianFunction
from sepv.core.newton import Flagged, Status, Worded, newton
from sepv.errors import UsageError
from sepv.problem import Array, Problem, linear_solve
from sepv.record import TINY
from sepv.schemes import BY_FILE, Implicit, Scheme, energy_preserving

BRANCH_MAX_STEPS = 4000
# The longest arclength of a step, to be multiplied by 1 + |z| so that a branch can reach infinity;
# and the shortest.
MAX_ARCLENGTH, MIN_ARCLENGTH = 0.05, 1e-9
# The arclength to which a fold is located. Δ has a maximum at the fold, so that the error of Δ is
# about its square.
FOLD = 1e-6
# The least cosine of the angle by which the tangent turns in a step: arccos 0.95 ≈ 18°.
LEAST_TURN_COSINE = 0.95
# If |z| is more than this multiple of |y0|, the branch is taken to escape to infinity.
ESCAPE_FACTOR = 1e6

# The width of central differences, relative to the component; its cube is of the size of a rounding
# error.
CENTRAL_WIDTH = 6e-6

# For each scheme y1 = y0 + R with R linear in one Δ: the functions R and ∂R/∂y1.
BRANCH_EQUATIONS: dict[str, tuple[IncrementFunction, JacobianFunction]] = {
    scheme.name: (step.increment, step.jacobian)
    for scheme in map(BY_FILE.__getitem__, ("energy_preserving", "midpoint", "both_invariants"))
    if isinstance(step := scheme.step, Implicit)
}


class End(Worded):
    """The reason why a branch of solutions ends."""

    RANGE = 0, "reaches the end of the range"
    FOLD = 1, "turns back at a fold"
    BOUNDARY = 2, "reaches the boundary of the domain"
    INFINITY = 3, "escapes to infinity"
    LOST = 4, "could not be followed further"


@dataclass(frozen=True)
class Branch:
    """The branches of solutions from M states, for Δ > 0 or for Δ < 0.

    reach : (M,), the |Δ| up to which the branch is a function y1(Δ), at most the end of the range
        of Δ
    end : (M,), the `End` of each branch
    delta, z : Δ (P, M) and y1 − y0 (P, d, M) at P points of each curve from Δ = 0 to its end, with
        NaN after the end
    """

    reach: Array
    end: np.ndarray
    delta: Array
    z: Array


def follow(problem: Problem, y0: Array, furthest: float, scheme: Scheme = energy_preserving) -> Branch:
    """Follow the branches of solutions from the states y0 (d, M), for Δ from 0 to `furthest`,
    which may be negative.

    Raises UsageError for a scheme whose step is not an equation in Δ alone.
    """
    if scheme.name not in BRANCH_EQUATIONS:
        raise UsageError(
            expected=f"a scheme whose step is an equation in Δ alone: {', '.join(BRANCH_EQUATIONS)}",
            received=repr(scheme.name),
            remedy="the map of energy-preserving shows what its relatives can expect",
        )
    if not (np.isfinite(furthest) and furthest != 0):
        raise UsageError(
            expected="a range of Δ, finite and not 0", received=repr(furthest), remedy="give the largest |Δ|"
        )
    with np.errstate(all="ignore"):
        return _Follower(problem, y0, furthest, BRANCH_EQUATIONS[scheme.name][0]).run()


class _Follower:
    """The curves (z, Δ) of solutions, z = y1 − y0, for M states y0 while they are followed.

    The unknowns w (d + 1, M) are z divided by the largest |component| of y0, and Δ divided by
    `furthest`.
    """

    def __init__(self, problem: Problem, y0: Array, furthest: float, increment: IncrementFunction) -> None:
        self.problem, self.y0, self.furthest, self.increment = problem, y0, furthest, increment
        d, M = y0.shape
        self.scale = self.scale_of(y0)
        self.w = np.zeros((d + 1, M))
        self.tangent = np.zeros((d + 1, M))
        self.ds = np.full(M, 1e-3)
        self.end = np.full(M, -1)

    def equations(self, w: Array, lanes: np.ndarray) -> tuple[Array, Array]:
        """The scaled F = z − Δ G (d, M) and ∂F/∂w (d, d + 1, M) at w (d + 1, M),
        for the states `lanes`.
        """
        y0, scale = self.y0[:, lanes], self.scale[lanes]
        delta, z = self.furthest * w[-1], scale * w[:-1]
        one = np.ones((1, lanes.size))
        G = self.increment(self.problem, y0, y0 + z, one).value
        K = np.stack([self.slope(y0, y0 + z, one, k) for k in range(len(z))], axis=1)
        F = w[:-1] - delta * G / scale
        J = np.concatenate(
            [np.eye(len(w) - 1)[..., None] - delta * K, (-self.furthest * G / scale)[:, None]], axis=1
        )
        return F, J

    def slope(self, y0: Array, y1: Array, one: Array, k: int) -> Array:
        """The derivative ∂G/∂y1_k by central differences, with an error of about 1e-10.

        Folds are located by these derivatives, because the analytic ones are averages that are
        exact for some H only.
        """
        size = np.abs(y1[k])
        width = CENTRAL_WIDTH * np.where(size > 1e-3 * self.scale_of(y1), size, 1e-3 * self.scale_of(y1))
        if self.problem.domain is not None:
            width = np.where(size > 0, np.minimum(width, CENTRAL_WIDTH * size), width)
        ahead, behind = y1.copy(), y1.copy()
        ahead[k], behind[k] = y1[k] + width, y1[k] - width
        up, down = (self.increment(self.problem, y0, y, one).value for y in (ahead, behind))
        difference: Array = (up - down) / (ahead[k] - behind[k])
        return difference

    @staticmethod
    def scale_of(y: Array) -> Array:
        """The scale of each state: the absolute value of its largest component."""
        return np.asarray(np.maximum(np.abs(y).max(axis=0), TINY))

    def run(self) -> Branch:
        d, M = self.y0.shape
        active = np.arange(M)
        self.tangent[:, active] = self.direction(self.w, active, np.eye(d + 1)[:, -1:] * np.ones(M))
        points = [self.w.copy()]
        for _ in range(BRANCH_MAX_STEPS):
            active = np.flatnonzero(self.end < 0)
            if not active.size:
                break
            self.advance(active)
            points.append(np.where(self.end < 0, self.w, np.nan))
            ended = (self.end[active] >= 0) & (self.end[active] != End.LOST)
            points[-1][:, active[ended]] = self.w[:, active[ended]]
        self.end[self.end < 0] = End.LOST
        curve = np.stack(points)
        reach = np.abs(self.furthest) * np.minimum(self.w[-1], 1.0)
        return Branch(reach, self.end, self.furthest * curve[:, -1], self.scale * curve[:, :-1])

    def direction(self, w: Array, lanes: np.ndarray, before: Array) -> Array:
        """The unit tangents of the curves at w, (d + 1, M),
        with a positive component along `before`.
        """
        _, J = self.equations(w, lanes)
        side = np.zeros_like(w)
        side[-1] = 1.0
        t = linear_solve(np.concatenate([J, before[None]]), side)
        return np.asarray(t / np.sqrt((t * t).sum(axis=0)))

    def advance(self, lanes: np.ndarray) -> None:
        """Try a step on each branch of `lanes`: keep it if Newton converges and the tangent turns
        little; note ends.
        """
        t, ds = self.tangent[:, lanes], self.ds[lanes]
        w, good, quick = self.correct(self.w[:, lanes] + ds * t, t, lanes)
        new = self.direction(w, lanes, t)
        good = np.asarray(good & np.isfinite(new).all(axis=0) & ((new * t).sum(axis=0) > LEAST_TURN_COSINE))
        inside = np.ones(lanes.size, dtype=bool)
        if self.problem.domain is not None:
            inside = np.asarray(
                self.problem.domain(self.y0[:, lanes] + self.scale[lanes] * w[:-1]), dtype=bool
            )
        folded = good & inside & (new[-1] <= 0)
        # A step across a fold is accepted only if it is so short that its end counts as the fold.
        taken = good & inside & (~folded | (ds <= FOLD))
        here = lanes[taken]
        self.w[:, here], self.tangent[:, here] = w[:, taken], new[:, taken]
        self.ds[lanes] = np.where(taken, np.where(quick, 1.5, 1.0) * ds, 0.5 * ds)
        self.ds[lanes] = np.minimum(
            self.ds[lanes], MAX_ARCLENGTH * (1 + np.abs(self.w[:, lanes]).max(axis=0))
        )
        self.end[lanes[taken & folded]] = End.FOLD
        self.end[lanes[taken & ~folded & (w[-1] >= 1)]] = End.RANGE
        self.end[lanes[taken & (np.abs(w[:-1]).max(axis=0) > ESCAPE_FACTOR)]] = End.INFINITY
        short = ~taken & (self.ds[lanes] < MIN_ARCLENGTH)
        self.end[lanes[short]] = np.where(inside[short], End.LOST, End.BOUNDARY)

    def correct(self, start: Array, t: Array, lanes: np.ndarray) -> tuple[Array, np.ndarray, np.ndarray]:
        """The points of the curves on the hyperplanes through `start` (d + 1, M) normal to t,
        and two flags for each.

        The flags say if Newton's iteration for F = 0 converged, and if it took at most four
        iterations.
        """

        def advance(values: Any, numbers: Lanes) -> tuple[Array, Array, Flagged]:
            w, across = np.reshape(values, (len(values), -1)), t[:, numbers]
            F, J = self.equations(w, lanes[numbers])
            F = np.concatenate([F, (across * (w - start[:, numbers])).sum(axis=0)[None]])
            return F, linear_solve(np.concatenate([J, across[None]]), F), Flagged(False, True)

        root = newton(advance, np.ones_like(start), start, np.arange(lanes.size))
        return root.value, root.status == Status.CONVERGED, root.iterations <= 4
