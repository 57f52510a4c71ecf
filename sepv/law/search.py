"""The search for a violation of a law about single steps,
first in listed cases and then in random cases.

Stored cases that once showed a violation come first (`sepv.law.corpus`). Then comes the design: for
any two properties, such as d and the degree of H, its cases cover all pairs of ranges
(`sepv.law.cases.strata`). If none of them violates the law, Hypothesis draws random cases.
Whatever case violates the law is simplified in one way (`sepv.law.cases.shrink`).
"""

from __future__ import annotations

import math
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from random import Random
from typing import Any

from hypothesis import HealthCheck, Phase, Verbosity, given, reject, settings, target
from hypothesis import seed as hypothesis_seed
from hypothesis.errors import Unsatisfiable

from sepv._kept import kept
from sepv._patches import without_local_constants
from sepv.children import note_case, note_violation
from sepv.errors import NotFinite, SchemeFault, SepvError, Skipped, StepFailure, Unasked, UsageError
from sepv.law import corpus
from sepv.law._law import Effort, Finding, Law, Measurement, Middle, Run, Verdict, in_units, laws_in
from sepv.law.cases import case as cases_of
from sepv.law.cases.case import Case
from sepv.law.cases.clipped import clips
from sepv.law.cases.ends import beyond, is_long
from sepv.law.cases.fixed_cases import may_be_refused
from sepv.law.cases.from_problem import describe, start_of
from sepv.law.cases.of_law import ALL_CASES, Cases, Question
from sepv.law.cases.shrink import shrunk, size
from sepv.law.cases.users_problems import objects_of, sources
from sepv.law.middle import along_paths, anywhere
from sepv.law.search_log import Check, SearchLog, conclude
from sepv.schemes import Scheme, has_memory, takes

# Reasons why a state or a step of extreme size is left out.
EXTREME_STATE = "a step from a state larger or smaller than 2^±21"
LONG_STEP = "a step longer than 8"
FAR_OFF = (
    f"{EXTREME_STATE} was not asked of a solver with a tolerance, or of an integrator without noise: "
    "thresholds may be absolute"
)
NO_BOUND = "a case whose numbers overflow has no bound"
# The factor on the number of random examples for a law without a design.
EXAMPLES_WITHOUT_DESIGN = 12
# A search ends after this many refused cases for each accepted one.
MOST_SKIPPED = 20
# The most seconds for simplification: a law may be stopped after ten minutes, and must report its
# violation before. The limit is reached only if a measurement takes longer than 0.2 s. The
# counterexample then depends on time.
SIMPLIFY_MAX_SECONDS = 100.0
# The largest number of designs that are stored between runs, twice what a run of all laws needs.
STORED_DESIGNS = 64
# The list of cases ends early after this many cases that cannot be measured: each may last until a
# call's time limit.
MOST_FAULTS = 4

Premise = Callable[[Scheme, Case], None]


class _Violation(BaseException):
    """Raised inside a search: the case violates the law.

    No Exception, so that Hypothesis lets it pass, and ends.
    """


class _Simplify(Exception):
    """Raised for Hypothesis, so that it looks for a simpler case of a user's strategy that does
    the same.
    """


class _Fault(BaseException):
    """Raised inside a search: the case could not be measured. Hypothesis lets it pass too."""


@dataclass(frozen=True)
class _Question:
    """A law applied to one scheme: the source of its cases, and the measurement of one case."""

    where: Question
    check: Check
    faults_violate: bool
    known: tuple[Case, ...]  # witnesses of the corpus, which are tried first
    premise: Check | None = None
    key: str = ""  # the name under which designs are stored between runs, if the law is the suite's own


def searched(
    *,
    name: str,
    statement: str,
    source: str,
    unit: str,
    check: Check,
    cases: Cases = ALL_CASES,
    faults_violate: bool = False,
    always_claimed: bool = False,
    not_applicable: Callable[[Scheme], str] = lambda _: "",
    middle: Middle | str = Middle.STEPS,
    premise: Premise | None = None,
    cost: float = 1.0,
    steps: int = 0,
    preserves: bool = False,
) -> Law:
    """Make a law about single steps. It is measured case by case,
    first on listed cases and then on random ones.

    Parameters
    ----------
    check : (scheme, case) -> Measurement
        The measurement of one case. It may raise the errors of `sepv.schemes.ask`.
    cases : Cases
        The cases of the law, for schemes of every class and for users' problems.
    faults_violate : bool
        True for the law "contract": a result of a wrong shape or type violates it. For other laws
        it is an error.
    not_applicable : scheme -> str
        The reason why the law does not apply to this scheme; empty if it does.
    middle : Middle or str
        How the law is measured in the middle of a path of a scheme with memory, or why it is about
        first steps only.
    premise : (scheme, case) -> None
        Raises Unasked at a case which shows that the law says nothing of the scheme, wherever else
        it is measured. All listed cases are asked before the first is measured.
    cost, steps, preserves
        As for `sepv.verification.Law`.
    """
    own_check, check = check, anywhere(middle, check)
    asked_first = None if premise is None else anywhere(middle, partial(_of_premise, premise))

    def run(law: Law, scheme: Scheme, this_run: Run) -> Finding:
        listed = sources(scheme)
        own_cases = cases.without_noise() if scheme.deterministic else cases
        if why := not_applicable(scheme) or (own_cases if isinstance(own_cases, str) else ""):
            return law.finding(Verdict.NOT_APPLICABLE, message=why)
        assert isinstance(own_cases, Cases)
        own_cases = own_cases if scheme.dtype == "float64" else own_cases.in_single_precision()
        kind = f"{scheme.systems} {scheme.deterministic} {scheme.dtype}"

        def asked(admitted: Cases) -> Question | str:
            return admitted.of_problems(listed) if listed else admitted.of_class(scheme.systems)

        space = asked(own_cases)
        if isinstance(space, str):
            return law.finding(Verdict.NOT_APPLICABLE, message=space)
        starts = [start_of(describe(item.fixed, item.text)) for item in listed if item.fixed is not None]
        module = sys.modules.get(getattr(own_check, "__module__", ""))
        own = law in laws_in(module) and own_check.__module__.startswith("sepv.")
        of_class, plain = space, f"{name} {kind} False" if own else ""

        def probes() -> Iterator[Case]:
            yield from starts if listed else _design(of_class, plain, this_run.effort.seed)

        if scheme.truncation is not None and clips(scheme, probes()):
            # Other increments never come: the law "truncation" tests that the step uses those up to
            # √h A_h.
            own_cases, kind = own_cases.within_clip(scheme.truncation), f"{kind} within {scheme.truncation}"
            space = asked(own_cases)
            if isinstance(space, str):
                return law.finding(Verdict.NOT_APPLICABLE, message=space)
        known = () if listed else tuple(own_cases.all_adapted(corpus.cases(name, scheme.systems)))
        carries = has_memory(scheme) and isinstance(middle, Middle)
        if carries:
            space = along_paths(space)
        key = f"{name} {kind} {carries}" if own and not listed else ""
        question = _Question(space, check, faults_violate, known, asked_first, key)
        return in_units(scheme, _search(law, scheme, this_run.effort, question))

    def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
        log, case = SearchLog(), cases_of.from_json(witness, objects_of(scheme))
        if not cases.admits(case):
            raise UsageError(
                expected=f"a witness of the law {name}, which says: {statement}",
                received="a case of which it says nothing",
                remedy="copy the whole command from the report: a token belongs to its law",
            )
        if why := _refuted(scheme, [case], asked_first):
            return law.finding(Verdict.NOT_APPLICABLE, message=why)
        with suppress(_Violation, _Fault, Skipped):
            _measure(log, scheme, case, check, faults_violate)
        return in_units(scheme, conclude(law, scheme, log, check))

    return Law(
        name, statement, source, unit, run, replay, always_claimed, cost, steps, cases, middle=middle,
        preserves=preserves, measure=check,
    )  # fmt: skip


def _search(law: Law, scheme: Scheme, effort: Effort, question: _Question) -> Finding:
    log, start = SearchLog(), time.perf_counter()
    known = question.known if effort.corpus else ()
    fixed = question.where.fixed
    first = _designed(question, effort.seed, 0)
    further = (_designed(question, effort.seed, n) for n in range(1, effort.designs))
    if why := _refuted(scheme, chain(known, first, fixed), question.premise):
        return law.finding(Verdict.NOT_APPLICABLE, message=why, seconds=time.perf_counter() - start)
    listed = iter((*known, *first))
    _visit(log, scheme, chain(listed, chain.from_iterable(further), fixed), question)
    if log.lacking and log.checks:
        log.share = log.checks / (log.checks + log.lacking)
    if log.violation is None:
        _explore(log, scheme, effort, question, effort.examples * (1 if first else EXAMPLES_WITHOUT_DESIGN))
    if log.failed:
        _simplify(log, scheme, effort, question, listed)
    return replace(conclude(law, scheme, log, question.check), seconds=time.perf_counter() - start)


def _of_premise(premise: Premise, scheme: Scheme, case: Case) -> Measurement:
    premise(scheme, case)
    return Measurement(0.0, 0.0)


def _refuted(scheme: Scheme, cases: Iterable[Case], premise: Check | None) -> str:
    """The reason of the first case which shows that the law says nothing of the scheme;
    empty if there is none.
    """
    if premise is None or not has_memory(scheme):
        return ""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for case in cases:
            note_case(lambda case=case: cases_of.to_json(case))  # type: ignore[misc]
            try:
                _measured(scheme, case, premise)
            except Unasked as unasked:
                return unasked.reason
            except (SepvError, ArithmeticError):
                continue  # the law itself tells what became of the case
    return ""


def _design(where: Question, key: str, number: int) -> list[Case]:
    """The cases of a design; under a key they are stored between runs."""
    if not key:
        return where.design(number)
    return list(kept("designs", STORED_DESIGNS).get(f"{key} {number}", lambda: where.design(number)))


def _designed(question: _Question, seed: int, repeat: int) -> list[Case]:
    """The cases of a law's design for a seed, in random order,
    so that no range of a property always comes first.
    """
    drawn = _design(question.where, question.key, seed + 1000003 * repeat)
    Random(seed).shuffle(drawn)
    return drawn


def _explore(log: SearchLog, scheme: Scheme, effort: Effort, question: _Question, examples: int) -> None:
    """Measure random cases, chosen by Hypothesis to make defect/bound large,
    up to the first case that cannot be measured. Of several violations the smallest case is kept.
    """
    measured_before, violations = log.checks, list[Any]()
    shrinks = question.where.of_strategy and effort.shrink_checks > 0
    left, end = effort.shrink_checks, math.inf

    def body(case: Case) -> None:
        nonlocal left, end
        # Hypothesis ends its search if every further case passes. So every case passes after too
        # many refused cases, and when nothing is left for simplifying.
        if log.refused > MOST_SKIPPED * (1 + log.checks - measured_before):
            return
        left -= bool(violations)
        if shrinks and (left < 0 or time.perf_counter() > end):
            return
        try:
            measured = _measure(log, scheme, case, question.check, question.faults_violate)
        except Skipped as skipped:
            if not isinstance(skipped.__cause__, StepFailure):
                reject()  # Hypothesis then draws another example; a refused step counts as an example
            return
        except _Violation:
            violations.append(log.violation)
            end = min(end, time.perf_counter() + SIMPLIFY_MAX_SECONDS)
            if shrinks:
                raise _Simplify from None
            if not effort.shrink_checks:
                raise
            return
        if 0 < measured.ratio < float("inf"):
            target(measured.ratio, label="defect / bound")

    chosen = settings(
        max_examples=examples,
        database=None,
        deadline=None,
        derandomize=False,
        print_blob=False,
        verbosity=Verbosity.quiet,
        # `_simplify` simplifies every other violation.
        phases=(Phase.generate, Phase.target, *((Phase.shrink,) if shrinks else ())),
        # Hypothesis would complain of large and of slow examples. Cases are large, and a slow
        # scheme makes them slow.
        suppress_health_check=list(HealthCheck),
    )
    test = hypothesis_seed(effort.seed)(chosen(given(case=question.where.strategy)(body)))
    try:
        with warnings.catch_warnings(), without_local_constants(), suppress(_Violation, _Fault):
            warnings.simplefilter("ignore")  # the scheme's own warnings are not findings
            test()
    except Unsatisfiable:
        if not log.skipped:
            raise
    except Exception:  # `_Simplify`, or Hypothesis' own word that a case passes now, as nothing is left
        if not (shrinks and violations):
            raise
    log.violation = min(violations, key=lambda found: size(found[0]), default=log.violation)


def _visit(log: SearchLog, scheme: Scheme, visited: Iterable[Case], question: _Question) -> None:
    """Measure `visited` cases in turn, up to the first violation or the MOST_FAULTS-th case that
    cannot be measured.
    """
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


def _simplify(
    log: SearchLog, scheme: Scheme, effort: Effort, question: _Question, others: Iterable[Case] = ()
) -> None:
    """Replace the logged case by the simplest one found that also violates the law,
    or also cannot be measured; `others` are cases of the law that were not measured.
    """
    case, _ = log.violation or log.fault or (None, None)
    assert case is not None
    checks, end = log.checks, time.perf_counter() + SIMPLIFY_MAX_SECONDS
    left, best = effort.shrink_checks, (log.violation, log.fault, log.worst)

    def fails(candidate: Case) -> bool | None:
        nonlocal left, best
        left -= 1
        if left < 0 or time.perf_counter() > end:
            return None
        trial = SearchLog()
        with warnings.catch_warnings(), suppress(_Violation, _Fault, Skipped):
            warnings.simplefilter("ignore")
            _measure(trial, scheme, candidate, question.check, question.faults_violate)
        log.checks += trial.checks
        # A violation must not turn into a fault of measurement, nor the other way round.
        same = (trial.violation is None) == (log.violation is None) and trial.failed
        if same:
            best = trial.violation, trial.fault, trial.worst or log.worst
        return same

    shrunk(case, fails, question.where.admits, others)
    log.violation, log.fault, log.worst = best
    log.checks = max(checks, log.checks)


def _measured(scheme: Scheme, case: Case, check: Check) -> Measurement:
    """Measure one case, or raise Skipped if the law does not judge it."""
    if scheme.longest_step is not None and not takes(scheme, *case.build()):
        raise Skipped("a longer step than the scheme says it takes (longest_step)")
    # A library may have thresholds with units: ASE computes no new force if atoms move by less than
    # 1e-15 Å.
    if (scheme.solver_tolerance or scheme.deterministic) and beyond(case):
        raise Skipped(FAR_OFF)
    measured = check(scheme, case)
    if math.isnan(measured.bound) and (beyond(case) or math.isfinite(measured.defect)):
        raise Skipped(NO_BOUND)
    if math.isnan(measured.defect) or math.isnan(measured.bound):
        # The scheme's own y1 overflows the measurement.
        measured = replace(measured, defect=math.inf, bound=0.0)
    return measured


def _measure(log: SearchLog, scheme: Scheme, case: Case, check: Check, faults_violate: bool) -> Measurement:
    """Measure and log one case, or raise _Violation or _Fault."""
    log.checks += 1
    note_case(lambda: cases_of.to_json(case))
    try:
        measured = _measured(scheme, case, check)
    except Skipped as skipped:
        if case.given != "data":
            # If the scheme refuses a problem given as functions, it gets the same system as data:
            # no case is lost.
            log.checks -= 1
            return _measure(log, scheme, replace(case, given="data"), check, faults_violate)
        unasked = isinstance(skipped, Unasked)
        log.unasked += unasked
        known = unasked or skipped.reason in (FAR_OFF, NO_BOUND)
        log.skip(skipped.reason, may=known or may_be_refused(case))
        raise
    except (SepvError, ArithmeticError) as error:
        if isinstance(error, StepFailure) and may_be_refused(case):
            reason = "a longer step than every scheme must take was refused"
            log.skip(reason, may=True)
            raise Skipped(reason) from error
        extreme = EXTREME_STATE if beyond(case) else LONG_STEP if is_long(case) else ""
        impure = faults_violate and isinstance(error, SchemeFault) and not isinstance(error, NotFinite)
        if (case.h <= 0 and not impure) or (extreme and isinstance(error, StepFailure)):
            # No path has h ≤ 0. If a scheme fails for h ≤ 0, or refuses a state or step of extreme
            # size, the case is skipped, and the law is not violated. All errors of one kind have
            # one line, with the first message.
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
        # A crash or an exception leaves no result. A refusal, or a result of a wrong kind, counts
        # as a result.
        if not isinstance(error, (SchemeFault, ArithmeticError)):
            log.crash = case, error
        raise _Fault from error
    if log.worst is None or not measured.ratio <= log.worst.ratio:
        log.worst = measured
    if measured.violates:
        log.violation, log.largest = (case, measured), max(measured.defect, log.largest)  # a NaN remains
        log.found = log.found or log.violation
        note_violation(lambda: cases_of.to_json(case))
        raise _Violation
    return measured
