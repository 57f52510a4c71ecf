"""Laws about single steps: a design visits every stratum of the cases, then Hypothesis searches for a violation.

Witnesses of the corpus come first (`sepv.verification._corpus`), then the design, because it misses no pair of strata
(`sepv.verification._cases.strata`). If a case of it violates, Hypothesis searches for a simpler one; if it finds none,
the case itself is simplified (`sepv.verification._cases.shrink`).
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, pairwise
from random import Random
from typing import Any

from hypothesis import HealthCheck, Phase, Verbosity, given, reject, settings, target
from hypothesis import seed as hypothesis_seed
from hypothesis.errors import Unsatisfiable

from sepv._journal import note_case, note_violation
from sepv._patches import without_local_constants
from sepv.console import counted
from sepv.errors import SchemeFault, SepvError, Skipped, StepFailure, UsageError
from sepv.problem import PolynomialSystem
from sepv.record import EPS
from sepv.schemes import Scheme, takes
from sepv.verification import _corpus as corpus
from sepv.verification._cases import case as cases_of
from sepv.verification._cases.case import Case
from sepv.verification._cases.ends import beyond, in_other_units, is_long
from sepv.verification._cases.fixed_cases import may_be_refused
from sepv.verification._cases.of_law import EVERYTHING, Cases, Question
from sepv.verification._cases.shrink import shrunk
from sepv.verification._cases.users_problems import objects_of, sources
from sepv.verification._law import Effort, Finding, Law, Measurement, Run, Verdict, in_units
from sepv.verification._share_of_defect import largest_share

Check = Callable[[Scheme, Case], Measurement]


# Reasons to leave out a state of extreme size.
FAR = "a step from a state larger or smaller than 2^±21"
LENGTHY = "a step longer than 8"
FAR_OFF = (
    f"{FAR} was not asked of a solver with a tolerance, or of an integrator without noise: "
    "thresholds may be absolute"
)
NO_BOUND = f"{FAR} has no bound: numbers overflow in it"
# The factor on the number of random examples for a law without a design.
UNDESIGNED = 12
# A search ends after this many refused cases for each accepted one.
MOST_SKIPPED = 20
# Simplification ends after this many seconds, if a check takes longer than a fifth of a second: a law may be stopped
# after ten minutes, and its violation must be reported before. Only then does the simplest counterexample depend on
# time.
MOST_SECONDS = 100.0
# The number of cases that cannot be measured before a design is given up: each may take as long as a call may.
MOST_FAULTS = 4
# The share of a law's cases that must be measured of a scheme that states its longest step. One that skips problems
# says what it is for, and may be for few of them.
LEAST_SHARE = 0.25
# Smaller relative defects may come from a solver's tolerance: eight times √eps, the default of many.
MOST_TOLERANCE = 2.0**-23


class _Violation(Exception):
    """Raised inside a search: the case violates."""


class _Fault(Exception):
    """Raised inside a search: the case could not be measured."""


class _Crash(_Fault):
    """Raised inside a search: the scheme crashed. Hypothesis simplifies it apart from other faults."""


class _Log:
    """The log of a search."""

    def __init__(self) -> None:
        self.checks = 0
        self.worst: Measurement | None = None
        self.violation: tuple[Case, Measurement] | None = None
        self.largest = 0.0  # defect of the violation, before simplification
        self.fault: tuple[Case, Exception] | None = None
        self.crash: tuple[Case, Exception] | None = None  # a fault that no violation may hide
        self.skipped: dict[str, int] = {}
        self.lacking = 0  # skipped cases that every scheme for the class is to take
        self.share: float | None = None  # of the design that was measured, where cases were lacking

    @property
    def failed(self) -> bool:
        """True if a case violated or could not be measured."""
        return self.violation is not None or self.fault is not None

    @property
    def refused(self) -> int:
        """The number of cases that the scheme refused."""
        return sum(self.skipped.values())

    def skip(self, reason: str, *, may: bool = False) -> None:
        """A case that was not taken is no check; `may` where a right scheme may refuse it."""
        self.checks -= 1
        self.lacking += not may
        self.skipped[reason] = self.skipped.get(reason, 0) + 1


class _Budget:
    """The number of checks for simplification, counted from the first failure."""

    def __init__(self, checks: int) -> None:
        self.left, self.end = checks, time.perf_counter() + MOST_SECONDS

    def spend(self) -> bool:
        """Take one check from the budget; False if it is empty."""
        self.left -= 1
        return self.left >= 0 and time.perf_counter() <= self.end


@dataclass(frozen=True)
class _Question:
    """The places where a law looks, and its measurement."""

    where: Question
    check: Check
    faults_violate: bool
    known: tuple[Case, ...]  # witnesses of the corpus, which are tried first


def searched(
    *,
    name: str,
    statement: str,
    source: str,
    unit: str,
    check: Check,
    cases: Cases = EVERYTHING,
    faults_violate: bool = False,
    always_claimed: bool = False,
    not_applicable: Callable[[Scheme], str] = lambda _: "",
    cost: float = 1.0,
    steps: int = 0,
) -> Law:
    """Make a law whose cases come from a design and from a strategy, and are measured one by one.

    Parameters
    ----------
    check : (scheme, case) -> Measurement
        May raise what `sepv.schemes.ask` raises.
    cases : Cases
        The cases of the law, for schemes of every class and for users' problems.
    faults_violate : bool
        For the contract: a result of the wrong shape or type is a violation there, an error elsewhere.
    not_applicable : scheme -> str
        The reason why the law does not apply to this scheme; empty if it does.
    cost, steps
        As for `sepv.verification.Law`.
    """

    def run(law: Law, scheme: Scheme, this_run: Run) -> Finding:
        listed = sources(scheme)
        own_cases = cases.without_noise() if scheme.deterministic else cases
        if why := not_applicable(scheme) or (own_cases if isinstance(own_cases, str) else ""):
            return law.finding(Verdict.NOT_APPLICABLE, message=why)
        assert isinstance(own_cases, Cases)
        own_cases = own_cases if scheme.dtype == "float64" else own_cases.in_single_precision()
        space = own_cases.of_problems(listed) if listed else own_cases.of_class(scheme.systems)
        if isinstance(space, str):
            return law.finding(Verdict.NOT_APPLICABLE, message=space)
        known = () if listed else tuple(own_cases.all_adapted(corpus.cases(name, scheme.systems)))
        return in_units(
            scheme, _search(law, scheme, this_run.effort, _Question(space, check, faults_violate, known))
        )

    def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
        log, case = _Log(), cases_of.from_json(witness, objects_of(scheme))
        if not cases.admits(case):
            raise UsageError(
                expected=f"a witness of the law {name}, which says: {statement}",
                received="a case of which it says nothing",
                remedy="copy the whole command from the report: a token belongs to its law",
            )
        with suppress(_Violation, _Fault, Skipped):
            _measure(log, scheme, case, check, faults_violate)
        return in_units(scheme, _conclude(law, scheme, log, check))

    return Law(name, statement, source, unit, run, replay, always_claimed, cost, steps, cases)


def _search(law: Law, scheme: Scheme, effort: Effort, question: _Question) -> Finding:
    log, start = _Log(), time.perf_counter()
    known = question.known if effort.corpus else ()
    fixed = question.where.fixed
    visited = chain.from_iterable(_designed(question.where, effort.seed, n) for n in range(effort.designs))
    _visit(log, scheme, chain(known, visited, fixed), question)
    if log.lacking and log.checks:
        log.share = log.checks / (log.checks + log.lacking)
    if not (log.failed and effort.shrink_checks == 0):
        violation, fault = log.violation, log.fault
        # Witnesses were simplified when they were found, and fixed cases are simple: a search would find nothing
        # simpler.
        if violation is None or violation[0] not in (*known, *fixed):
            _explore(log, scheme, effort, question)
        if (log.violation or log.fault) in (violation, fault) and log.failed:
            _simplify(log, scheme, effort, question)
    return replace(_conclude(law, scheme, log, question.check), seconds=time.perf_counter() - start)


def _designed(where: Question, seed: int, repeat: int) -> list[Case]:
    """The cases of a design in random order, so that no kind of case is always the first."""
    drawn = where.design(seed + 1000003 * repeat)
    Random(seed).shuffle(drawn)
    return drawn


def _explore(log: _Log, scheme: Scheme, effort: Effort, question: _Question) -> None:
    """Search random cases, driven towards large defects relative to the bound; shrink the first violation."""
    measured_before = log.checks
    simplifying: _Budget | None = None

    def body(case: Case) -> None:
        nonlocal simplifying
        # Both loops are bounded: when the budget is spent every case passes, which ends shrinking, and a search ends
        # after too many refused cases.
        if simplifying is not None and not simplifying.spend():
            return
        if log.refused > MOST_SKIPPED * (1 + log.checks - measured_before):
            return
        try:
            measured = _measure(log, scheme, case, question.check, question.faults_violate)
        except Skipped as skipped:
            if not isinstance(skipped.__cause__, StepFailure):
                reject()  # the budget is for cases that the program takes; a refused step has been tried
            return
        except (_Violation, _Fault):
            simplifying = simplifying or _Budget(effort.shrink_checks)
            raise
        if 0 < measured.ratio < float("inf"):
            target(measured.ratio, label="defect / bound")

    chosen = settings(
        max_examples=effort.examples * (1 if question.where.design(effort.seed) else UNDESIGNED),
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
    test = hypothesis_seed(effort.seed)(chosen(given(case=question.where.strategy)(body)))
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
        if simplifying is None:
            raise  # a defect of this suite, not of the scheme, which must be seen


def _visit(log: _Log, scheme: Scheme, visited: Iterable[Case], question: _Question) -> None:
    """Measure cases in turn, up to the first violation, or up to a few that cannot be measured."""
    faults: list[tuple[Case, Exception]] = []
    with warnings.catch_warnings(), suppress(_Violation):
        warnings.simplefilter("ignore")
        for case in visited:
            with suppress(Skipped, _Fault):
                _measure(log, scheme, case, question.check, question.faults_violate)
            if log.fault is not None:
                faults.append(log.fault)
                log.fault = None
            if len(faults) >= MOST_FAULTS:
                break
    log.fault = faults[0] if faults else None


def _simplify(log: _Log, scheme: Scheme, effort: Effort, question: _Question) -> None:
    """Replace the violation or fault by the simplest case that shows it."""
    case, _ = log.violation or log.fault or (None, None)
    assert case is not None
    checks = log.checks
    best, budget = (log.violation, log.fault, log.worst), _Budget(effort.shrink_checks)

    def fails(candidate: Case) -> bool | None:
        nonlocal best
        if not question.where.admits(candidate):
            return False
        if not budget.spend():
            return None
        trial = _Log()
        with warnings.catch_warnings(), suppress(_Violation, _Fault, Skipped):
            warnings.simplefilter("ignore")
            _measure(trial, scheme, candidate, question.check, question.faults_violate)
        log.checks += trial.checks
        # A violation must not turn into a fault of measurement, nor the other way round.
        same = (trial.violation is None) == (log.violation is None) and trial.failed
        if same:
            best = trial.violation, trial.fault, trial.worst or log.worst
        return same

    shrunk(case, fails)
    log.violation, log.fault, log.worst = best
    log.checks = max(checks, log.checks)


def _measure(log: _Log, scheme: Scheme, case: Case, check: Check, faults_violate: bool) -> Measurement:
    """Measure and log one case; raise _Violation or _Fault, each from its own place."""
    log.checks += 1
    note_case(lambda: cases_of.to_json(case))
    try:
        if scheme.longest_step is not None and not takes(scheme, *case.build()):
            raise Skipped("a longer step than the scheme says it takes (longest_step)")
        # A library of particles has units: ASE keeps a force where atoms move by less than 1e-15 Å.
        if (scheme.solver_tolerance or scheme.deterministic) and beyond(case):
            raise Skipped(FAR_OFF)
        measured = check(scheme, case)
        if math.isnan(measured.bound) and beyond(case):
            raise Skipped(NO_BOUND)
    except Skipped as skipped:
        if case.given != "data":
            # A scheme that cannot run functions gets the same system as data, so that the design stays whole.
            log.checks -= 1
            return _measure(log, scheme, replace(case, given="data"), check, faults_violate)
        log.skip(skipped.reason, may=skipped.reason in (FAR_OFF, NO_BOUND) or may_be_refused(case))
        raise
    except (SepvError, ArithmeticError) as error:
        if isinstance(error, StepFailure) and may_be_refused(case):
            reason = "a longer step than every scheme must take was refused"
            log.skip(reason, may=True)
            raise Skipped(reason) from error
        extreme = FAR if beyond(case) else LENGTHY if is_long(case) else ""
        if case.h <= 0 or (extreme and isinstance(error, StepFailure)):
            # A scheme that fails for h ≤ 0, which no path has, or refuses a state or a step of extreme size is
            # reported as skipped, not as violating. Errors of one kind share a line with the first message.
            back = "a step back in time, h < 0," if case.h < 0 else "a step with h = 0"
            kind = f"{back if case.h <= 0 else extreme} ended in {type(error).__name__}"
            text = str(error).partition("\n")[0]
            reason = next((r for r in log.skipped if r.startswith(kind)), f"{kind}, the first: {text}")
            log.skip(reason)
            raise Skipped(reason) from error
        if faults_violate and isinstance(error, SchemeFault):
            log.violation = case, Measurement(1.0, 0.0, str(error))
            note_violation(lambda: cases_of.to_json(case))
            log.worst = log.violation[1]
            raise _Violation from error
        log.fault = case, error
        # A result that is not a state, or none, is a result. A dead program, or an exception, is not.
        if not isinstance(error, (SchemeFault, ArithmeticError)):
            log.crash = case, error
            raise _Crash from error
        raise _Fault from error
    if log.worst is None or not measured.ratio <= log.worst.ratio:
        log.worst = measured
    if measured.violates:
        log.violation, log.largest = (case, measured), max(measured.defect, log.largest)  # NaN stays
        note_violation(lambda: cases_of.to_json(case))
        raise _Violation
    return measured


def _may_be_a_tolerance(
    law: Law, scheme: Scheme, check: Check, case: Case, measured: Measurement, largest: float
) -> str:
    """The advice to state a tolerance, if all defects are as small as a solver's, and no power of Δ."""
    small = law.unit.startswith("ulp") and measured.bound > 0 and largest * EPS < MOST_TOLERANCE
    if not small or scheme.solver_tolerance or _is_a_power(scheme, check, case, measured.defect):
        return ""
    size = f"the defect is {measured.defect * EPS:.1e}{law.unit.removeprefix('ulp')}"
    return (
        f"\n{size}; if the step solves its equation to a tolerance, state it: Scheme(…, solver_tolerance=…)"
    )


def _has_a_unit(scheme: Scheme, check: Check, case: Case) -> str:
    """The reason why a step at an extreme |y| violates, if it does not in units in which |y| is near 1."""
    if not beyond(case) or not isinstance(case.problem, PolynomialSystem):
        return ""
    near = in_other_units(case, -round(math.log2(max(map(abs, case.y)))))
    again = _measured_again(scheme, check, near)
    if again is None or again.violates:
        return ""
    return (
        "\nin units in which |y| is near 1 the same step obeys the law: a number of the scheme has a unit, as a "
        "threshold or an absolute tolerance has; if it is its solver's, state it, Scheme(…, solver_tolerance=…), and "
        "no such state is asked"
    )


def _is_a_power(scheme: Scheme, check: Check, case: Case, defect: float) -> bool:
    """True if the defect is that of a method of some order: c Δ^p with p ≥ 2, at Δ, Δ/2 and Δ/4.

    Both slopes are then p up to the next term, which is less than half of the first at a short step; 1.5 and 1 leave
    room for it. An iteration that ends at a tolerance takes fewer turns at a shorter step: its slopes differ.
    """
    defects = [defect]
    for share in (0.5, 0.25):
        shorter = replace(case, h=share * case.h, dW=tuple(share * w for w in case.dW))
        again = _measured_again(scheme, check, shorter)
        if again is None:
            return False
        defects.append(again.defect)
    if not 0 < min(defects) <= max(defects) < math.inf:
        return False
    slopes = [math.log2(long / short) for long, short in pairwise(defects)]
    return min(slopes) > 1.5 and abs(slopes[0] - slopes[1]) < 1


def _measured_again(scheme: Scheme, check: Check, case: Case) -> Measurement | None:
    """The measurement of another case, for advice; None where it cannot be made."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return check(scheme, case)
        except (SepvError, ArithmeticError):
            return None


def _conclude(law: Law, scheme: Scheme, log: _Log, check: Check) -> Finding:
    seen: dict[str, Any] = {"checks": log.checks}
    # A witness has its own size; the defect before it was simplified may be larger.
    measured = log.worst if log.violation is None else log.violation[1]
    if measured:
        seen |= {"defect": measured.defect, "bound": measured.bound}
    if log.violation is not None:
        case, measured = log.violation
        advice = _has_a_unit(scheme, check, case)
        advice = advice or _may_be_a_tolerance(law, scheme, check, case, measured, log.largest)
        if law.unit.startswith("ulp"):
            advice = largest_share(case, partial(_measured_again, scheme, check)) + advice
        message = f"{case.describe()}\n{measured.detail}{advice}"
        if log.crash is None:
            return law.finding(Verdict.VIOLATED, message=message, **_witness(law, case), **seen)
        # The crash decides the verdict: a scheme that does not always return was not measured completely.
        dead, error = log.crash
        again = _witness(law, dead)["replay"]
        message = (
            f"crashed:\n{dead.describe()}\n{error}\nIts replay: {again}\nviolated, elsewhere:\n{message}"
        )
        seen["traceback"] = getattr(error, "traceback", "")
        return law.finding(Verdict.ERROR, message=message, **_witness(law, case), **seen)
    if log.fault is not None:
        case, error = log.fault
        kind = "not solved" if isinstance(error, StepFailure) else "not measured"
        seen |= {
            "message": f"{kind}:\n{case.describe()}\n{error}",
            "traceback": getattr(error, "traceback", ""),
        }
        return law.finding(Verdict.ERROR, **_witness(law, case), **seen)
    skipped = "\n".join(f"{counted(n, 'case')} skipped: {reason}" for reason, n in log.skipped.items())
    if not log.checks:
        verdict = Verdict.NOT_APPLICABLE if skipped else Verdict.ERROR
        return law.finding(verdict, message=skipped or "no case was measured", skipped=log.refused)
    verdict = Verdict.HOLDS
    if log.share is not None and log.share < LEAST_SHARE and scheme.longest_step is not None:
        verdict = Verdict.INCONCLUSIVE
        few = f"only {100 * log.share:.0f} % of the cases were measured"
        skipped = f"{few}: a law holds on {100 * LEAST_SHARE:.0f} % at least\n{skipped}"
    return law.finding(verdict, message=skipped, skipped=log.refused, share=log.share, **seen)


def _witness(law: Law, case: Case) -> dict[str, Any]:
    replay = f"--law {law.name} --replay {cases_of.to_token(case)}"
    return {"witness": cases_of.to_json(case), "replay": replay}
