"""The suite: one list of laws, run on a scheme, and the report of what was found."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from sepv import side_by_side
from sepv._version import __version__
from sepv.arguments import did_you_mean
from sepv.engine.workers import run_all
from sepv.errors import ClusterFailure, SepvError, Skipped, TargetError, UsageError
from sepv.expected import Expectations, ExpectedFailure
from sepv.expected import load as load_expected
from sepv.given import items
from sepv.law import Effort, Finding, Law, Verdict
from sepv.levels import LEVELS, SUITE, Conformance, conformance
from sepv.point_laws import NORMAL, point_law
from sepv.scheme import Scheme, Step
from sepv.target import load_scheme, words_for

# In the order in which a reader wants them: what nothing else makes sense without comes first.
LAWS = (
    "contract",
    "reproducibility",
    "identity",
    "energy",
    "energy-drift",
    "casimir",
    "any-casimir",
    "poisson-map",
    "symplecticity",
    "positivity",
    "midpoint",
    "reduction",
    "noise-sum",
    "random-step",
    "expansion",
    "symmetry",
    "equivariance",
    "reference",
    "rounding",
    "truncation",
    "local-mean",
    "local-mean-square",
    "local-weak",
    "mean-square-order",
    "weak-order",
    "right-limit",
    "commutation",
)

# Laws that share the paths they draw (`Effort.cache`): one process measures them, in this order.
SAMPLED = ("mean-square-order", "weak-order", "right-limit", "commutation")
# Those that share errors of one step.
LOCAL = ("local-mean", "local-mean-square", "local-weak")

Progress = Callable[[Law, "Finding | None"], None]


class _TimedOut(BaseException):
    """Raised in a scheme that does not come back; not an Exception, so that no handler of its own keeps it."""


@dataclass(frozen=True, repr=False)
class Report:
    """What the laws found of one scheme. `print` shows the table; so does a notebook.

    Attributes
    ----------
    scheme : Scheme
    findings : tuple of Finding
        One for each law that was asked for, in the order of the suite: verdict, defect, bound, message, witness.
    effort : Effort
    interrupted : bool
        Whether some laws were not measured.
    pinned : bool
        Whether the run was held to a pin (`sepv.expected`): every violation must be claimed or listed there.
    gaps : tuple of str
        Sentences about laws that the pin says nothing of, or that it guards and that were not measured now.
    target : str
        What stands for the scheme, and what it is for, in a command; empty where no words do.
    level : int or None
        The level of conformance that was asked for.
    """

    scheme: Scheme
    findings: tuple[Finding, ...]
    effort: Effort
    interrupted: bool = False
    pinned: bool = False
    target: str = ""
    gaps: tuple[str, ...] = ()
    level: int | None = None

    @property
    def conformance(self) -> Conformance | None:
        """The level that the scheme reaches (`sepv.levels`); None where laws of level 1 were not measured."""
        return conformance(self.findings, load_laws())

    @property
    def short_of_level(self) -> bool:
        """Whether the level that was asked for is not reached."""
        reached = self.conformance if self.level is not None else None
        return self.level is not None and (reached is None or reached.level < self.level)

    @property
    def counts(self) -> dict[str, int]:
        """How many laws ended in each verdict; the sum is the number of laws asked for.

        "not_measured" is there where the run was interrupted, and only there.
        """
        found = {v.value: sum(f.verdict is v for f in self.findings) for v in Verdict}
        if not found[Verdict.NOT_MEASURED.value]:
            del found[Verdict.NOT_MEASURED.value]
        return found

    @property
    def exit_code(self) -> int:
        """0: every claimed law holds. 1: one does not, or an expected failure passes. 3: an error. 130: interrupted.

        A claimed law that is inconclusive, or whose cases the scheme skipped, was not shown to hold: 1. Nothing
        measured at all: 1. A level of conformance that was asked for and is not reached: 1.
        """
        if self.interrupted:
            return 130
        if self.failing or self.short_of_level:
            return 1
        if any(f.verdict is Verdict.ERROR for f in self.findings):
            return 3
        measured = (Verdict.HOLDS, Verdict.VIOLATED, Verdict.INCONCLUSIVE)
        return 0 if any(f.verdict in measured for f in self.findings) else 1

    @property
    def failing(self) -> tuple[Finding, ...]:
        """Claimed laws that were not shown to hold, expected failures that no longer fail; violations outside a pin."""
        return tuple(f for f in self.findings if fails(f, self.pinned))

    def finding(self, law: str) -> Finding:
        """The finding of one law.

        Raises
        ------
        UsageError
            For a law that is not in the report.
        """
        known = {f.law: f for f in self.findings}
        found = known.get(str(law).replace("_", "-"))
        if found is None:
            raise UsageError(
                expected=f"a law of this report, one of {', '.join(known)}",
                received=did_you_mean(law, known),
                remedy="ask for one of these, or measure more laws",
            )
        return found

    def __str__(self) -> str:
        """The table of the laws, the counterexamples and the last line, as `sepv verify` prints them."""
        from sepv.report import as_text

        return as_text(self)

    def __repr__(self) -> str:
        """One line: the scheme and the counts."""
        counts = ", ".join(f"{n} {Verdict(k).text}" for k, n in self.counts.items() if n)
        return f"<Report of {self.scheme.name}: {counts}>"

    def _repr_html_(self) -> str:
        """The table in a notebook."""
        from sepv.report import as_html

        return as_html(self)

    def to_json(self) -> dict[str, Any]:
        """The report as JSON: suite, scheme, counts, laws."""
        points = point_law(self.scheme.increments)
        return {
            "suite": {
                "name": "sepv",
                "version": __version__,
                "laws_version": SUITE,
                "laws": len(self.findings),
                "seed": self.effort.seed,
                "examples": self.effort.examples,
                "paths": self.effort.paths,
            },
            "scheme": {
                "name": self.scheme.name,
                "target": self.target,
                "source": self.scheme.source,
                "claims": sorted(self.scheme.claims),
                "mean_square_order": self.scheme.mean_square_order,
                "weak_order": self.scheme.weak_order,
                "solver_tolerance": self.scheme.solver_tolerance,
                "truncation": self.scheme.truncation,
                "increments": NORMAL if points is None else points.name,
            },
            "conformance": _conformance_json(self.conformance),
            "counts": self.counts,
            "laws": [_finding_json(f) for f in self.findings],
        }


def _conformance_json(reached: Conformance | None) -> dict[str, Any] | None:
    if reached is None:
        return None
    return {
        "level": reached.level,
        "laws": {str(level): list(names) for level, names in reached.laws.items()},
        "waived": list(reached.waived),
        "why_not_more": reached.why,
    }


def load_laws(names: Iterable[str] | None = None) -> list[Law]:
    """The laws by name, all of them by default, in the suite's order.

    Raises
    ------
    UsageError
        For an unknown name.
    """
    wanted = LAWS if names is None else tuple(str(n).strip().replace("_", "-") for n in _listed(names))
    for name in wanted:
        if name not in LAWS:
            raise UsageError(
                expected=f"a law, one of {', '.join(LAWS)}",
                received=did_you_mean(name, LAWS),
                remedy="see `sepv list`",
            )
    ordered = [name for name in LAWS if name in wanted]
    return [import_module(f"sepv.properties.test_{name.replace('-', '_')}").law for name in ordered]


def laws_of(names: Iterable[str] | None = None, level: int | None = None) -> list[Law]:
    """The laws that a run is asked for: by name, or up to a level of conformance.

    Raises
    ------
    UsageError
        For both, an unknown name or level.
    """
    if level is None:
        return load_laws(names)
    if level not in LEVELS or isinstance(level, bool) or names is not None:
        raise UsageError(
            expected="a level of 1, 2 or 3, without a list of laws",
            received=f"level {level!r}" + ("" if names is None else " and laws"),
            remedy="level 2 takes the laws of levels 1 and 2; leave out one or the other",
        )
    return [law for law in load_laws() if law.level <= level]


def _listed(names: str | Iterable[str]) -> Iterable[str]:
    """The names of a list, or of one string with commas between them."""
    return names.split(",") if isinstance(names, str) else names


def verify(
    scheme: str | Scheme | Step,
    *,
    laws: Iterable[str] | None = None,
    claims: Iterable[str] = (),
    effort: Effort | None = None,
    timeout: float = 600.0,
    progress: Progress | None = None,
    expected: str | Path | None = None,
    jobs: int = 1,
    problems: Any = None,
    workers: Any = None,
    level: int | None = None,
) -> Report:
    """Measure every law on a scheme, claimed or not.

    Parameters
    ----------
    scheme : str, Scheme or function
        As for `sepv.target.load_scheme`.
    laws : iterable of str, or one string with commas, optional
        Only these; all by default.
    claims : iterable of str, or one string with commas
        Laws to hold it to beyond what it claims itself.
    timeout : float
        Seconds for one law, in the main thread of a POSIX system: a scheme that does not come back ends
        in the verdict `error`. Python code can be interrupted so, a compiled loop cannot.
    progress : callable (law, finding or None), optional
        Called before each law with None, and after it with its finding.
    expected : path, optional
        A file of claims and of expected failures (`sepv.expected`): the claims are added, and the laws expected to
        fail are checked by the pinned witness alone.
    jobs : int
        Laws measured side by side in so many processes, with the same verdicts. The scheme must be one that another
        process can import.
    problems : problem or strategy, or a list of them, optional
        What the scheme is for, where that is not every system of its class: built-in names, families
        (`sepv.families`), ``module:attribute``, ``.json`` files, `Problem` records, Hypothesis strategies of
        `PolynomialSystem` or `Problem`. Laws draw their cases from these alone.
    workers : executor, map-like callable, Dask client or its address, optional
        The same on other machines (docs/clusters.md): what an engine for `sepv.ensemble` is serves here. Where a
        cluster is lost, the laws that were not decided are not measured, and the report counts as interrupted.
    effort : Effort, optional
        How hard to look; ``Effort().deeper()`` for a night.
    level : 1, 2 or 3, optional
        Only the laws up to this level of conformance (`sepv.levels`), which must be reached; not beside `laws`.

    Returns
    -------
    Report
        A finding for each law; `print` shows the table, `exit_code` is that of ``sepv verify``.

    Raises
    ------
    TargetError, UsageError
        For a scheme that cannot be loaded, an unknown law or claim.

    Examples
    --------
    >>> import sepv
    >>> report = sepv.verify("midpoint", laws="energy,casimir")
    >>> report.counts["holds"], report.counts["violated"], report.exit_code
    (1, 1, 0)
    >>> report.finding("energy").verdict.text  # its message has the counterexample
    'violated'
    """
    chosen, effort = laws_of(laws, level), effort or Effort()
    if not isinstance(jobs, int) or isinstance(jobs, bool) or jobs < 1:
        raise UsageError(expected="jobs, an integer ≥ 1", received=repr(jobs), remedy="jobs=2 for two cores")
    listed = load_expected(expected, LAWS) if expected is not None else Expectations()
    candidate = _load(scheme, {*_listed(claims), *(listed.claims or ())}, timeout, problems)
    load_laws(candidate.claims)
    found: dict[str, Finding] = {}

    def receive(law: Law, finding: Finding | None) -> None:
        if finding is not None:
            finding = found[law.name] = replace(finding, claimed=law.claimed_by(candidate))
        if progress:
            progress(law, finding)

    interrupted, why = False, "interrupted before it was decided"
    try:
        if workers is not None or (jobs > 1 and len(chosen) > 1):
            named = scheme if isinstance(scheme, str) else candidate
            claimed = frozenset(candidate.claims)
            task = side_by_side.Task(named, claimed, effort, timeout, listed.failures, problems)
            _side_by_side(task, chosen, jobs if workers is None else workers, receive)
        else:
            for law in chosen:
                receive(law, None)
                receive(law, _run(law, candidate, effort, timeout, listed.failures.get(law.name)))
    except KeyboardInterrupt:
        interrupted = True
    except ClusterFailure as error:
        interrupted, why = True, str(error)
    for law in chosen:
        if law.name not in found:
            unmeasured = law.finding(Verdict.NOT_MEASURED, message=why)
            found[law.name] = replace(unmeasured, claimed=law.claimed_by(candidate))
    return Report(
        candidate,
        tuple(found[law.name] for law in chosen),
        effort,
        interrupted,
        listed.is_pin,
        words_for(scheme, problems),
        tuple(listed.gaps(law.name for law in chosen)),
        level,
    )


def _side_by_side(
    task: side_by_side.Task, chosen: list[Law], workers: Any, receive: Callable[[Law, Finding | None], None]
) -> None:
    """The sampled laws first, which take longest and share their paths; each other law by itself."""
    by_name = {law.name: law for law in chosen}
    shared = [[name for name in by_name if name in family] for family in (SAMPLED, LOCAL)]
    groups = [group for group in shared if group]
    groups += [[name] for name in by_name if name not in (*SAMPLED, *LOCAL)]

    def take(name: str, found: Finding | side_by_side.Died | None) -> None:
        law = by_name[name]
        if isinstance(found, side_by_side.Died):
            found = law.finding(
                Verdict.ERROR,
                message=f"the process that measured it ended with status {found}: the scheme crashed it",
            )
        receive(law, found)

    if isinstance(workers, int):
        side_by_side.run(task, groups, workers, take)
        return

    def arrived(_number: int, found: list[tuple[str, Any]]) -> None:
        for name, finding in found:
            take(name, None)
            take(name, finding)

    run_all(partial(side_by_side.measured, task), groups, workers, threads=False, receive=arrived)


def fails(f: Finding, pinned: bool = False) -> bool:
    """Whether a finding turns a run red with exit code 1; under a pin every violation must be listed."""
    if f.verdict in (Verdict.ERROR, Verdict.NOT_MEASURED):
        return False  # exit codes of their own
    if f.expected is not None:
        return f.verdict is not Verdict.VIOLATED
    if not f.claimed:
        return pinned and f.verdict is Verdict.VIOLATED
    # What the law says nothing about is no failure; what the scheme left out, or held when it was pinned, is.
    unasked = f.verdict is Verdict.NOT_APPLICABLE and not f.skipped and not pinned
    return f.verdict is not Verdict.HOLDS and not unasked


def _load(scheme: str | Scheme | Step, claims: Iterable[str], timeout: float, problems: Any = None) -> Scheme:
    """The scheme: a bare function is called once or twice to see whether it takes batches, and may not come back."""
    try:
        with _deadline(timeout):
            return load_candidate(scheme, _listed(claims), problems)
    except _TimedOut:
        raise TargetError(
            expected="a scheme that can be loaded, and a step that comes back",
            received=f"nothing: it did not come back within {timeout:g} s",
            remedy="a step of a small problem takes milliseconds; look for a loop that does not end",
        ) from None


def load_candidate(scheme: str | Scheme | Step, claims: Iterable[str], problems: Any = None) -> Scheme:
    """The scheme under verification, with what it is for."""
    if problems is None:
        return load_scheme(scheme, claims)
    own = items(problems)
    fixed = [p for item in own for p in item.problems]
    return replace(load_scheme(scheme, claims, fixed), problems=own)


def replay(scheme: str | Scheme | Step, law: str, witness: dict[str, Any]) -> Finding:
    """Measure one law on one witness, as a report holds it."""
    candidate = load_scheme(scheme)
    (chosen,) = load_laws([law])
    return replace(chosen.replay(chosen, candidate, witness), claimed=chosen.claimed_by(candidate))


def measure(
    law: Law, scheme: Scheme, effort: Effort, timeout: float = 600.0, failure: ExpectedFailure | None = None
) -> Finding:
    """One law on one scheme: by its search, or by the witness of an expected failure.

    Raises
    ------
    UsageError
        For a witness that is not one of the law's.
    """
    return _run(law, scheme, effort, timeout, failure)


def _run(
    law: Law, scheme: Scheme, effort: Effort, timeout: float, failure: ExpectedFailure | None
) -> Finding:
    start = time.perf_counter()
    try:
        with _deadline(timeout):
            finding = law.replay(law, scheme, failure.witness) if failure else law.run(law, scheme, effort)
    except _TimedOut:
        finding = law.finding(
            Verdict.ERROR, message=f"the scheme did not come back: stopped after {timeout:g} s (--timeout)"
        )
    except Skipped as skipped:
        finding = law.finding(Verdict.NOT_APPLICABLE, message=str(skipped), skipped=1)
    except KeyError as error:
        if failure is None:
            raise
        raise _wrong_witness(law, f"no {error}") from error
    except SepvError as error:
        if failure is not None and type(error) is UsageError:
            raise _wrong_witness(law, error.received) from error
        finding = law.finding(Verdict.ERROR, message=str(error), traceback=getattr(error, "traceback", ""))
    if failure:
        finding = replace(finding, expected=failure.reason)
        if finding.verdict is not Verdict.VIOLATED:
            note = f"expected to be violated ({failure.reason}), but its witness is not: remove the entry"
            finding = replace(finding, message=f"{note}\n{finding.message}".strip())
    return replace(finding, seconds=time.perf_counter() - start)


def _wrong_witness(law: Law, received: str) -> UsageError:
    return UsageError(
        expected=f"a witness of the law {law.name} in the file of expected failures",
        received=received,
        remedy="copy what the report prints after --replay, or write the file anew with --pin or --write-expected",
    )


@contextmanager
def _deadline(seconds: float) -> Iterator[None]:
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: Any) -> None:
        raise _TimedOut

    before = signal.signal(signal.SIGALRM, stop)
    # Again and again, in case the scheme swallows the first one.
    signal.setitimer(signal.ITIMER_REAL, seconds, 1.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _finite(value: Any) -> Any:
    """The same with null for numbers without size, such as an interval's open end: JSON has no infinity."""
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _finding_json(finding: Finding) -> dict[str, Any]:
    def number(value: float | None) -> float | None:
        # JSON has no infinity: a defect without size is null, and the message says what it is.
        return value if value is not None and math.isfinite(value) else None

    return {
        "law": finding.law,
        "claimed": finding.claimed,
        "verdict": finding.verdict.value,
        "defect": number(finding.defect),
        "bound": number(finding.bound),
        "at_least": finding.at_least,
        "unit": finding.unit,
        "source": finding.source,
        "witness": _finite(finding.witness),
        "replay": finding.replay,
        "checks": finding.checks,
        "skipped": finding.skipped,
        "message": finding.message,
        "expected": finding.expected,
        "seconds": round(finding.seconds, 3),
    }
