"""Weak errors by brute force: means over paths that no exact path accompanies.
``python -m benchmarks.weak_errors``.

Section 5 of the paper leaves the weak order of (2.1) open. This study measures
E φ(y_N) − E φ(y(T)) for three functions φ, from paths drawn afresh for each scheme and each h.
y(T) is the exact flow at the time θ = T + Σ c_j W_j(T), so E φ(y(T)) is an integral over one normal
variable, computed by quadrature.

``--paths 1e9 --engine cuda`` needs a card and some minutes; the defaults need some minutes of one
core.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.special import ndtri

import sepv
from benchmarks import arguments, over, start
from sepv import problems
from sepv.pictures import Axis, Series, content, draw_curves, figure, looks
from sepv.problem import Problem

WEAK_T = 1.0
WEAK_STEPS = (4, 8, 16, 32, 64, 128, 256)
WEAK_SCHEMES = ("energy-preserving", "midpoint", "modified-weak-2")
WEAK_FUNCTIONS = {"y1": lambda y: y[0], "y2": lambda y: y[1], "y1 y2": lambda y: y[0] * y[1]}
WEAK_NODES = 256
# The half-width of an interval of 99 %, in standard errors.
ERRORS_OF_99_PERCENT = float(ndtri(0.995))


class WeakError(NamedTuple):
    """E φ(y_N) − E φ(y(T)) of a scheme with N steps: the estimate and its standard error."""

    scheme: str
    function: str
    steps: int
    error: float
    standard_error: float

    @property
    def seen(self) -> bool:
        """True if the interval of 99 % does not contain 0."""
        return abs(self.error) > ERRORS_OF_99_PERCENT * self.standard_error


def expectations(problem: Problem) -> dict[str, float]:
    """E φ(y(T)) of each function by Gauss-Hermite quadrature over θ,
    exact to rounding for these smooth flows.
    """
    x, weights = np.polynomial.hermite_e.hermegauss(WEAK_NODES)
    kept = weights > weights.max() * 1e-30
    theta = WEAK_T + np.sqrt(WEAK_T * float(np.sum(problem.c**2))) * x[kept]
    y = sepv.exact_flow(problem, theta, problem.initial).y
    return {name: float(f(y) @ weights[kept] / weights.sum()) for name, f in WEAK_FUNCTIONS.items()}


def weak_errors(problem: Problem, scheme: str, steps: int, **options: Any) -> list[WeakError]:
    """The weak errors of a scheme with N = `steps` steps; `options` are paths,
    seed and engine of `sepv.ensemble`.
    """
    reduced = {name: (lambda ends, f=f: f(ends.y)) for name, f in WEAK_FUNCTIONS.items()}
    ends = sepv.ensemble(scheme, problem, h=WEAK_T / steps, steps=steps, reduce=reduced, **options)
    exact = expectations(problem)
    return [
        WeakError(scheme, name, steps, s.mean - exact[name], s.standard_error)
        for name, s in ends.reduced.items()
    ]


def order(found: list[WeakError]) -> tuple[float, float]:
    """The order and the half-width of its 99 % interval:
    a weighted fit of ln |error| where an error is seen.
    """
    seen = [w for w in found if w.seen]
    if len(seen) < 2:
        return float("nan"), float("inf")
    x, z = np.log([WEAK_T / w.steps for w in seen]), np.log([abs(w.error) for w in seen])
    weights = np.array([(w.error / w.standard_error) ** 2 for w in seen])
    centred = x - np.average(x, weights=weights)
    square = float(weights @ centred**2)
    return float((weights * centred) @ z) / square, ERRORS_OF_99_PERCENT / square**0.5


def picture(found: list[WeakError], path: Path) -> None:
    """Draw |error| against h for each function, where an error is seen."""
    with figure(11, 4, layout="constrained") as drawn:
        for axes, function in zip(
            drawn.subplots(1, len(WEAK_FUNCTIONS), sharey=True), WEAK_FUNCTIONS, strict=True
        ):
            series = [
                Series(s, [WEAK_T / w.steps for w in own], [abs(w.error) for w in own], s)
                for s in WEAK_SCHEMES
                if (own := [w for w in found if w.seen and (w.scheme, w.function) == (s, function)])
            ]
            look, x = looks(WEAK_SCHEMES), Axis("step size h", log=True)
            draw_curves(axes, series, look, x, Axis(f"|error of E {function}|", log=True), slopes=(1.0, 2.0))
            axes.legend()
        path.write_bytes(content(drawn, path.suffix))


def main() -> None:
    """Print the table, and draw the picture if one is asked for."""
    options = arguments(
        __doc__,
        problem="pendulum",
        paths={"type": lambda text: int(float(text)), "default": 1_000_000},
        engine="auto",
        seed=0,
        picture={"type": Path, "help": "FILE.png, for which the extra plots is needed"},
    )
    problem = problems.by_name(options.problem)
    run = {"paths": options.paths, "engine": options.engine}
    found: list[WeakError] = []
    for number, scheme in enumerate(over(WEAK_SCHEMES)):
        for steps in over(WEAK_STEPS, "{} steps".format):
            found += weak_errors(problem, scheme, steps, seed=options.seed + number * len(WEAK_STEPS), **run)
    table = Table(title=f"{options.problem}, {options.paths:.0e} paths: error ± half-width of 99 %")
    for heading in ("scheme", "function", *(f"N = {n}" for n in WEAK_STEPS), "order"):
        table.add_column(heading)
    for scheme in WEAK_SCHEMES:
        for function in WEAK_FUNCTIONS:
            own = [w for w in found if (w.scheme, w.function) == (scheme, function)]
            slope, half = order(own)
            cells = (f"{w.error:.1e} ± {ERRORS_OF_99_PERCENT * w.standard_error:.0e}" for w in own)
            table.add_row(scheme, function, *cells, f"{slope:.2f} ± {half:.2f}")
    Console(width=200).print(table)
    if options.picture:
        picture(found, options.picture)


if __name__ == "__main__":
    start(main)
