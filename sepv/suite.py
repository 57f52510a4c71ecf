"""The suite: one list of laws, run on a scheme, and the report of what was found."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from sepv._version import __version__
from sepv.arguments import did_you_mean
from sepv.errors import SepvError, Skipped, TargetError, UsageError
from sepv.expected import ExpectedFailure
from sepv.expected import load as load_expected
from sepv.law import Effort, Finding, Law, Verdict
from sepv.scheme import Scheme, Step
from sepv.target import load_scheme

# In the order in which a reader wants them: what nothing else makes sense without comes first.
LAWS = (
    "contract",
    "reproducibility",
    "identity",
    "energy",
    "casimir",
    "any-casimir",
    "midpoint",
    "reduction",
    "noise-sum",
    "expansion",
    "symmetry",
    "equivariance",
    "reference",
    "rounding",
    "truncation",
    "mean-square-order",
    "weak-order",
    "right-limit",
    "commutation",
)

Progress = Callable[[Law, "Finding | None"], None]


class _TimedOut(BaseException):
    """Raised in a scheme that does not come back; not an Exception, so that no handler of its own keeps it."""


@dataclass(frozen=True, repr=False)
class Report:
    """What the laws found of one scheme."""

    scheme: Scheme
    findings: tuple[Finding, ...]
    effort: Effort
    interrupted: bool = False

    @property
    def counts(self) -> dict[str, int]:
        """How many laws ended in each verdict; the sum is the number of laws asked for."""
        return {v.value: sum(f.verdict is v for f in self.findings) for v in Verdict}

    @property
    def exit_code(self) -> int:
        """0: every claimed law holds. 1: one does not, or an expected failure passes. 3: an error. 130: interrupted.

        A claimed law that is inconclusive was not shown to hold: 1. Nothing measured at all: 1.
        """
        if self.interrupted:
            return 130
        if self.failing:
            return 1
        if any(f.verdict is Verdict.ERROR for f in self.findings):
            return 3
        measured = (Verdict.HOLDS, Verdict.VIOLATED, Verdict.INCONCLUSIVE)
        return 0 if any(f.verdict in measured for f in self.findings) else 1

    @property
    def failing(self) -> tuple[Finding, ...]:
        """Claimed laws that were not shown to hold, and expected failures that no longer fail."""
        open_ = (Verdict.VIOLATED, Verdict.INCONCLUSIVE)
        return tuple(
            f
            for f in self.findings
            if (f.expected is None and f.claimed and f.verdict in open_)
            or (
                f.expected is not None
                and f.verdict is not Verdict.VIOLATED
                and f.verdict is not Verdict.ERROR
            )
        )

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
        return {
            "suite": {
                "name": "sepv",
                "version": __version__,
                "laws": len(self.findings),
                "seed": self.effort.seed,
                "examples": self.effort.examples,
                "paths": self.effort.paths,
            },
            "scheme": {
                "name": self.scheme.name,
                "source": self.scheme.source,
                "claims": sorted(self.scheme.claims),
                "mean_square_order": self.scheme.mean_square_order,
                "weak_order": self.scheme.weak_order,
                "solver_tolerance": self.scheme.solver_tolerance,
                "truncation": self.scheme.truncation,
            },
            "counts": self.counts,
            "laws": [_finding_json(f) for f in self.findings],
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
) -> Report:
    """Measure every law on a scheme, claimed or not.

    Parameters
    ----------
    scheme : str, Scheme or function
        As for `sepv.target.load_scheme`.
    laws : iterable of str, optional
        Only these.
    claims : iterable of str
        Laws to hold it to beyond what it claims itself.
    timeout : float
        Seconds for one law, in the main thread of a POSIX system: a scheme that does not come back ends
        in the verdict `error`. Python code can be interrupted so, a compiled loop cannot.
    progress : callable (law, finding or None), optional
        Called before each law with None, and after it with its finding.
    expected : path, optional
        A file of expected failures (`sepv.expected`): their laws are checked by the pinned witness alone.

    Raises
    ------
    TargetError, UsageError
        For a scheme that cannot be loaded, an unknown law or claim.
    """
    chosen, effort = load_laws(laws), effort or Effort()
    candidate = _load(scheme, claims, timeout)
    load_laws(candidate.claims)
    failures = load_expected(expected, LAWS) if expected is not None else {}
    findings: list[Finding] = []
    interrupted = False
    for law in chosen:
        if interrupted:
            findings.append(_claimed(law, candidate, law.finding(Verdict.ERROR, message="interrupted")))
            continue
        if progress:
            progress(law, None)
        try:
            finding = _claimed(law, candidate, _run(law, candidate, effort, timeout, failures.get(law.name)))
        except KeyboardInterrupt:
            interrupted = True
            finding = _claimed(law, candidate, law.finding(Verdict.ERROR, message="interrupted"))
        findings.append(finding)
        if progress:
            progress(law, finding)
    return Report(candidate, tuple(findings), effort, interrupted)


def _load(scheme: str | Scheme | Step, claims: Iterable[str], timeout: float) -> Scheme:
    """The scheme: a bare function is called once or twice to see whether it takes batches, and may not come back."""
    try:
        with _deadline(timeout):
            return load_scheme(scheme, _listed(claims))
    except _TimedOut:
        raise TargetError(
            expected="a scheme that can be loaded, and a step that comes back",
            received=f"nothing: it did not come back within {timeout:g} s",
            remedy="a step of a small problem takes milliseconds; look for a loop that does not end",
        ) from None


def replay(scheme: str | Scheme | Step, law: str, witness: dict[str, Any]) -> Finding:
    """Measure one law on one witness, as a report holds it."""
    candidate = load_scheme(scheme)
    (chosen,) = load_laws([law])
    return _claimed(chosen, candidate, chosen.replay(chosen, candidate, witness))


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
        finding = law.finding(Verdict.NOT_APPLICABLE, message=str(skipped))
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
        remedy="copy what the report prints after --replay, or write the file anew with --write-expected",
    )


def _claimed(law: Law, scheme: Scheme, finding: Finding) -> Finding:
    return replace(finding, claimed=law.claimed_by(scheme))


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
        "witness": finding.witness,
        "replay": finding.replay,
        "checks": finding.checks,
        "message": finding.message,
        "expected": finding.expected,
        "seconds": round(finding.seconds, 3),
    }
