"""Progress of a run: the laws that have begun, the laws that are done,
and the estimated remaining seconds.
"""

from __future__ import annotations

import time
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import accumulate

from sepv.children import Journal, current_journal
from sepv.console import showing
from sepv.law import Finding, Law, Verdict
from sepv.verification._verify import LawProgress

# Seconds after which a law may be called late, and after which the current case is named.
LATE_SECONDS, SLOW_SECONDS = 5.0, 2.0
# A law with this many steps spends most of its time on them, if a step takes more than ten
# microseconds.
STEPS_OF_A_LONG_LAW = 10000


class Course:
    """The laws that have begun or are done, and an estimate of the remaining seconds.

    A law is expected to take pace · `Law.cost` + step · `Law.steps` seconds. The law "contract"
    measures `step`, the seconds of a step; laws of at least STEPS_OF_A_LONG_LAW steps may lower
    this value, or give it if "contract" did not. `pace` is the median over laws of the other
    seconds divided by `Law.cost`, so that one slow law does not change it.
    """

    def __init__(self, laws: Sequence[Law]) -> None:
        self.left = {law.name: law for law in laws}
        self.began: dict[str, float] = {}
        self.found: list[tuple[Law, Finding]] = []
        self.started = time.monotonic()

    def heard(self, law: Law, finding: Finding | None) -> None:
        """Record that a law begins (no `finding`) or ends.

        Nothing is changed in place: a display thread reads it.
        """
        others = {name: since for name, since in self.began.items() if name != law.name}
        if finding is None:
            self.began = {**others, law.name: time.monotonic()}
            return
        self.found = [*self.found, (law, finding)]
        self.left = {name: left for name, left in self.left.items() if name != law.name}
        self.began = others

    def steps(self, law: Law) -> int:
        """The steps of a law: `spared` if the scheme takes no batches:
        "reproducibility" is then not applicable.
        """
        alone = any(
            law.name == "reproducibility" and f.verdict is Verdict.NOT_APPLICABLE for law, f in self.found
        )
        return law.spared if alone and law.spared else law.steps

    def rates(self) -> tuple[float, float]:
        """The pace (measured seconds over `Law.cost`) and the seconds of a step;
        inapplicable laws are ignored.
        """
        measured = [(law, f) for law, f in self.found if f.checks or f.verdict is not Verdict.NOT_APPLICABLE]
        few, many = (
            [(w, f) for w, f in measured if (w.steps >= STEPS_OF_A_LONG_LAW) is wanted]
            for wanted in (False, True)
        )
        timed = [f.step_seconds for _, f in measured if f.step_seconds is not None]
        step = timed[0] if timed else 0.0
        # One law gives no median, so half a second at pace 1 is added, the pace of the machine that
        # gave `Law.cost`.
        paces = [(1.0, 0.5), *((max(0.0, f.seconds - step * w.steps) / w.cost, w.cost) for w, f in few)]
        pace = _weighted_median(paces)
        if many:
            spent = sum(max(0.0, f.seconds - pace * law.cost) for law, f in many)
            per_step = spent / sum(self.steps(w) for w, _ in many)
            # If the scheme takes batches, most of the seconds `spent` are the cost of calls.
            step = min(step, per_step) if timed else per_step
        return pace, step

    def whole(self) -> dict[str, float]:
        """The expected duration in seconds of each law that is not done."""
        pace, step = self.rates()
        return {name: pace * law.cost + step * self.steps(law) for name, law in self.left.items()}

    def late(self) -> dict[str, tuple[float, float]]:
        """For each law that has run longer than LATE_SECONDS and its expected time by half:
        its seconds so far and expected.
        """
        now, whole = time.monotonic(), self.whole()
        ran = {name: now - began for name, began in self.began.items() if name in whole}
        return {name: (t, whole[name]) for name, t in ran.items() if t > max(LATE_SECONDS, 1.5 * whole[name])}

    def seconds_left(self) -> float | None:
        """The estimated seconds left; None before a law is done,
        or if late laws took longer than the rest will.
        """
        if not self.found:
            return None
        now, whole = time.monotonic(), self.whole()
        ran = {name: now - began for name, began in self.began.items() if name in whole}
        # A late law is expected to take an eighth more than it has taken.
        rest = [max(whole.pop(name) - since, since / 8) for name, since in ran.items()]
        if sum(spent for spent, _ in self.late().values()) > sum(whole.values()):
            return None
        worked = sum(ran.values()) + sum(f.seconds for _, f in self.found)
        busy = max(1.0, worked / (now - self.started))  # processes on average
        return max([(sum(rest) + sum(whole.values())) / busy, *rest])

    def doing(self, journal: Journal | None, name: str) -> str:
        """The current work in words, such as: 3 of 27 laws,
        energy for 21 s where 2 s were expected, case 7 for 8 s.
        """
        late, running, left = self.late(), list(self.began), self.left
        words = [f"{len(self.found)} of {len(self.found) + len(self.left)} laws"]
        for law in running:
            spent, expected = late.get(law, (0.0, 0.0))
            words.append(law)
            # The pace is unknown before the first law is done, and a step's seconds may be unknown
            # after it.
            if spent and self.found and (self.rates()[1] or law not in left or not left[law].steps):
                words[-1] += f" for {spent:.0f} s where {max(1.0, expected):.0f} s were expected"
        since = time.monotonic() - journal.since if journal and journal.cases and len(running) == 1 else 0.0
        if journal and since > SLOW_SECONDS:
            first = not self.found and journal.cases == 1
            waiting = f"waiting for the first step of {name}," if first else f"case {journal.cases} for"
            words.append(f"{waiting} {since:.0f} s")
        return ", ".join(words)


def _weighted_median(entries: Iterable[tuple[float, float]]) -> float:
    """The weighted median of at least one (value, weight)."""
    ordered = sorted(entries)
    reached = list(accumulate(weight for _, weight in ordered))
    return ordered[bisect_left(reached, reached[-1] / 2)][0]


@contextmanager
def watching(
    quiet: bool = False, laws: Sequence[Law] = (), name: str = "the scheme"
) -> Iterator[LawProgress]:
    """A progress callback for `sepv.verification.verify` with these laws; `name` names the
    scheme.
    """
    course, journal = Course(laws), current_journal()
    with showing(quiet) as shown:
        # Loading a scheme calls its function, which may be compiled at the first call.
        shown.update(f"waiting for the first step of {name}")
        shown.expected = course.seconds_left

        def step(law: Law, finding: Finding | None) -> None:
            course.heard(law, finding)
            if finding and finding.verdict in (Verdict.VIOLATED, Verdict.ERROR):
                shown.found.append(finding.words + ("" if finding.claimed else ", not claimed"))
            shown.doing = partial(course.doing, journal, name)

        yield step
