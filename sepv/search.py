"""Laws about single steps: Hypothesis looks for a case that violates, and shrinks it."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any

from hypothesis import HealthCheck, Phase, Verbosity, given, reject, settings, target
from hypothesis import seed as hypothesis_seed
from hypothesis import strategies as st
from hypothesis.errors import Unsatisfiable

from sepv import case as cases
from sepv.case import Case
from sepv.errors import SchemeFault, SepvError, Skipped, StepFailure
from sepv.given import cases_for
from sepv.law import Effort, Finding, Law, Measurement, Verdict
from sepv.same_draws import without_local_constants
from sepv.scheme import Scheme
from sepv.strategies_structures import CASES

Check = Callable[[Scheme, Case], Measurement]


class _Violation(Exception):
    """Raised inside a search: the case violates."""


class _Fault(Exception):
    """Raised inside a search: the case could not be measured."""


class _Log:
    """What a search has seen."""

    def __init__(self) -> None:
        self.checks = 0
        self.worst: Measurement | None = None
        self.violation: tuple[Case, Measurement] | None = None
        self.fault: tuple[Case, Exception] | None = None
        self.first_failure: float | None = None
        self.skipped: dict[str, int] = {}


def searched(
    *,
    name: str,
    statement: str,
    source: str,
    unit: str,
    cases: Callable[[], st.SearchStrategy[Case]],
    check: Check,
    faults_violate: bool = False,
    always_claimed: bool = False,
    not_applicable: Callable[[Scheme], str] = lambda _: "",
    corners: Callable[[], Iterable[Case]] = tuple,
) -> Law:
    """A law whose cases are drawn by a strategy and measured one by one.

    A scheme for a special class of systems is asked about those (`sepv.strategies_structures.CASES`).

    Parameters
    ----------
    check : (scheme, case) -> Measurement
        May raise what `sepv.candidate.ask` raises.
    faults_violate : bool
        For the contract: an answer of the wrong shape or type is a violation there, an error elsewhere.
    not_applicable : scheme -> str
        Why the law says nothing about this scheme; empty where it does.
    corners : () -> iterable of Case
        Measured after a search that found nothing, with every seed.
    """

    def run(law: Law, scheme: Scheme, effort: Effort) -> Finding:
        reason = not_applicable(scheme)
        if reason:
            return law.finding(Verdict.NOT_APPLICABLE, message=reason)
        own = cases_for(law.name, scheme)
        if isinstance(own, str):
            return law.finding(Verdict.NOT_APPLICABLE, message=own)
        if own is not None:
            return _search(law, scheme, effort, own, tuple, check, faults_violate)
        if scheme.systems == "single":
            return _search(law, scheme, effort, cases(), corners, check, faults_violate)
        special = CASES[scheme.systems].get(law.name)
        if special is None:
            reason = f"the law is not about the systems that the scheme takes ({scheme.systems})"
            return law.finding(Verdict.NOT_APPLICABLE, message=reason)
        return _search(law, scheme, effort, special(), tuple, check, faults_violate)

    def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
        log = _Log()
        with suppress(_Violation, _Fault, Skipped):
            _measure(log, scheme, _from_json(witness), check, faults_violate)
        return _conclude(law, log)

    return Law(name, statement, source, unit, run, replay, always_claimed)


def _from_json(witness: dict[str, Any]) -> Case:
    return cases.from_json(witness)


def _search(
    law: Law,
    scheme: Scheme,
    effort: Effort,
    strategy: st.SearchStrategy[Case],
    corners: Callable[[], Iterable[Case]],
    check: Check,
    faults_violate: bool,
) -> Finding:
    log, start = _Log(), time.perf_counter()

    def body(case: Case) -> None:
        # A slow scheme must not be shrunk for ever: past the deadline every case passes, which ends it.
        if log.first_failure is not None and time.perf_counter() - log.first_failure > effort.shrink_seconds:
            return
        try:
            measured = _measure(log, scheme, case, check, faults_violate)
        except Skipped:
            reject()  # the budget goes to cases that the program takes
        if 0 < measured.ratio < float("inf"):
            target(measured.ratio, label="defect / bound")

    chosen = settings(
        max_examples=effort.examples,
        database=None,
        deadline=None,
        derandomize=False,
        print_blob=False,
        report_multiple_bugs=True,
        verbosity=Verbosity.quiet,
        phases=(Phase.generate, Phase.target, Phase.shrink),
        # Cases are large by nature, and a slow scheme is not the strategy's fault.
        suppress_health_check=list(HealthCheck),
    )
    test = hypothesis_seed(effort.seed)(chosen(given(case=strategy)(body)))
    try:
        with warnings.catch_warnings(), without_local_constants():
            warnings.simplefilter("ignore")  # the scheme's own warnings are not findings
            test()
    except KeyboardInterrupt:
        raise
    except Unsatisfiable:
        if not log.skipped:
            raise
    except BaseException:
        if log.violation is None and log.fault is None:
            raise  # not about the scheme: a defect of this suite, which must be seen
    if log.violation is None and log.fault is None:
        _visit(log, scheme, corners(), check, faults_violate)
    finding = _conclude(law, log)
    return Finding(**{**finding.__dict__, "seconds": time.perf_counter() - start})


def _visit(log: _Log, scheme: Scheme, corners: Iterable[Case], check: Check, faults_violate: bool) -> None:
    """The corners in turn, up to the first that violates or cannot be measured."""
    with warnings.catch_warnings(), suppress(_Violation, _Fault):
        warnings.simplefilter("ignore")
        for case in corners:
            with suppress(Skipped):
                _measure(log, scheme, case, check, faults_violate)


def _measure(log: _Log, scheme: Scheme, case: Case, check: Check, faults_violate: bool) -> Measurement:
    """Measure and log one case; raises _Violation or _Fault, from places of their own."""
    log.checks += 1
    try:
        measured = check(scheme, case)
    except Skipped as skipped:
        log.checks -= 1
        log.skipped[skipped.reason] = log.skipped.get(skipped.reason, 0) + 1
        raise
    except (SepvError, ArithmeticError) as error:
        if log.first_failure is None:
            log.first_failure = time.perf_counter()
        if faults_violate and isinstance(error, SchemeFault):
            log.violation = case, Measurement(1.0, 0.0, str(error))
            log.worst = log.violation[1]
            raise _Violation from error
        log.fault = case, error
        raise _Fault from error
    if log.worst is None or not measured.ratio <= log.worst.ratio:
        log.worst = measured
    if measured.violates:
        if log.first_failure is None:
            log.first_failure = time.perf_counter()
        log.violation = case, measured
        raise _Violation
    return measured


def _conclude(law: Law, log: _Log) -> Finding:
    size = {"defect": log.worst.defect, "bound": log.worst.bound} if log.worst else {}
    if log.violation is not None:
        case, measured = log.violation
        message = f"{case.describe()}\n{measured.detail}"
        return law.finding(
            Verdict.VIOLATED, checks=log.checks, message=message, **_witness(law, case), **size
        )
    if log.fault is not None:
        case, error = log.fault
        kind = "not solved" if isinstance(error, StepFailure) else "not measured"
        message = f"{kind}:\n{case.describe()}\n{error}"
        trace = getattr(error, "traceback", "")
        return law.finding(
            Verdict.ERROR, checks=log.checks, message=message, traceback=trace, **_witness(law, case), **size
        )
    skipped = "\n".join(f"{count} cases skipped: {reason}" for reason, count in log.skipped.items())
    left_out = sum(log.skipped.values())
    if not log.checks:
        verdict = Verdict.NOT_APPLICABLE if skipped else Verdict.ERROR
        return law.finding(verdict, message=skipped or "no case was measured", skipped=left_out)
    return law.finding(Verdict.HOLDS, checks=log.checks, message=skipped, skipped=left_out, **size)


def _witness(law: Law, case: Case) -> dict[str, Any]:
    return {"witness": cases.to_json(case), "replay": f"--law {law.name} --replay {cases.to_token(case)}"}
