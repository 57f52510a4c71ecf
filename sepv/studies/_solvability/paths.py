"""Numerical paths of a scheme, each until a step is refused,
to see for how long a step size is safe.

The map of solvability uses states of the exact orbit. A numerical path leaves this orbit if the
scheme does not keep all invariants. Scheme (2.1), for example, steadily loses the logarithmic
Casimir of Lotka-Volterra, and so reaches states whose branches of solutions are shorter. Only
numerical paths show when this happens.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sepv.core.newton import Status
from sepv.errors import TruncationWarning
from sepv.problem import Array, Problem
from sepv.schemes import Scheme
from sepv.simulate import ensemble

# The steps of the first horizon (the time to which paths are followed); each next horizon is twice
# as far.
FIRST_HORIZON_STEPS = 256
# The next horizon is started if this factor times its expected seconds (twice those of the last
# one) are left.
TIME_RESERVE = 1.5
# The confidence level of the bound on the probability that a path fails.
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Exits:
    """The times at which paths of one scheme and step size ended because a step was refused.

    until, asked : the time to which paths were followed, and the requested time, which is later if
        `seconds` ran out
    times : (F,), the start of the refused step of each of the F paths that failed, increasing
    statuses : the number of refused steps by name of `Status`
    """

    scheme: str
    h: float
    until: float
    paths: int
    times: Array
    statuses: dict[str, int]
    asked: float

    @property
    def failed(self) -> int:
        """The number of paths with a refused step; `sepv.schemes.continued` tells if a refused step
        has a solution.
        """
        return int(self.times.size)

    @property
    def first(self) -> float | None:
        """The time of the earliest refused step, None if no step was refused."""
        return float(self.times[0]) if self.failed else None

    @property
    def median(self) -> float | None:
        """The time at which half of the paths had failed, None if fewer paths failed."""
        half = (self.paths + 1) // 2
        return float(self.times[half - 1]) if self.failed >= half else None

    @property
    def cut_short(self) -> bool:
        """True if some paths were not followed to the requested time."""
        return self.until < self.asked and self.failed < self.paths

    @property
    def share(self) -> float:
        """The upper 95 % bound of the probability that a path fails by the time `until` (Clopper
        and Pearson).
        """
        from scipy.special import betaincinv

        if self.failed == self.paths:
            return 1.0
        return float(betaincinv(self.failed + 1, self.paths - self.failed, CONFIDENCE))

    def to_json(self) -> dict[str, Any]:
        """The fields, and the bound `share`, for a JSON file."""
        return {**asdict(self), "times": self.times.tolist(), "share_at_most": self.share}


def follow_paths(
    problem: Problem,
    scheme: Scheme,
    steps: Sequence[float],
    *,
    until: float,
    paths: int = 48,
    k: int | None = 2,
    y0: Array | None = None,
    seed: int = 0,
    seconds: float = 60.0,
    progress: Callable[[str], None] = lambda _: None,
) -> list[Exits]:
    """Follow paths of `scheme` with each of the step sizes `steps` up to the time `until` or their
    first refused step.

    For each h, all paths are run to a short time; if some survive, a new run is twice as long, up
    to `until`, while seconds are left. The step sizes that remain share the `seconds` that remain.
    k is the truncation of the increments (Remark 2.1), None for untruncated increments.
    """

    def horizon(h: float, count: int, most: int) -> Exits:
        progress(f"{scheme.name}, h = {h:g}: {paths} paths to t = {count * h:g}")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", TruncationWarning)  # the caller chose k
            ends = ensemble(scheme, problem, h=h, steps=count, paths=paths, seed=seed, y0=y0, truncation=k)
        failed = ends.status != Status.CONVERGED
        names, counts = np.unique(ends.status[failed], return_counts=True)
        return Exits(
            scheme.name, h, count * h, paths, np.sort(ends.failed_step[failed]) * h,
            {Status(int(s)).name: int(n) for s, n in zip(names, counts, strict=True)}, most * h,
        )  # fmt: skip

    followed, end = [], time.monotonic() + seconds
    for number, h in enumerate(steps):
        share = (end - time.monotonic()) / (len(steps) - number)
        most, begin = max(1, round(until / h)), time.monotonic()
        count = min(FIRST_HORIZON_STEPS, most)
        while True:
            started = time.monotonic()
            exits = horizon(h, count, most)
            # The seconds of the first horizon are not used, because compilation takes most of them.
            last = 0.0 if count == FIRST_HORIZON_STEPS else time.monotonic() - started
            spent = time.monotonic() - begin
            if count == most or exits.failed == paths or spent + TIME_RESERVE * 2 * last > share:
                break
            count = min(2 * count, most)
        followed.append(exits)
    return followed
