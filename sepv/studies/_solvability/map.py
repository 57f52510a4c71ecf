"""The map of solvability: where on an exact orbit a step Δ has a solution,
and how probable steps without one are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sepv.core.newton import Status, Worded
from sepv.core.step import solve
from sepv.exact import exact_flow
from sepv.problem import Array, Problem
from sepv.record import gauss_legendre
from sepv.schemes import Scheme, energy_preserving
from sepv.simulate import truncation_bound
from sepv.studies._solvability.branch import BRANCH_EQUATIONS, Branch, End, follow

# A solution found by Newton counts as the connected one if the two differ by at most this fraction
# of |y0| + |y1 − y0|. Both have errors of rounding times a condition number, which grows towards
# the fold.
SAME_SOLUTION_TOLERANCE = 1e-4
# The search for shorter branches between the states: rounds, minima per round, new states on either
# side of a minimum.
REFINING_ROUNDS, ROUND_MINIMA, MINIMUM_POINTS = 3, 2, 4
# Gauss nodes for each noise but one: the integrand is smooth except for two jumps of size
# P(|ξ| > A_h).
NOISE_NODES = 128


class Ending(Worded):
    """The result at one y0 and Δ: whether a solution connected to y0 exists,
    and whether Newton's method finds it.
    """

    FOUND = 0, "connected solution, found"
    MISSED = 1, "connected solution, not found"
    ANOTHER = 2, "another solution found"
    NONE = 3, "no connected solution, none found"
    UNKNOWN = 4, "branch lost"


@dataclass(frozen=True)
class Shortest:
    """Branches from R further states of the exact orbit, at times theta (R,),
    near states with the shortest branches.

    forward, backward : (R,), the |Δ| that the branches reach for Δ > 0 and for Δ < 0
    """

    theta: Array
    forward: Array
    backward: Array


@dataclass(frozen=True)
class Map:
    """The solvability of a scheme's steps Δ from states along an exact orbit.

    Attributes
    ----------
    theta, states : times (M,) of the exact flow from the initial state, and the states (d, M) at
        these times. Exact solutions of (1.1) stay on this orbit; numerical paths may leave it
        (`sepv.studies._solvability.paths`).
    delta : (K,), the grid of Δ, with both signs
    findings : (K, M), the `Ending` for each Δ and state
    forward, backward : the branches for Δ > 0 and Δ < 0
    refined : branches from further states, near those with the shortest branches
    """

    problem: Problem
    scheme: Scheme
    theta: Array
    states: Array
    delta: Array
    findings: np.ndarray
    forward: Branch
    backward: Branch
    refined: Shortest

    @property
    def safe(self) -> tuple[float, float]:
        """The range (−a, b) of Δ in which all branches found, of the map and of `refined`,
        have solutions.

        For other states of the orbit this is no bound, but the end of a branch in a fold varies
        continuously with y0.
        """
        ends = [(self.backward.reach, self.forward.reach), (self.refined.backward, self.refined.forward)]
        low, high = (float(min(r[side].min(initial=np.inf) for r in ends)) for side in (0, 1))
        return -low, high

    def chances(self, h: float, k: int | None) -> Array:
        """The probabilities (M,), for each state of the map,
        that the Δ of a step h is beyond the state's branches.
        """
        return chance_outside(h, self.problem.c, -self.backward.reach, self.forward.reach, k)

    def worst(self, h: float, k: int | None) -> float:
        """The largest probability that Δ is beyond a branch,
        over the states of the map and of `refined`.
        """
        further = chance_outside(h, self.problem.c, -self.refined.backward, self.refined.forward, k)
        return float(max(self.chances(h, k).max(), further.max(initial=0.0)))

    def counts(self) -> dict[Ending, int]:
        """The number of points of the map with each `Ending`."""
        return {kind: int(np.count_nonzero(self.findings == kind)) for kind in Ending}

    def to_json(self, steps: tuple[float, ...], k: int | None) -> dict[str, Any]:
        """All numbers of the map, and the `chances` with each of the step sizes `steps`,
        for a JSON file.
        """
        return {
            "problem": self.problem.name,
            "scheme": self.scheme.name,
            "noise": self.problem.c.tolist(),
            "safe": list(self.safe),
            "theta": self.theta.tolist(),
            "states": self.states.T.tolist(),
            "delta": self.delta.tolist(),
            "findings": {kind.text: count for kind, count in self.counts().items()},
            "map": self.findings.T.tolist(),
            "legend": {str(int(kind)): kind.text for kind in Ending},
            **{
                name: {"reach": branch.reach.tolist(), "end": [End(int(e)).text for e in branch.end]}
                for name, branch in (("forward", self.forward), ("backward", self.backward))
            },
            "refined": {name: values.tolist() for name, values in vars(self.refined).items()},
            "truncation": k,
            "chances": [
                {"h": h, "mean": float(self.chances(h, k).mean()), "worst": self.worst(h, k)} for h in steps
            ],
        }


def solvability_map(
    problem: Problem,
    *,
    scheme: Scheme = energy_preserving,
    furthest: float = 1.0,
    grid: int = 80,
    states: int = 96,
    time: float = 10.0,
    y0: Array | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Map:
    """Compute the map of solvability for |Δ| ≤ `furthest` over `states` states of the exact orbit
    through y0.

    The states are at equidistant times from 0 to `time`.

    Parameters
    ----------
    grid : int
        The number of points Δ on each side of 0.

    Raises
    ------
    UsageError
        If branches cannot be followed for the scheme or the problem, or if there is no initial
        state.
    """
    theta = np.linspace(0.0, time, states)
    progress("the orbit")
    y = exact_flow(problem, theta, y0).y
    progress("branches")
    forward, backward = follow(problem, y, furthest, scheme), follow(problem, y, -furthest, scheme)
    steps = furthest * np.arange(1, grid + 1) / grid
    deltas = np.concatenate([-steps[::-1], steps])
    rows: list[np.ndarray] = []
    for delta in deltas:
        progress(f"Newton at Δ = {delta:.3g}, {len(rows) + 1} of {2 * grid}")
        rows.append(_row(problem, scheme, y, delta, forward if delta > 0 else backward))
    progress("the shortest branches")
    reaches = np.stack([theta, forward.reach, backward.reach])
    refined = _refine(problem, scheme, y0, furthest, reaches)
    return Map(problem, scheme, theta, y, deltas, np.stack(rows), forward, backward, refined)


def _refine(problem: Problem, scheme: Scheme, y0: Array | None, furthest: float, known: Array) -> Shortest:
    """Follow branches from further states where the |Δ| reached is smallest;
    in each round they are 5 times closer.

    `known` (3, M): times of the exact flow, and the |Δ| that branches from these states reach for
    Δ > 0 and Δ < 0.
    """
    theta = known[0]
    for _ in range(REFINING_ROUNDS):
        known = known[:, np.argsort(known[0])]
        new = [t for row in (1, 2) for t in _between(known[0], known[row], furthest)]
        if not new:
            break
        times = np.unique(new)
        y = exact_flow(problem, times, y0).y
        ahead, behind = follow(problem, y, furthest, scheme), follow(problem, y, -furthest, scheme)
        known = np.concatenate([known, np.stack([times, ahead.reach, behind.reach])], axis=1)
    return Shortest(*known[:, ~np.isin(known[0], theta)])


def _between(theta: Array, reach: Array, furthest: float) -> list[float]:
    """New times next to the local minima of `reach`: MINIMUM_POINTS times between a minimum and
    each of its two neighbours.

    Only minima below `furthest` are used, and only the ROUND_MINIMA smallest of these.
    """
    padded = np.concatenate([[np.inf], reach, [np.inf]])
    minima = np.flatnonzero((reach <= padded[:-2]) & (reach <= padded[2:]) & (reach < furthest))
    shares: list[float] = []
    for i in minima[np.argsort(reach[minima], kind="stable")][:ROUND_MINIMA]:
        for j in (i - 1, i + 1):
            if 0 <= j < theta.size:
                shares += np.linspace(theta[i], theta[j], MINIMUM_POINTS + 2)[1:-1].tolist()
    return shares


def _row(problem: Problem, scheme: Scheme, y: Array, delta: float, branch: Branch) -> np.ndarray:
    """The `Ending` of every state for one Δ."""
    assert scheme.solve is not None
    solution = scheme.solve(problem, y, delta, np.zeros((problem.noises, y.shape[1])))
    solved = solution.status == Status.CONVERGED
    exists = np.abs(delta) <= branch.reach
    connected = _on_branch(problem, scheme, y, delta, branch)
    size = np.abs(connected - y).max(axis=0) + np.abs(y).max(axis=0)
    same = np.abs(solution.value - connected).max(axis=0) <= SAME_SOLUTION_TOLERANCE * size
    endings = np.select(
        [exists & solved & same, exists & ~solved, solved],
        [Ending.FOUND, Ending.MISSED, Ending.ANOTHER],
        Ending.NONE,
    )
    unknown = (branch.end == End.LOST) & ~exists & ~solved
    return np.where(unknown, Ending.UNKNOWN, endings)


def _on_branch(problem: Problem, scheme: Scheme, y: Array, delta: float, branch: Branch) -> Array:
    """The solutions y1 (d, M) on the branches at Δ, by Newton's method from a point interpolated on
    each curve.
    """
    (before, after), share = _place(branch, delta)
    lanes = np.arange(branch.reach.size)
    a, b = branch.z[before, :, lanes].T, branch.z[after, :, lanes].T
    near = a + share * np.where(np.isfinite(b), b - a, 0.0)
    step = np.full((1, y.shape[1]), delta)
    solution = solve(problem, y, step, *BRANCH_EQUATIONS[scheme.name], start=near)
    settled = solution.status == Status.CONVERGED
    # Next to a fold the equation is nearly singular. If it is not solved, the interpolated point is
    # used.
    return np.where(settled, solution.value, y + near)


def _place(branch: Branch, delta: float) -> tuple[np.ndarray, Array]:
    """Indices (2, M) of each curve's points before and after |Δ|, and the position (0 to 1)
    of |Δ| between them.
    """
    reached = np.abs(branch.delta)
    before = np.nanargmax(np.where(reached <= abs(delta), reached, -1.0), axis=0)
    lanes = np.arange(branch.reach.size)
    after = np.minimum(before + 1, len(reached) - 1)
    while True:  # rejected steps repeat a point
        same = (reached[after, lanes] <= reached[before, lanes]) & (after < len(reached) - 1)
        if not same.any():
            break
        after = after + same
    here, there = reached[before, lanes], reached[after, lanes]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.nan_to_num((abs(delta) - here) / (there - here))
    return np.stack([before, after]), share


def chance_outside(h: float, noise: ArrayLike, low: ArrayLike, high: ArrayLike, k: int | None = 2) -> Array:
    """P(Δ ≤ low or Δ ≥ high) for the random step Δ = h + Σ c_jΔŴ_j,
    truncated with k (Remark 2.1; None: untruncated).

    Parameters
    ----------
    h : float > 0, below 1 if k is given
    noise : (m,)
        The c_j.
    low, high : (M,), low < 0 < high.

    Notes
    -----
    For one noise, P is the sum of two tails of a normal law. If ΔŴ is truncated, tails beyond
    |ΔŴ| = √h A_h are 0. For several truncated noises, all but one are integrated, by Gauss nodes on
    (−A_h, A_h) and the two atoms ±A_h.
    """
    c = np.asarray(noise, dtype=np.float64).reshape(-1)
    c = c[c > 0] * np.sqrt(h)
    below, above = np.asarray(low) - h, np.asarray(high) - h
    if not c.size:
        return ((below >= 0) | (above <= 0)).astype(np.float64)
    if k is None:
        spread = float(np.sqrt(np.sum(c * c)))
        return _tail(above / spread) + _tail(-below / spread)
    return _truncated(c, below, above, truncation_bound(h, k))


def _truncated(c: Array, below: Array, above: Array, bound: float) -> Array:
    """P(S ≤ below or S ≥ above) for S = Σ c_j ζ_j, with independent standard normal ζ_j clipped to
    |ζ_j| ≤ `bound`.
    """
    if c.size == 1:
        up, down = above / c[0], -below / c[0]
        return np.where(up <= bound, _tail(up), 0.0) + np.where(down <= bound, _tail(down), 0.0)
    atom = float(_tail(np.array(bound)))
    points, weights = gauss_legendre(NOISE_NODES)
    x = bound * (2 * points - 1)
    weights = 2 * bound * weights * np.exp(-0.5 * x * x) / np.sqrt(2 * np.pi)
    total = np.zeros(np.broadcast(below, above).shape)
    for value, weight in [(-bound, atom), *zip(x, weights, strict=True), (bound, atom)]:
        total = total + weight * _truncated(c[1:], below - c[0] * value, above - c[0] * value, bound)
    return total


def _tail(x: Array) -> Array:
    """The normal tail P(ξ ≥ x) for ξ ~ N(0, 1)."""
    from scipy.special import ndtr

    tail: Array = ndtr(-np.asarray(x, dtype=np.float64))
    return tail
