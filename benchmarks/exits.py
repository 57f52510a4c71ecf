"""Convergence without global bounds: how often paths leave a compact set,
and errors of those that stay.

``python -m benchmarks.exits``. The set is D = {y : |F(y) − F(y0)| < R} for an invariant F of the
exact flow. Let a step from any state of D change F by g with |E g| ≤ m and E g² ≤ v. Up to the exit
the sum of all g − E g is a martingale. If Nm < R, Kolmogorov's inequality then gives

    P(a path leaves D within N steps) ≤ Nv/(R − Nm)².

m and v are maxima over EXIT_STATES states of D, by quadrature over the increments of Remark 2.1
with k = 2. A step that is not solved counts as an exit. The bound does not cover such exits.

``--count 1e7`` also counts exits of that many paths in an ensemble, where F is H. On a card
(``--engine cuda``) it may be 1e9.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.stats import beta

from benchmarks import arguments, over, start
from sepv import ensemble, exact_flow, problems, schemes
from sepv.console import markdown
from sepv.core.newton import Status
from sepv.problem import Array, Problem
from sepv.simulate import advance, truncate, wiener

RADIAL_LEVELS, PLACES_ON_LEVEL, EXIT_NODES = 9, 32, 32
EXIT_STATES = RADIAL_LEVELS * PLACES_ON_LEVEL
EXIT_TIME = 1.0


class Compact(NamedTuple):
    """A set D: a problem, F, R, and the function that gives a state with F(y) = F(y0) + r.

    `turn` is the time in which the exact flow passes through a whole orbit.
    """

    problem: Problem
    F: Callable[[Array], Array]
    R: float
    at_level: Callable[[float], Array]
    turn: float

    def states(self) -> Array:
        """States (d, EXIT_STATES) spread over the set D: PLACES_ON_LEVEL on each of RADIAL_LEVELS
        orbits.
        """
        times = np.linspace(0.0, self.turn, PLACES_ON_LEVEL)
        levels = np.linspace(-1, 1, RADIAL_LEVELS) * self.R
        return np.concatenate(
            [exact_flow(self.problem, times, self.at_level(float(r))).y for r in levels], axis=1
        )


def pendulum() -> Compact:
    """The set D of the pendulum around the paper's y0, with F = H.
    `_moved` gives its states on other levels of H.
    """
    problem = problems.pendulum()
    p, q = map(float, problem.initial)
    return Compact(problem, problem.hamiltonian, 0.25, lambda r: _moved(p, q, r), 8.0)


def _moved(p: float, q: float, r: float) -> Array:
    """The state of the pendulum near (p, q) with H larger by r: p changes,
    or q too if p alone cannot give r.
    """
    square = p * p + 2 * r
    if square >= 0:
        return np.array([np.sqrt(square), q])
    return np.array([0.0, np.arccos(np.cos(q) - 0.5 * square)])


def lotka_volterra() -> Compact:
    """The set D of Lotka-Volterra on the level of H of the paper's y0,
    with F = C = ln y1 + bd ln y2 − d ln y3.
    """
    problem = problems.lotka_volterra()
    y0, nambu = np.asarray(problem.initial, dtype=np.float64), problem.nambu
    assert nambu is not None
    H0, C0 = float(problem.hamiltonian(y0)), float(nambu.casimir(y0))

    def on_level(y2: float) -> Array:
        """The state with this y2, the y3 of y0, and the energy H0: H is linear in y1."""
        return np.array([0.5 * (H0 - float(problem.hamiltonian(np.array([0.0, y2, y0[2]])))), y2, y0[2]])

    def at_level(r: float) -> Array:
        return on_level(brentq(lambda y2: float(nambu.casimir(on_level(y2))) - C0 - r, 0.6, 2.7, xtol=1e-12))

    return Compact(problem, nambu.casimir, 0.1, at_level, 6.0)


COMPACT_SETS: dict[str, tuple[Callable[[], Compact], tuple[str, ...]]] = {
    "pendulum": (pendulum, ("energy-preserving", "midpoint", "euler-heun", "milstein", "euler-maruyama")),
    "lotka-volterra": (lotka_volterra, ("both-invariants", "energy-preserving")),
}
EXIT_STEPS = {"pendulum": (16, 256), "lotka-volterra": (512, 2048)}


def moments(D: Compact, scheme: str, h: float) -> tuple[float, float]:
    """The largest m and v of the module's docstring over the states of D, for one step of a
    scheme.
    """
    x, weights = np.polynomial.hermite_e.hermegauss(EXIT_NODES)
    weights = weights / weights.sum()
    # All noises act through their sum, whose size is |c|.
    c = D.problem.c
    noise = truncate(np.sqrt(h) * x, h, 2)[None] * (c / float(c @ c) ** 0.5)[:, None]
    states = D.states()
    y = np.repeat(states, EXIT_NODES, axis=1)
    y1 = schemes.by_name(scheme).step(D.problem, y, h, np.tile(noise, states.shape[1]))
    g = (D.F(y1) - D.F(y)).reshape(-1, EXIT_NODES)
    return float(np.abs(g @ weights).max()), float((g**2 @ weights).max())


def bound(D: Compact, scheme: str, steps: int) -> float:
    """The bound Nv/(R − Nm)², at most 1, of the probability that a path leaves D within N steps."""
    m, v = moments(D, scheme, EXIT_TIME / steps)
    left = D.R - steps * m
    return min(1.0, steps * v / left**2) if left > 0 else 1.0


class Measured(NamedTuple):
    """The result of a run: how many paths left the set D, how many there were,
    and the rms error at T of the rest, if it was measured.
    """

    left: int
    paths: int
    rms: float = float("nan")

    def interval(self, alpha: float = 1e-3) -> tuple[float, float]:
        """Clopper and Pearson's interval of the probability that a path leaves D,
        of level 1 − alpha.
        """
        k, n = self.left, self.paths
        low = float(beta.ppf(alpha / 2, k, n - k + 1)) if k else 0.0
        return low, float(beta.ppf(1 - alpha / 2, k + 1, n - k)) if k < n else 1.0


def measured(D: Compact, scheme: str, steps: int, paths: int, seed: int = 0) -> Measured:
    """Run paths to T, and compare them with exact paths of the same truncated increments."""
    h, c, asked = EXIT_TIME / steps, D.problem.c, schemes.by_name(scheme)
    raw = wiener.increments(seed, T=EXIT_TIME, steps=steps, noises=c.size, paths=range(paths))
    dW = truncate(raw, h, 2)
    start_at = np.asarray(D.problem.initial, dtype=np.float64)
    y = np.repeat(start_at[:, None], paths, axis=1)
    F0, left = float(D.F(start_at)), np.zeros(paths, dtype=bool)
    for increments in dW:
        stay = np.flatnonzero(~left)
        y[:, stay], status, *_ = advance(asked, D.problem, y[:, stay], h, increments[:, stay])
        left[stay] = (status != Status.CONVERGED) | ~(np.abs(D.F(y[:, stay]) - F0) < D.R)
    exact = exact_flow(D.problem, EXIT_TIME + c @ dW.sum(axis=0), start_at).y
    errors = np.sum((y - exact)[:, ~left] ** 2, axis=0)
    return Measured(int(left.sum()), paths, float(np.sqrt(errors.sum() / paths)))


def counted(D: Compact, scheme: str, steps: int, paths: int, engine: str, seed: int = 0) -> Measured:
    """Count the paths of an ensemble that leave D, whose F is H: max |H(y_n) − H(y0)| is not
    below R.
    """
    ends = ensemble(
        scheme, D.problem, h=EXIT_TIME / steps, steps=steps, paths=paths, truncation=2, seed=seed, engine=engine,
        reduce={"left": lambda ends: 1.0 - (ends.energy_defect < D.R)},
    )  # fmt: skip
    found = ends.reduced["left"]
    return Measured(round(found.mean * found.count) + found.failed, paths)


def probability(D: Compact, scheme: str, steps: int, paths: int, engine: str) -> str:
    """The probability that a path leaves D, with its interval of 99.9 %; a dash if it is not
    counted.
    """
    if not paths or D.problem.hamiltonian != D.F:
        return "–"
    seen = counted(D, scheme, steps, paths, engine)
    low, high = seen.interval()
    return f"{seen.left / paths:.2e} [{low:.1e}, {high:.1e}]"


def rows(paths: int, count: int = 0, engine: str = "auto") -> list[list[str]]:
    """A row for each problem and scheme; its cells have a value for each number of steps."""
    found: dict[tuple[str, str], list[tuple[str, ...]]] = {}
    cases = [(name, s, n) for name, (_, own) in COMPACT_SETS.items() for s in own for n in EXIT_STEPS[name]]
    sets = {name: make() for name, (make, _) in COMPACT_SETS.items()}
    for name, scheme, steps in over(cases, lambda case: " ".join(map(str, case))):
        D = sets[name]
        seen = measured(D, scheme, steps, paths)
        often = probability(D, scheme, steps, count, engine)
        cells = (f"{bound(D, scheme, steps):.2g}", f"{seen.left}", often, f"{seen.rms:.1e}")
        found.setdefault((name, scheme), []).append(cells)
    return [[*key, *(", ".join(own) for own in zip(*cells, strict=True))] for key, cells in found.items()]


def main() -> None:
    """Print the table as Markdown."""
    options = arguments(
        __doc__, paths=4000, count={"type": lambda text: int(float(text)), "default": 0}, engine="auto"
    )
    heads = ["problem", "scheme", "bound", "paths that left", "probability", "rms error of those that stay"]
    print(markdown(heads, rows(options.paths, options.count, options.engine)))


if __name__ == "__main__":
    start(main)
