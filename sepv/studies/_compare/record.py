"""The result of a comparison: one point for each method and step size, as data."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from sepv.files import finite
from sepv.record import TINY
from sepv.schemes import Look
from sepv.statistics import Estimate

COMPARISON_FORMAT = 1


@dataclass(frozen=True)
class Seconds:
    """The times of one run of all paths, in seconds.

    median, low, high : the median and both quartiles of the processor time. Another program on the
        same core can double the clock's time of a run, but not its processor time
    wall : the median clock time, which is many times the processor time only if a driver waits for
        another process
    first : the time of the first call less the median: the time of compilation, if any, else noise
        around 0
    """

    median: float
    low: float
    high: float
    wall: float
    first: float


@dataclass(frozen=True)
class Point:
    """The measurements of one method at one step size.

    strong, weak : √E|y_N − y(T)|² and |E(y_N − y(T))| over the paths that were finished, with their
        intervals
    energy_defect, casimir_defect : the largest |H(y_n) − H(y_0)| and |C(y_n) − C(y_0)| over steps,
        paths and Casimirs C
    failures : the number of paths with a step that was not solved or left the domain
    evaluations : the evaluations in one step of one path, by kind; empty if they cannot be counted
    iterations : Newton iterations in one step of one path
    steps_matter : False for the exact time change, whose only point has steps = 1, h = T
    clipping : the rms error that truncated increments alone cause, in closed form
        (`sepv.exact._truncation_error`), because clipping is too rare for a sample to show it
    """

    method: str
    h: float
    steps: int
    paths: int
    failures: int
    strong: Estimate
    weak: Estimate
    energy_defect: float
    casimir_defect: float
    seconds: Seconds
    evaluations: dict[str, float]
    iterations: float | None
    steps_matter: bool = True
    clipping: float = 0.0

    @property
    def error(self) -> float:
        """The error √(strong² + clipping²): the strong error of the sample, and `clipping`,
        which no sample shows.
        """
        return math.hypot(self.strong.value, self.clipping)

    @property
    def nanoseconds(self) -> float:
        """The median time of one step of one path."""
        return 1e9 * self.seconds.median / (self.steps * self.paths)

    @property
    def microseconds_a_path(self) -> float:
        """The median time of one whole path."""
        return 1e6 * self.seconds.median / self.paths

    def of_energy(self) -> Point:
        """A copy of the point with the energy defect as its `error`,
        for `Comparison.times_to_energy_error`.
        """
        return replace(
            self, strong=replace(self.strong, value=max(self.energy_defect, TINY), half=0.0), clipping=0.0
        )

    def to_json(self) -> dict[str, Any]:
        """The point as an object of the schema ``comparison.schema.json``."""
        return {
            **{name: getattr(self, name) for name in ("method", "h", "steps", "paths", "failures")},
            "strong_error": _estimate(self.strong),
            "weak_error": _estimate(self.weak),
            "clipping_error": self.clipping,
            "energy_defect": finite(self.energy_defect),
            "casimir_defect": finite(self.casimir_defect),
            "seconds": vars(self.seconds) | {},
            "ns_per_step": self.nanoseconds,
            "evaluations_per_step": self.evaluations,
            "iterations_per_step": self.iterations,
        }


@dataclass(frozen=True)
class TimeToError:
    """The time in µs per path in which a method reaches a target error,
    and its energy defect at the finest h used.

    how : "between" (interpolated log-log between two step sizes), "beyond" (extrapolated from the
        two finest step sizes), "coarsest" (the coarsest step size is good enough) or "never"
        (errors do not decrease)
    """

    method: str
    error: float
    microseconds: float | None
    energy_defect: float | None
    how: str


@dataclass(frozen=True)
class Compared:
    """The points of a comparison in the order of methods and step sizes,
    and the settings of the run.
    """

    problem: str
    T: float
    seed: int
    repeats: int
    confidence: float
    environment: dict[str, str]
    sources: dict[str, str]
    has_casimirs: bool
    deterministic: bool  # True without noise: all paths are equal, and their error has no interval
    points: tuple[Point, ...]
    targets: tuple[float, ...] = ()
    # Methods that were left out, each with its reason.
    failed: dict[str, str] = field(default_factory=dict)
    # The looks in pictures that schemes declare, by method.
    looks: dict[str, Look] = field(default_factory=dict)
    # Methods whose steps Python calls one by one; the others are one compiled loop, or one solve.
    called_each_step: tuple[str, ...] = ()

    def of(self, method: str) -> list[Point]:
        """The points of one method, the largest step size first."""
        return sorted((p for p in self.points if p.method == method), key=lambda p: p.steps)

    def times_to_error(self) -> list[TimeToError]:
        """The time that each method needs to reach each of `targets` as its strong error."""
        return [time_to_error(self.of(m), target) for m in self.sources for target in self.targets]

    def times_to_energy_error(self) -> list[TimeToError]:
        """The time in which each method reaches each of `targets` as largest |H(y_n)
        − H(y_0)| along the path.
        """
        return [
            time_to_error([p.of_energy() for p in self.of(m)], target)
            for m in self.sources
            for target in self.targets
        ]

    def to_json(self) -> dict[str, Any]:
        """The comparison as an object of the schema ``comparison.schema.json``."""
        return {
            **({"failed": self.failed} if self.failed else {}),
            "format": COMPARISON_FORMAT,
            **{k: getattr(self, k) for k in ("problem", "T", "seed", "repeats", "confidence", "environment")},
            "methods": [
                {"name": n, "source": s} | ({"look": asdict(self.looks[n])} if n in self.looks else {})
                for n, s in self.sources.items()
            ],
            "points": [p.to_json() for p in self.points],
            "times_to_error": [vars(t) | {} for t in self.times_to_error()],
            **(
                {"times_to_energy_error": [vars(t) | {} for t in self.times_to_energy_error()]}
                if self.deterministic
                else {}
            ),
        }


def time_to_error(points: list[Point], target: float) -> TimeToError:
    """The time in which one method reaches the error `target`,
    by log-log interpolation of time against error.

    Errors are those of `Point.error`. A step size counts only if every path was finished, because a
    method that loses its worst paths would look too good.
    """
    usable = [p for p in points if not p.failures and 0 < p.error < np.inf]
    name = points[0].method if points else ""
    if not usable:
        return TimeToError(name, target, None, None, "never")
    first = usable[0]
    if first.error <= target:
        return TimeToError(name, target, first.microseconds_a_path, first.energy_defect, "coarsest")
    for coarse, fine in pairwise(usable):
        if fine.error <= target < coarse.error:
            return TimeToError(name, target, _on_line(coarse, fine, target), fine.energy_defect, "between")
    if len(usable) < 2 or not usable[-1].error < 0.9 * usable[-2].error:
        return TimeToError(name, target, None, None, "never")
    before, last = usable[-2:]
    order = np.log(before.error / last.error) / np.log(last.steps / before.steps)
    more = float((last.error / target) ** (1 / order))
    return TimeToError(name, target, more * last.microseconds_a_path, last.energy_defect, "beyond")


def _on_line(coarse: Point, fine: Point, target: float) -> float:
    x0, x1, x = (float(np.log(v)) for v in (coarse.error, fine.error, target))
    t0, t1 = np.log(coarse.microseconds_a_path), np.log(fine.microseconds_a_path)
    return float(np.exp(t0 + (t1 - t0) * (x - x0) / (x1 - x0)))


def _estimate(e: Estimate) -> dict[str, float | None]:
    return {"value": finite(e.value), "low": finite(max(e.low, 0.0)), "high": finite(e.high)}
