"""The contract of ``step``: it is pure and deterministic, keeps shape and dtype,
and changes nothing in place.

Each case is stepped a few times, also from arrays with another memory layout. If a scheme carries a
state from step to step, two paths are computed alternately. At the end all cases are stepped in the
opposite order, steps without a solution are tried twice, and the simplest case is stepped
LAST_CASE_CALLS times in a row. Other laws do not find an error that occurs every thousandth call:
it changes sampled paths too little, and laws about single steps make some hundred calls.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from random import Random
from typing import Any

import numpy as np
from sepv.properties._problems_of import may_ask, taken_by
from sepv.properties._states_of_a_path import keeps_states
from sepv.properties._surroundings import watched
from sepv.properties._without_memory import (
    FORGET_REMEDY,
    LEAST_DISTANCE,
    again,
    forgets_problems,
    reads_again,
    refuses_again,
    remembers_calls,
    repeats,
    tells_apart,
)
from sepv.properties._without_solution import CLASSES_WITH_FOLDS, made, proof

from sepv.errors import NotFinite, SchemeFault, SepvError, StepFailure
from sepv.law import Case, Effort, Finding, Law, Measurement, Middle, Run, Verdict, require, searched
from sepv.law.cases.case import has_words, to_json, to_token
from sepv.law.fresh import SecondProcess, step_in_digits
from sepv.law.search_log import Check
from sepv.problem import Array, PolynomialSystem, Problem
from sepv.schemes import Scheme, SchemeCrash, ask, check_answer, raw_answer, require_unchanged, takes

# The number of states in a batch. It is small, because the law "reproducibility" has larger
# batches.
CONTRACT_BATCH = 3
# ORDER_ROUNDINGS is the number of roundings by which sums in different orders may differ, before a
# solver amplifies them. A difference of LAYOUT_SHARE times the result is always allowed: far above
# roundings of binary64, far below those of binary32.
ORDER_ROUNDINGS, LAYOUT_SHARE = 64, 2.0**-30
# Caches with rounded keys, and single precision, do not distinguish NEARBY_FACTOR·y from y. Steps
# from both must have different results if the states are farther apart than RESULTS_LEAST_APART
# (256 roundings) times the size of the result.
NEARBY_FACTOR, RESULTS_LEAST_APART = 1 + 2.0**-40, 2.0**-44
# If H has degree HIGH_DEGREE or more and d ≤ SMALL_DIMENSION, an address first has a problem of
# degree 2, to reveal cached nodes.
HIGH_DEGREE, SMALL_DIMENSION = 3, 3
# The number of steps without a solution that are tried, each twice.
STEPS_WITHOUT_SOLUTION = 2
# The number of calls of the last case, a quarter of a second for (2.1). They find every fault with
# a shorter period. If a step takes 200 µs, the sampled laws make a hundred times as many calls.
LAST_CASE_CALLS = 1024
# The step of the last case, shortened by SHORTENED_STEP to save iterations, is timed for
# TIMED_SECONDS seconds or TIMED_CALLS calls. If a scheme takes batches, the time is that for one of
# TIMED_STATES states.
SHORTENED_STEP, TIMED_SECONDS, TIMED_CALLS, TIMED_STATES = 0.125, 0.0625, 16, 256
# The number of cases whose steps are compared with those of a second process.
SECOND_PROCESS_CASES = 16


def check(scheme: Scheme, case: Case) -> Measurement:
    """Check steps from one state and, if the scheme takes batches, from a small batch,
    where other faults show.
    """
    _checked(scheme, case)
    return Measurement(0.0, 0.0)


def _checked(scheme: Scheme, case: Case) -> Array | None:
    """Check a case, and return the y1 of its step; None for a case of repeated steps,
    or of one without a solution.
    """
    if case.times:
        repeats(scheme, case)
        return None
    if proof(case) is not None:
        refuses_again(scheme, case)
        return None
    problem, y, h, dW = _as_seen(scheme, case)
    first = _keeps(scheme, problem, y, h, dW, (0.75, 0.5) if case.given == "data" else (0.75,))
    keeps_states(scheme, problem, y, h / 8, dW / 8, LEAST_DISTANCE)
    # To save time, only cases with functions are checked so, and if H has a degree, only high
    # degrees.
    high = (
        case.given == "functions"
        and (problem.degree or 0) >= HIGH_DEGREE
        and len(y) <= SMALL_DIMENSION
        and h > 0
        and np.any(y)
    )
    if (np.any(problem.c * dW) or not problem.noises) and (case.given == "bare functions" or high):
        forgets_problems(scheme, problem, y, h, dW, first)
    if scheme.batched:
        # States of the batch are nearer to 0 than y, with less noise, so that their steps have
        # solutions too.
        factors = scheme.numbers(1 - np.arange(CONTRACT_BATCH) / 128)
        states = y[:, None] * factors
        if not may_ask(scheme, problem, states):
            states = np.repeat(y[:, None], CONTRACT_BATCH, axis=1)
        noise = dW[:, None] * factors
        _keeps(scheme, problem, states, h, noise, (0.75,))
        keeps_states(scheme, problem, states, h / 8, noise / 8, LEAST_DISTANCE)
    return first


def _as_seen(scheme: Scheme, case: Case) -> tuple[Problem, Array, float, Array]:
    problem, y, h, dW = case.build()
    return problem, scheme.numbers(y), h, scheme.numbers(dW)


def _keeps(
    scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array, between: Sequence[float]
) -> Array:
    """Repeat a step, each time after a step from another multiple of y (factors `between`),
    and return its result.

    Raise SchemeFault if the step changes an argument or global state, or if a repetition differs in
    any bit.
    """
    copied, noise = y.copy(), dW.copy()
    with watched(scheme) as seen:
        raw = raw_answer(seen, problem, copied, h, noise)
    require_unchanged(y=(y, copied), dW=(dW, noise))
    answer = check_answer(raw, y, scheme.dtype)
    first = answer.copy()
    # In the steps in between, zero components are changed, to reveal a step that starts from its
    # last result.
    moved = np.where(y == 0, np.max(np.abs(y)) / 64, y)
    if may_ask(scheme, problem, between[0] * moved) and not np.shares_memory(answer, copied):
        copied[...] = between[0] * moved
        reads_again(scheme, problem, copied, h, noise, between[0], y)
    _takes_any_layout(scheme, problem, y, h, dW, first)
    if max(scheme.solver_tolerance, scheme.eps) <= RESULTS_LEAST_APART and may_ask(
        scheme, problem, NEARBY_FACTOR * y
    ):
        tells_apart(
            y, NEARBY_FACTOR * y, first, ask(scheme, problem, NEARBY_FACTOR * y, h, dW), RESULTS_LEAST_APART
        )
    for factor in between:
        if may_ask(scheme, problem, factor * moved):
            tells_apart(y, factor * moved, first, ask(scheme, problem, factor * moved, h, dW), LEAST_DISTANCE)
        else:
            ask(scheme, problem, y, factor * h, factor * dW)
        if not np.array_equal(answer, first):
            raise SchemeFault(
                expected="an answer that stays as it is",
                received=f"{answer.tolist()} after the next call, {first.tolist()} before",
                remedy="return a new array each time, not a buffer that is used again",
            )
        second = ask(scheme, problem, y, h, dW)
        if not np.array_equal(first, second):
            raise SchemeFault(
                expected="one answer for one question: the same bits for the same arguments",
                received=f"{first.tolist()} and then {second.tolist()}",
                remedy=f"{FORGET_REMEDY}; the noise comes in dW",
            )
    return first


def _takes_any_layout(scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array, first: Array) -> None:
    """Repeat a step with the same numbers in read-only arrays,
    as strided views and in Fortran's order.

    Sums may be made in another order with these arrays, so results may differ by LAYOUT_SHARE times
    their size. A step that accepts none of the arrays, such as a compiled step, is not judged.

    Raises
    ------
    SchemeFault
        If results differ by more, or the step attempts to write into an argument.
    """
    for order in (_spread, np.asfortranarray):
        state, noise = order(y).view(), order(dW).view()
        state.flags.writeable = noise.flags.writeable = False
        try:
            answer = check_answer(raw_answer(scheme, problem, state, h, noise), y, scheme.dtype)
        except SchemeCrash as crash:
            if "read-only" in str(crash) and ("destination" in str(crash) or "output" in str(crash)):
                raise SchemeFault(
                    expected="y and dW unchanged by the step, at any time",
                    received=f"an attempt to write into one of them: {str(crash).splitlines()[0]}",
                    remedy="work on copies",
                ) from crash
            continue
        except StepFailure:
            continue
        share = max(LAYOUT_SHARE, ORDER_ROUNDINGS * max(scheme.eps, scheme.solver_tolerance))
        if np.any(np.abs(answer - first) > share * np.max(np.abs(first))):
            remembers_calls(scheme, problem, y, h, dW, first)
            raise SchemeFault(
                expected="one answer for the same numbers, however they lie in memory",
                received=f"{answer.tolist()} for y of strides {state.strides}, {first.tolist()} before",
                remedy="np.ascontiguousarray(y) before its memory is handed on",
            )


def _spread(a: Array) -> Array:
    """Return a strided view with the numbers of `a`, which skips every other place of its
    memory.
    """
    spread: Array = np.repeat(a, 2, axis=-1)[..., ::2]
    return spread


def _searched(check: Check) -> Law:
    return searched(
        name="contract",
        statement="the step is a pure, deterministic function that keeps shape and dtype",
        source="contract",
        unit="faults",
        cost=1.8,
        steps=1520,
        middle=Middle.MAP,
        check=check,
        faults_violate=True,
        always_claimed=True,
    )


def _simplest(scheme: Scheme, cases: Sequence[Case]) -> Case:
    """Choose the case to repeat often: with noise and h > 0, if possible,
    a fast system and a short description.
    """
    ordered = sorted(
        cases, key=lambda c: (c.h < 0, isinstance(c.problem, PolynomialSystem), len(c.describe()))
    )
    return next((case for case in ordered if _moves(scheme, case)), ordered[0])


def _moves(scheme: Scheme, case: Case) -> bool:
    problem, y, h, dW = case.build()
    noisy = bool(np.any(problem.c * dW)) or not problem.noises
    return noisy and not np.array_equal(ask(scheme, problem, y, h, dW), y)


def keeps_type(scheme: Scheme, case: Case) -> None:
    """Raise SchemeFault if a step returns another shape or dtype than that of y.
    A step that fails is not judged.

    At y = 0 many systems rest, and a shortcut for rest points may return other numbers, such as
    integers.
    """
    problem, y, h, dW = case.build()
    try:
        if may_ask(scheme, problem, y):
            ask(scheme, problem, y, h, dW)
    except SepvError as error:
        if isinstance(error, SchemeFault) and not isinstance(error, NotFinite):
            raise


def _step_seconds(scheme: Scheme, case: Case) -> float | None:
    """Measure the seconds for one state in a short step,
    in a batch of TIMED_STATES if the scheme takes batches.

    Return None if the scheme refuses the step.
    """
    problem, y, h, dW = case.build()
    h, dW = SHORTENED_STEP * h, SHORTENED_STEP * dW
    if scheme.batched:
        y, dW = (np.repeat(a[:, None], TIMED_STATES, axis=1) for a in (y, dW))
    calls = 0
    with suppress(SepvError):
        ask(scheme, problem, y, h, dW)  # this call may compile
        start = time.monotonic()
        while calls < TIMED_CALLS and time.monotonic() < start + TIMED_SECONDS:
            ask(scheme, problem, y, h, dW)
            calls += 1
        return (time.monotonic() - start) / calls / (TIMED_STATES if scheme.batched else 1)
    return None


def run(law: Law, scheme: Scheme, this_run: Run) -> Finding:
    """Search for a fault. If none is found, repeat all cases in reverse order,
    and try steps without solution twice.

    Then repeat the step of the simplest case LAST_CASE_CALLS times, unless a stored counterexample
    already repeats its step. If a new process can import the scheme, compare some steps with those
    of a second process.
    """
    measured: list[tuple[Case, Array | None]] = []

    def remembered(asked: Scheme, case: Case) -> Measurement:
        answer = _checked(asked, case)
        # Not several steps of a path as one, and no step without a solution.
        if asked is scheme and (case.times or answer is not None):
            measured.append((case, answer))
        return Measurement(0.0, 0.0)

    second = SecondProcess(this_run) if this_run.target else None
    try:
        finding = _searched(remembered).run(law, scheme, this_run)
        if finding.verdict is not Verdict.HOLDS or not measured:
            return finding
        finding = _repeated(law, scheme, this_run, finding, measured)
        if finding.verdict is not Verdict.HOLDS or second is None:
            return finding
        return _elsewhere(law, scheme, finding, [case for case, _ in measured], second)
    finally:
        if second is not None:
            second.end()


def _elsewhere(
    law: Law, scheme: Scheme, finding: Finding, cases: list[Case], second: SecondProcess
) -> Finding:
    """Compare steps of some cases with those of a second process, which has another
    PYTHONHASHSEED.
    """
    chosen = [case for case in cases if not case.times and has_words(to_json(case))][:SECOND_PROCESS_CASES]
    answers = second.steps([to_json(case) for case in chosen])
    for case, there in zip(chosen, answers, strict=False):
        here = step_in_digits(scheme, case)
        if None not in (here, there) and here != there:
            fault = SchemeFault(
                expected="one answer for one question, in every process",
                received=f"{here} here, and {there} in a second process with another PYTHONHASHSEED",
                remedy="sort sets before sums; use no hash(), id() or process number, and no random numbers at import",
            )
            shown = _violated(law, finding, case, fault)
            # One process alone repeats the step, so that the whole law is measured again.
            return replace(shown, replay=f"--law {law.name}", afresh=Verdict.VIOLATED.value)
    if answers:
        return replace(finding, checks=finding.checks + len(answers))
    note = "a second process did not answer, so that no step was compared with one of another process"
    return replace(finding, message=f"{finding.message}\n{note}".strip())


def _repeated(
    law: Law, scheme: Scheme, this_run: Run, finding: Finding, measured: list[tuple[Case, Array | None]]
) -> Finding:
    """Repeat all cases in reverse order, and try steps without solution twice;
    time a step if no fault is found.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the scheme's own warnings are not findings
        simplest = _simplest(scheme, [case for case, _ in measured])
        more: list[partial[Any]] = [
            partial(again, scheme, case, answer) for case, answer in reversed(measured)
        ]
        more.append(partial(keeps_type, scheme, replace(simplest, y=(0.0,) * len(simplest.y))))
        more += [partial(check, scheme, case) for case in _refused(scheme, this_run.effort.seed)]
        if not any(case.times for case, _ in measured):
            more.append(partial(check, scheme, replace(simplest, times=LAST_CASE_CALLS)))
        for question in more:
            try:
                question()
            except SchemeFault as fault:
                return _violated(law, finding, question.args[1], fault)
        seconds = _step_seconds(scheme, simplest)
    return replace(finding, checks=finding.checks + len(more), step_seconds=seconds)


def _refused(scheme: Scheme, seed: int) -> list[Case]:
    """Make steps of (2.1) without a solution. Return [] for a scheme of given problems,
    or of a class without any.
    """
    if scheme.systems not in CLASSES_WITH_FOLDS or scheme.problems:
        return []
    cases = (made(Random(f"{seed} {n}"), scheme.systems) for n in range(STEPS_WITHOUT_SOLUTION))
    return [case for case in taken_by(scheme, cases) if takes(scheme, *case.build())]


def _violated(law: Law, finding: Finding, case: Case, fault: SchemeFault) -> Finding:
    return replace(
        finding,
        verdict=Verdict.VIOLATED,
        defect=1.0,
        message=f"{case.describe()}\n{fault}",
        witness=to_json(case),
        replay=f"--law {law.name} --replay {to_token(case)}",
        checks=finding.checks + 1,
    )


law = replace(_searched(check), run=run)


def test_contract(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
