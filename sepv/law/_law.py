"""Records of a law (a property of one-step methods and its measurement), of its verdict,
and of a run's effort.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING, Any

from sepv._arguments import require_whole
from sepv.law.cases.case import NO_NOISE
from sepv.record import EPS
from sepv.schemes import Scheme

if TYPE_CHECKING:
    from sepv.law.cases.case import Case
    from sepv.law.cases.of_law import Cases


class Verdict(Enum):
    """The verdict of a law on a scheme. Each law of a run has exactly one verdict."""

    HOLDS = "holds"
    VIOLATED = "violated"
    INCONCLUSIVE = "inconclusive"
    NOT_APPLICABLE = "not_applicable"
    ERROR = "error"
    # The run was interrupted before a decision, which says nothing about the scheme.
    NOT_MEASURED = "not_measured"

    @property
    def text(self) -> str:
        """The verdict in words."""
        return self.value.replace("_", " ")

    def of(self, number: int) -> str:
        """Words for a `number` of laws with this verdict, such as: 1 holds, 2 hold, 3 violated,
        2 errors.
        """
        plural = {Verdict.HOLDS: "hold", Verdict.ERROR: "errors"}
        return f"{number} {self.text if number == 1 else plural.get(self, self.text)}"


class Middle(Enum):
    """The way in which a law is measured on later steps of a path than the first."""

    STEPS = "each of 2, 3 or 8 steps of a path is measured alone"
    MAP = "2, 3 or 8 steps of a path are measured as one map"
    PATHS = "whole paths are measured"


@dataclass(frozen=True)
class Measurement:
    """One measurement of a law: the defect and the bound derived for it, in the law's `unit`,
    and a line of text.
    """

    defect: float
    bound: float
    detail: str = ""

    @property
    def violates(self) -> bool:
        """True if the defect exceeds the bound, or is NaN."""
        return not self.defect <= self.bound

    @property
    def ratio(self) -> float:
        """Defect over bound, for comparing measurements."""
        if self.bound > 0:
            return self.defect / self.bound
        return 0.0 if self.defect == 0 else float("inf")


def to_bound(defect: float | None, bound: float | None, *, at_least: bool, violated: bool) -> float | None:
    """The ratio defect/bound of a law, or bound/defect for a lower bound;
    a law whose ratio is above 1 is violated.

    The ratio is None if nothing was measured, and ∞ if the defect is not finite or a bound 0 is
    exceeded.
    """
    if bound is None or (defect is None and not violated):
        return None
    if defect is None:
        return math.inf
    if at_least:
        return max(bound, 0.0) / defect if defect > 0 else math.inf
    return abs(defect) / bound if bound > 0 else math.inf if defect else 0.0


@dataclass(frozen=True)
class Finding:
    """The result of measuring a law on a scheme.

    Attributes
    ----------
    defect, bound : float or None
        The worst measurement, in `unit`; None if nothing was measured.
    witness : dict or None
        The input that shows a violation or an error: a `sepv.verification.Case` as JSON, or the
        setup of paths.
    replay : str
        Arguments after ``sepv verify TARGET`` that measure the witness again.
    checks : int
        The number of measured examples or paths.
    message : str
        The witness in words, or the reason of the verdict.
    at_least : bool
        True if the bound is a lower bound, as for a measured order.
    traceback : str
        The traceback of an exception that the scheme raised.
    expected : str or None
        If the law was expected to fail, the reason. The law was then measured on a stored witness
        alone.
    skipped : int
        The number of cases that the scheme refuses (`sepv.errors.Skipped`).
    share : float or None
        The fraction of the law's cases that was measured, if the scheme skipped cases that it must
        not refuse.
    afresh : str
        For a violation, the verdict on its witness in a new process; empty if there was no such
        process.
    power : float or None
        For a violation of an invariant or a structure (`Law.preserves`), the power of h with which
        the defect falls at its witness; None if it is not clear.
    along : tuple of (law, witness)
        For a law about paths, steps of its paths that a law about single steps should measure.
    step_seconds : float or None
        Seconds for a step of one state, if the law timed it. They help to estimate a run's
        remaining time.
    """

    law: str
    verdict: Verdict
    source: str
    unit: str
    claimed: bool = False
    defect: float | None = None
    bound: float | None = None
    witness: dict[str, Any] | None = None
    replay: str = ""
    checks: int = 0
    message: str = ""
    seconds: float = 0.0
    at_least: bool = False
    traceback: str = ""
    expected: str | None = None
    skipped: int = 0
    step_seconds: float | None = None
    share: float | None = None
    afresh: str = ""
    power: float | None = None
    along: tuple[tuple[str, dict[str, Any]], ...] = ()

    @property
    def waived(self) -> bool:
        """True if the law is violated as expected."""
        return self.expected is not None and self.verdict is Verdict.VIOLATED

    @property
    def verdict_text(self) -> str:
        """The verdict in words; "expected" for a law that is violated as expected."""
        return "expected" if self.waived else verdict_text(self.verdict, self.share, self.afresh)

    @property
    def ratio(self) -> float | None:
        """The defect in units of the bound, as `to_bound` gives it."""
        return to_bound(
            self.defect, self.bound, at_least=self.at_least, violated=self.verdict is Verdict.VIOLATED
        )

    @property
    def words(self) -> str:
        """The finding as one line, such as: casimir (Prop. 3.2) violated:
        1.2e+09 against 51 ulp of C.
        """
        size = ""
        if self.defect is not None and self.bound is not None:
            size = f": {self.defect:.3g} against {self.bound:.3g} {self.unit}"
        why = f" ({self.expected})" if self.waived else ""
        return f"{self.law} ({self.source}) {self.verdict_text}{size}{why}"


def verdict_text(verdict: Verdict, share: float | None, afresh: str) -> str:
    """The verdict in words, such as "holds on 71 %" if cases were skipped,
    or "depends on earlier calls".
    """
    if verdict is Verdict.VIOLATED and afresh == Verdict.HOLDS.value:
        return "depends on earlier calls"
    return f"holds on {math.floor(100 * share)} %" if share and verdict is Verdict.HOLDS else verdict.text


def same_error(message: str) -> str:
    """The line of a message by which equal errors are recognized:
    an error that all laws meet is shown once.
    """
    return "".join(message.splitlines()[-3:][:1])


@dataclass(frozen=True)
class Effort:
    """The effort of a run.

    Attributes
    ----------
    examples : int
        Random examples of Hypothesis for each law. They come after the law's design: a list of
        cases that covers all ranges of properties such as the dimension.
    designs : int
        Repetitions of a law's design, each with other random numbers in the same ranges.
    paths : int
        Largest number of paths of a statistical law. For a scheme that takes one state at a time,
        laws make fewer steps, unless this number is above the default.
    seed : int
        The seed of examples and paths: the same seed gives the same run.
    shrink_checks : int
        The most measurements for simplifying a counterexample; 0 leaves it unchanged. This is a
        number and not a time, so that a finding does not depend on the load of the machine.
    corpus : bool
        True if stored cases that once showed a violation are tried first.
    """

    examples: int = 8
    paths: int = 8192
    seed: int = 0
    shrink_checks: int = 500
    designs: int = 1
    corpus: bool = True

    def __post_init__(self) -> None:
        for key, least in (("examples", 1), ("paths", 1), ("designs", 1), ("shrink_checks", 0), ("seed", 0)):
            require_whole(key, getattr(self, key), "leave it out for the usual effort", least)

    def deeper(self) -> Effort:
        """The effort of a nightly run: more examples, designs and paths."""
        return replace(self, examples=1000, designs=20, paths=16384, shrink_checks=5000)


@dataclass(frozen=True)
class Run:
    """One run of laws on one scheme: the effort, and errors that are computed once for several
    laws.

    Attributes
    ----------
    effort : Effort
    paths : dict
        Errors along sampled paths; the key is the setup of the paths.
    steps : dict
        Errors of single steps; the key is the problem, which is compared by identity.
    worst : dict
        The worst steps of paths so far.
    target, problems : str, any
        The scheme and its problems in words that another process can load; "" if there are none.
    worker : str
        The module of a process that answers questions about such a scheme.
    """

    effort: Effort = field(default_factory=Effort)
    paths: dict[Any, Any] = field(default_factory=dict, compare=False, repr=False)
    steps: dict[Any, Any] = field(default_factory=dict, compare=False, repr=False)
    worst: dict[Any, Any] = field(default_factory=dict, compare=False, repr=False)
    target: str = ""
    problems: Any = None
    worker: str = ""


@dataclass(frozen=True)
class Law:
    """A property of one-step methods.

    Attributes
    ----------
    run : (law, scheme, run) -> Finding
        Searches for a violation.
    replay : (law, scheme, witness) -> Finding
        Measures the law on one witness, a stored counterexample.
    always_claimed : bool
        True for the contract of ``step``, which every scheme must obey.
    cost : float
        Processor seconds that the law needs for scheme (2.1) of the paper, besides its steps. They
        serve to estimate a run's remaining time. If laws share paths, the cost of the first of
        these laws includes the paths.
    steps : int
        The number of steps that the law makes with scheme (2.1) on fixed problems; a step of M
        states counts M times.
    cases : sepv.verification.Cases or None
        The cases of a law about single steps; None for other laws.
    spared : int
        The number of steps for a scheme that takes one state a call, if the law then makes fewer
        steps; else 0.
    statistical : bool
        True if the law judges sampled paths, so that its verdict may be false by chance.
        Statistical laws share the probability of a false alarm of a run evenly.
    middle : sepv.verification.Middle or str
        How the law is measured in the middle of a path of a scheme with memory, or why it is about
        first steps only.
    preserves : bool
        True if a step preserves an invariant or a structure by this law about single steps. A
        violation is then reported with the power of h with which its defect falls.
    measure : (scheme, case) -> Measurement, optional
        Measures one case of a law about single steps.
    """

    name: str
    statement: str
    source: str
    unit: str
    run: Callable[[Law, Scheme, Run], Finding]
    replay: Callable[[Law, Scheme, dict[str, Any]], Finding]
    always_claimed: bool = False
    cost: float = 1.0
    steps: int = 0
    cases: Cases | None = None
    spared: int = 0
    statistical: bool = False
    middle: Middle | str = Middle.PATHS
    preserves: bool = False
    measure: Callable[[Scheme, Case], Measurement] | None = None

    def claimed_by(self, scheme: Scheme) -> bool:
        """True if the scheme claims this law."""
        return self.always_claimed or self.name in scheme.claims

    def finding(self, verdict: Verdict, **details: Any) -> Finding:
        """A finding of this law. A defect or bound that is not a number decides nothing:
        then it is inconclusive.
        """
        unknown = any(math.isnan(details.get(key) or 0.0) for key in ("defect", "bound"))
        if unknown and verdict in (Verdict.HOLDS, Verdict.VIOLATED):
            verdict = Verdict.INCONCLUSIVE
            details["message"] = f"the measurement is not a number\n{details.get('message', '')}".rstrip()
        return Finding(law=self.name, verdict=verdict, source=self.source, unit=self.unit, **details)


def in_units(scheme: Scheme, finding: Finding) -> Finding:
    """Convert a finding from ulp of binary64 to ulp of the scheme's precision,
    called ulp32 in single precision.
    """
    ratio = scheme.eps / EPS
    if ratio == 1 or not finding.unit.startswith("ulp"):
        return finding
    sizes = {k: v / ratio for k in ("defect", "bound") if (v := getattr(finding, k)) is not None}
    return replace(finding, unit=finding.unit.replace("ulp", "ulp32", 1), **sizes)


Measure = Callable[[Law, Scheme, Run], Finding]


def about_noise(run: Measure) -> Measure:
    """Wrap a law's `run`, so that the law is not applicable to schemes that are only for systems
    without noise.
    """

    def asked(law: Law, scheme: Scheme, this_run: Run) -> Finding:
        if scheme.deterministic:
            return law.finding(Verdict.NOT_APPLICABLE, message=NO_NOISE)
        return run(law, scheme, this_run)

    return asked


_collected: ContextVar[tuple[list[Finding], Measure | None] | None] = ContextVar("collected", default=None)


def laws_in(module: Any) -> tuple[Law, ...]:
    """The laws of a file of `sepv.properties`: `laws`, if its law has parts, else `law`;
    empty for other modules.
    """
    found = getattr(module, "laws", (getattr(module, "law", None),))
    return tuple(law for law in found if isinstance(law, Law)) if isinstance(found, tuple) else ()


@contextmanager
def collecting(findings: list[Finding], measure: Measure | None = None) -> Iterator[None]:
    """A context for test runners: in it `require` appends to `findings`, and calls `measure`,
    if given, to measure.
    """
    token = _collected.set((findings, measure))
    try:
        yield
    finally:
        _collected.reset(token)


def require(law: Law, scheme: Scheme, effort: Effort | None = None) -> Finding:
    """Measure a law in a test and return its finding; raise `LawViolated` if the scheme claims it
    and it does not hold.

    A claimed law also raises if it is inconclusive or ends in an error; a law that is not claimed
    never raises.
    """
    __tracebackhide__ = True  # hides this frame: pytest then shows the finding and no frames of sepv
    findings, measure = _collected.get() or ([], None)
    run = Run(effort or Effort())
    measured = measure(law, scheme, run) if measure else law.run(law, scheme, run)
    finding = replace(measured, claimed=law.claimed_by(scheme))
    findings.append(finding)
    unasked = finding.verdict is Verdict.NOT_APPLICABLE and not finding.skipped
    if finding.claimed and finding.verdict is not Verdict.HOLDS and not unasked:
        raise LawViolated(finding)
    return finding


class LawViolated(AssertionError):
    """A claimed law does not hold; the error carries its finding."""

    def __init__(self, finding: Finding) -> None:
        self.finding = finding
        super().__init__(f"{finding.words}\n{finding.message}")
