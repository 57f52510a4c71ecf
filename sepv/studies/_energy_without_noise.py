"""Energy over long times without noise, c = (): the largest |H(y_n) − H(y_0)| up to t,
with steps h and h/2.

If the problem has one degree of freedom and the orbit is closed, there is also a verdict on a trend
of the energy, by the method of the law *long-time-energy*; its theory
(`sepv.properties._orders.integrable`) covers no other orbits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sepv.errors import Skipped, UsageError
from sepv.files import finite
from sepv.law import Verdict, quiet_problem
from sepv.pictures import Axis, Series, looks, panels
from sepv.problem import Array, Problem, one_field
from sepv.properties import EnergyPath, Stopped, allowed_rounding, trend, users_orbits
from sepv.schemes import Look, Scheme

# The number of points of a curve, and of paths that start on one orbit.
CURVE_POINTS, ORBIT_PATHS = 256, 8


@dataclass(frozen=True)
class QuietGrowth:
    """The energy's error of one scheme without noise, with the steps h and h/2.

    times, largest : times (L,), and the largest |H(y_n) − H(y_0)| up to each (2, L), for h and h/2;
        NaN after a failure
    rounding : a bound of the error at the last time that rounding alone may cause
    trend : a verdict on a trend of the mean energy, such as "no trend" or "not judged", and the
        reason
    failed : a text on the first step that failed, "" if none did
    """

    scheme: str
    h: float
    times: Array
    largest: Array
    rounding: float
    trend: tuple[str, str]
    failed: str = ""

    def to_json(self) -> dict[str, Any]:
        """The fields for a JSON file; numbers that are not finite are null."""
        return {
            "scheme": self.scheme, "h": self.h, "times": self.times.tolist(), "largest": finite(self.largest.tolist()),
            "rounding": self.rounding, "trend": self.trend[0], "reason": self.trend[1], "failed": self.failed,
        }  # fmt: skip

    def sentence(self) -> str:
        """The result on one line, for the terminal."""
        if self.failed:
            return f"failed in {self.failed.partition(chr(10))[0]}"
        coarse, fine = self.largest[:, -1]
        power = f", h^{np.log2(coarse / fine):.2f}" if fine > self.rounding else ""
        return (
            f"|H − H(y0)| ≤ {coarse:.2g} with h, {fine:.2g} with h/2{power}; {self.trend[0]}: {self.trend[1]}"
        )


def quiet_growth(scheme: Scheme, problem: Problem, *, h: float, T: float) -> QuietGrowth:
    """Measure the growth of the energy's error without noise, c = (),
    from the problem's initial state up to T.

    Raises UsageError for a problem with a different vector field for each noise, or without an
    initial state.
    """
    if not one_field(problem) or problem.initial is None:
        raise UsageError(
            expected="a problem of (1.1) with an initial state",
            received=problem.name,
            remedy="take one of `sepv list`, such as -p pendulum",
        )
    system, steps = quiet_problem(problem), max(1, round(T / h))
    start = np.array(problem.initial, dtype=np.float64)[:, None]
    shown = np.unique(np.geomspace(1, steps, CURVE_POINTS).round().astype(int))
    largest, failed = [], ""
    for finer in (1, 2):
        try:
            errors = EnergyPath(scheme, system, start, h / finer).errors(finer * steps)
        except Stopped as stopped:
            rest = np.full((finer * steps + 1 - len(stopped.errors), 1), np.nan)
            errors, failed = np.concatenate([stopped.errors, rest]), failed or stopped.words
        largest.append(np.maximum.accumulate(np.abs(errors[:, 0]))[finer * shown])
    rounding, judged = allowed_rounding(scheme, system, start, 2 * steps), _trend(scheme, system, h, T)
    return QuietGrowth(scheme.name, h, h * shown, np.array(largest), rounding, judged, failed)


def _trend(scheme: Scheme, problem: Problem, h: float, T: float) -> tuple[str, str]:
    """The verdict on a trend of the mean energy, in words, and its reason,
    as in the law *long-time-energy*.

    The step is not exactly h, nor the time exactly T, because both are fitted to the period of the
    orbit.
    """
    try:
        orbits = users_orbits(problem)
    except Skipped as reason:
        return "not judged", reason.reason
    steps = max(orbits.steps, round(orbits.period / h))
    longer = max(1, round((T / orbits.period / 4 - 1) / 1.5))
    judged = trend(scheme, replace(orbits, steps=steps), ORBIT_PATHS, longer)
    words = {Verdict.HOLDS: "no trend", Verdict.VIOLATED: "a trend", Verdict.INCONCLUSIVE: "not decided"}
    return words.get(judged.verdict, "failed"), judged.text


def draw(rows: Sequence[QuietGrowth], title: str, suffix: str, own: dict[str, Look] | None = None) -> bytes:
    """Draw how the energy's error grows without noise, and return the content of a file;
    needs the extra `plots`.

    The picture shows the largest |H(y_n) − H(y_0)| up to time t against t, for each scheme with h
    and with h/2.
    """
    shown = [
        Series(f"{row.scheme}, {name}", row.times.tolist(), curve.tolist(), row.scheme)
        for row in rows
        for name, curve in zip(("h", "h/2"), row.largest, strict=True)
    ]
    side = shown, Axis("time t", log=True), Axis("largest |H − H(y0)| so far", log=True)
    return panels([side], looks((row.scheme for row in rows), own), title, suffix)
