"""Times of two checkouts: the same cases in two processes that alternate,
and bounds of the ratio of their times.

Both times of a ratio are measured one after the other, because a slow minute of the machine then
slows both. Within a batch the two processes alternate, and each of them is first in half of the
pairs. Each batch has new processes, because a process is faster or slower by a few per cent, as
long as it runs, depending on its place in memory. The bounds are a bootstrap over batches and over
the pairs of times within them.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import sepv
from sepv.children import Child, NoLine
from sepv.errors import TargetError, UsageError
from sepv.problem import Array
from sepv.studies._bench import timed_process
from sepv.studies._bench.gate import GATE_ALPHA, MeasuredChange

# The seconds of one measurement: long beside the clock's resolution, short beside changes of the
# machine's load.
READING_SECONDS = 0.02
TIMED_PAIRS = 8
FEWEST_BATCHES = 4
# A case needs no further batch if both bounds are within this fraction of its ratio.
RATIO_HALF_WIDTH = 0.02
# Head is slower if the lower bound of the ratio is above this number, and faster if the upper bound
# is below its inverse. Two per cent allow for an effect that pairing cannot remove: other code lies
# in another place of memory.
TIME_TOLERANCE = 1.02
RATIO_RESAMPLES = 4000
SIDE_TIMEOUT = 600.0
CLOCKS = ("processor time", "clock time")


class Side:
    """A child process that imports the scheme under test, `target`, from one of the two
    checkouts.
    """

    def __init__(self, target: str, checkout: Path, label: str) -> None:
        self.label = label
        roots = [checkout, *(p for p in (checkout / "src",) if p.is_dir())]
        path = os.pathsep.join([*map(str, roots), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
        self.child = Child(
            [sys.executable, "-P", timed_process.__file__],
            cwd=checkout,
            env={**os.environ, "PYTHONPATH": path},
        )
        try:
            self._require_origin(target, checkout)
        except BaseException:
            self.close()
            raise

    def _require_origin(self, target: str, checkout: Path) -> None:
        answer = self.ask({"load": target})
        origin = Path(answer["origin"] or "/").resolve()
        if checkout.resolve() not in origin.parents:
            raise UsageError(
                expected=f"{target} from the {self.label} checkout {checkout}",
                received=f"one from {origin}",
                remedy="name the folder from which the package can be imported (its root, or the one above src/)",
            )

    def ask(self, question: dict[str, Any]) -> dict[str, Any]:
        """Send a question and return the answer; TargetError if the scheme raises,
        or the process ends or hangs.
        """
        try:
            answer = json.loads(self.child.exchange(json.dumps(question).encode() + b"\n", SIDE_TIMEOUT))
        except NoLine:
            answer = {"failed": "no answer: it ended, or took too long"}
        if "failed" in answer:
            raise TargetError(
                expected=f"the scheme of the {self.label} checkout to run",
                received=str(answer["failed"]).splitlines()[0],
                remedy="make it run there by itself first",
            )
        reply: dict[str, Any] = answer
        return reply

    def close(self) -> None:
        """End the child process."""
        self.child.end()


@contextmanager
def both(target: str, head: Path, base: Path) -> Iterator[tuple[Side, Side]]:
    """Start a process for each of two checkouts; both processes end with the `with` block."""
    with closing(Side(target, head, "head's")) as first, closing(Side(target, base, "other")) as second:
        yield first, second


def head_of(target: str) -> Path:
    """The folder from which this process loads `target`: the working folder for module:attribute,
    else sepv's own.
    """
    return Path.cwd() if ":" in target else Path(sepv.__file__).resolve().parents[1]


@dataclass
class Times:
    """The paired times of one case.

    call : "step" or "ensemble", see `sepv.studies._bench.measure.seconds`
    batches : for each batch the log ratios head/base of its pairs of times, by processor time and
        by the clock
    """

    case: dict[str, Any]
    call: str
    batches: list[list[tuple[float, float]]] = field(default_factory=list)

    def bounds(self, clock: int) -> tuple[float, float, float]:
        """The ratio head/base of times by CLOCKS[clock], and its two bounds,
        each wrong with probability GATE_ALPHA.
        """
        logs = [np.array(batch)[:, clock] for batch in self.batches]
        value, low, high = bootstrap(logs)
        return float(np.exp(value)), float(np.exp(low)), float(np.exp(high))


def bootstrap(batches: Sequence[Array]) -> tuple[float, float, float]:
    """The median of the log ratios of all pairs, and its bounds by a bootstrap over batches and
    over their pairs.

    The median is not a mean of the batches' medians, because a few disturbed pairs can move the
    median of a small batch. The spread is multiplied by √(B/(B − 1)), because a bootstrap of B
    batches is too narrow by this factor.
    """
    rng = np.random.default_rng(0)
    pairs = np.stack(batches)
    B, K = pairs.shape
    value = float(np.median(pairs))
    chosen = pairs[rng.integers(0, B, (RATIO_RESAMPLES, B))]
    again = np.take_along_axis(chosen, rng.integers(0, K, (RATIO_RESAMPLES, B, K)), axis=2)
    medians = np.median(again.reshape(RATIO_RESAMPLES, -1), axis=1)
    widened = value + (medians - value) * np.sqrt(B / (B - 1))
    low, high = np.quantile(widened, [GATE_ALPHA, 1 - GATE_ALPHA])
    return value, float(low), float(high)


def time_pairs(
    target: str,
    head: Path,
    base: Path,
    cases: Sequence[dict[str, Any]],
    *,
    batches: int = 12,
    progress: Callable[[str, float], None] = lambda _text, _share: None,
) -> list[MeasuredChange]:
    """Measure the ratio of times head/base between two checkouts, with a verdict,
    for each case and clock.

    Batches are run until the bounds of every case are narrow enough or show a change, but at most
    `batches`. A built-in target is also timed in `sepv.ensemble`, because the engines belong to the
    same checkout.
    """
    calls = ("step",) if ":" in target else ("step", "ensemble")
    timed = [Times(case, call) for case in cases for call in calls]
    for number in range(batches):
        with both(target, head, base) as sides:
            for n, times in enumerate(timed):
                share = (number + n / len(timed)) / batches
                progress(f"timing, batch {number + 1} of at most {batches}, {times.case['name']}", share)
                times.batches.append(_batch(sides, {"time": times.case, "call": times.call}))
        if number + 1 >= FEWEST_BATCHES and all(_settled(times) for times in timed):
            break
    return [_check(target, times, clock) for times in timed for clock in range(len(CLOCKS))]


def _batch(sides: tuple[Side, Side], job: dict[str, Any]) -> list[tuple[float, float]]:
    for side in sides:
        side.ask({**job, "loops": 1})  # not timed, because the first run does additional work
    once = max(side.ask({**job, "loops": 1})["seconds"][1] for side in sides)
    question = {**job, "loops": max(1, round(READING_SECONDS / once))}
    pairs = []
    for n in range(TIMED_PAIRS):
        order = (0, 1) if n % 2 == 0 else (1, 0)
        seconds: list[list[float]] = [[], []]
        for which in order:
            seconds[which] = sides[which].ask(question)["seconds"]
        ratios = np.log(seconds[0]) - np.log(seconds[1])
        pairs.append((float(ratios[0]), float(ratios[1])))
    return pairs


def _settled(times: Times) -> bool:
    ratio, low, high = times.bounds(0)
    clear = low > TIME_TOLERANCE or high < 1 / TIME_TOLERANCE
    return clear or max(high / ratio, ratio / low) < 1 + RATIO_HALF_WIDTH


def _check(target: str, times: Times, clock: int) -> MeasuredChange:
    ratio, low, high = times.bounds(clock)
    text = f"ratio {ratio:.3f} in [{low:.3f}, {high:.3f}], {len(times.batches)} × {TIMED_PAIRS} pairs"
    # If the upper bound reaches ten per cent, a regression that the gate must find is not excluded.
    verdict = "same" if high < 1.1 else "not settled"
    if low > TIME_TOLERANCE or high < 1 / TIME_TOLERANCE:
        verdict = "worse" if low > TIME_TOLERANCE else "better"
    what = CLOCKS[clock] + (" of an ensemble" if times.call == "ensemble" else "")
    return MeasuredChange(target, times.case["name"], what, verdict, text)


def measured(
    target: str,
    head: Path,
    base: Path,
    cases: Sequence[dict[str, Any]],
    progress: Callable[[str, float], None] = lambda _text, _share: None,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Measure the work and errors of `target` in both checkouts by the same code;
    return the records (head, base).
    """
    ours: list[Any] = []
    theirs: list[Any] = []
    with both(target, head, base) as sides:
        for side, record in zip(sides, (ours, theirs), strict=True):
            for case in cases:
                share = (len(ours) + len(theirs)) / (2 * len(cases))
                progress(f"work and errors, {side.label} checkout, {case['name']}", share)
                record.append(side.ask({"measure": case}))
    return {"target": target, "cases": ours}, {"target": target, "cases": theirs}
