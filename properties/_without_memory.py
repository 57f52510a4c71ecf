"""Checks that a step has no memory: the same arguments give the same state,
however often and in whichever order.

The law *contract* makes these checks, which need several calls. A failed check raises SchemeFault
with both results.
"""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from sepv.properties._surroundings import watched

from sepv.errors import NotFinite, SchemeFault, SepvError, StepFailure
from sepv.law import Case
from sepv.problem import Array, Problem
from sepv.problems.shown_to_schemes import shown
from sepv.schemes import Scheme, ask, check_answer, raw_answer

# The least distance of two states to compare, relative to the result. Rounding may make results of
# closer states equal.
LEAST_DISTANCE = 2.0**-20
# The size of the short steps made around a step without a solution, as a fraction of the size of
# that step.
SHORT_OF_FOLD = 2.0**-10
# The remedy for a step that depends on earlier calls.
FORGET_REMEDY = (
    "remove what changes from call to call: a counter, random numbers, a cache, what an earlier run left"
)
# The number of calls that show if a step changes from call to call, before another cause is named.
CALLS_TO_SHOW_CHANGE = 8
# The number of states in each repeated call of a scheme that takes batches: 1024 calls make ten
# thousand steps.
REPEATED_LANES = 10
# The search for a new object at its predecessor's address ends after MAX_ELSEWHERE objects
# elsewhere, or MAX_FRESH objects.
MAX_ELSEWHERE, MAX_FRESH = 16, 64
# The most seconds for repeating a step. So a step of more than 30 ms is repeated less often.
REPEAT_MAX_SECONDS = 30.0


def repeats(scheme: Scheme, case: Case) -> None:
    """Repeat the step of a case `case.times` times, and raise SchemeFault if the results differ in
    any bit.
    """
    problem, y, h, dW = case.build()
    if scheme.batched:
        y, dW = (np.repeat(a[:, None], REPEATED_LANES, axis=1) for a in (y, dW))
    first, end = ask(scheme, problem, y, h, dW), time.monotonic() + REPEAT_MAX_SECONDS
    for n in range(2, case.times + 1):
        try:
            answer: Array | str = ask(scheme, problem, y, h, dW)
        except StepFailure as error:
            answer = str(error)
        if isinstance(answer, str) or not np.array_equal(first, answer):
            raise SchemeFault(
                expected="one answer for one question, however often it is asked",
                received=f"{first.tolist()}, and then, asked for the {n}th time, "
                f"{answer if isinstance(answer, str) else answer.tolist()}",
                remedy=FORGET_REMEDY,
            )
        if time.monotonic() > end:
            break


def refuses_again(scheme: Scheme, case: Case) -> None:
    """Try a step without a solution twice, with a short step from the same y before,
    in between and at the end.

    Raise SchemeFault if the two tries or the three short steps have different results, or change
    global state.
    """
    problem, y, h, dW = case.build()

    def outcome(share: float) -> Array | None:
        try:
            with watched(scheme) as seen:
                return ask(seen, problem, y, share * h, share * dW)
        except SepvError as error:  # an answer NaN and a skipped system count as refusals too
            if isinstance(error, SchemeFault) and not isinstance(error, NotFinite):
                raise
            return None

    seen = [outcome(share) for share in (SHORT_OF_FOLD, 1.0, SHORT_OF_FOLD, 1.0, SHORT_OF_FOLD)]
    for first, again in ((seen[0], seen[2]), (seen[1], seen[3]), (seen[0], seen[4])):
        same = first is again if first is None or again is None else np.array_equal(first, again)
        if not same:
            answers = ["a refusal" if v is None else str(v.tolist()) for v in (first, again)]
            raise SchemeFault(
                expected="one answer for one question, a refusal too, and what it leaves behind changes no other",
                received=f"{answers[0]} and then {answers[1]}",
                remedy="begin each step anew: keep no iterate, step size or flag of one that failed",
            )


def reads_again(
    scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array, share: float, before: Array
) -> None:
    """Step with arrays that held other numbers in the last call: with y,
    then with dW after `dW *= share`.

    Both results are compared with those from new arrays. Loops often overwrite arrays in place, and
    a scheme that recognises a state by `y is last` then returns old values. `before` is the state
    that y held in the last call. The second step has the length share·h, so that Δ is not longer.
    """
    whole, state = dW.copy(), y.copy()

    def answers(*, primed: bool = False) -> list[tuple[float, Array, Array]]:
        found = []
        dW[...] = whole
        if primed:  # the arrays held other numbers in the last call, as before the first answers
            y[...] = before
            with suppress(SepvError):
                raw_answer(scheme, problem, y, h, dW)
            y[...] = state
        for factor in (1.0, share):
            dW[...] *= factor
            raw = raw_answer(scheme, problem, y, factor * h, dW)
            found.append((factor * h, dW.copy(), check_answer(raw, y, scheme.dtype).copy()))
        return found

    for n, (step, noise, answer) in enumerate(answers()):
        anew = ask(scheme, problem, y, step, noise)
        if not np.array_equal(answer, anew):
            remembers_calls(scheme, problem, y.copy(), step, noise, anew)
            if not np.array_equal(
                answers(primed=True)[n][2], answer
            ):  # another call has another answer, in the same arrays too
                raise _memory(answer, anew)
            raise SchemeFault(
                expected="one answer for one question, whichever arrays hold y and dW",
                received=f"{answer.tolist()} from arrays that held other numbers before, {anew.tolist()} from others",
                remedy="recognise arguments by their numbers, not as objects (y is last, id(y)), or remember nothing",
            )


def remembers_calls(scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array, answer: Array) -> None:
    """Raise SchemeFault if the step with the result `answer` has another in the next
    CALLS_TO_SHOW_CHANGE calls.

    So a counter, or anything else that changes from call to call, is not taken for a fault of
    arrays or records.
    """
    for _ in range(CALLS_TO_SHOW_CHANGE):
        other = ask(scheme, problem, y, h, dW)
        if not np.array_equal(other, answer):
            raise _memory(answer, other)


def _memory(first: Array, other: Array) -> SchemeFault:
    return SchemeFault(
        expected="one answer for one question: the same bits for the same arguments",
        received=f"{first.tolist()} and then {other.tolist()}, in other calls",
        remedy=FORGET_REMEDY,
    )


def tells_apart(y: Array, other: Array, answer: Array, to_other: Array, least: float) -> None:
    """Raise SchemeFault if `answer` and `to_other`, the results of steps from y and from `other`,
    are equal.

    Two such steps reveal a cache with the key (h, dW); repetition of one step does not. If the
    step's equation is a contraction with factor κ, two results differ by at least (1 − κ)/(1 + κ)
    of the distance between y and `other`. Distances of at most `least` times the size of the result
    are not judged, because rounding may hide them.
    """
    apart = np.max(np.abs(other - y), axis=0)
    lane = np.all(answer == to_other, axis=0) & (apart > least * np.max(np.abs(answer), axis=0))
    if np.any(lane):
        raise SchemeFault(
            expected="another answer for another state",
            received=f"{answer.tolist()} from y = {y.tolist()} and from y = {other.tolist()}",
            remedy="what is remembered of a step must be remembered by y too, with all its bits",
        )


def forgets_problems(scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array, first: Array) -> None:
    """Step an equal problem in a new object, whose address belonged to a problem with half the
    noise or half of H.

    Python mostly reuses a freed object's memory for the next object of the same size. A scheme that
    caches results by `id`, or by `id` and Δ, then returns the wrong problem's result. If the
    address differs, other addresses are tried.
    """
    if np.array_equal(first, y):  # a step that moves nothing is the same with half the noise
        return
    whole, missed = shown(problem, scheme.needs), 0
    # The first problem has half the noise, the last one the whole noise and half of H: a noise that
    # was cached at their address is still halved. If the scheme sees the degree of H, it may have
    # cached this degree or its nodes.
    parts = [partial(_quadratic, whole, y)] if whole.degree is not None else [
        *[partial(_as_others, whole, 0.5)] * bool(problem.noises), partial(_as_others, whole, 1.0, 0.5)
    ]  # fmt: skip
    elsewhere: list[Problem] = []
    while missed < MAX_ELSEWHERE and len(elsewhere) < MAX_FRESH:
        addresses, blind = set[int](), False
        for make in parts:
            other = make()
            addresses.add(id(other))
            # A cache may have the whole problem's result at this address and return it: then no
            # comparison is possible.
            with suppress(StepFailure):
                blind = np.array_equal(first, ask(scheme, other, y, h, dW)) or blind
            del other
        twin = _as_others(whole)
        answer = ask(scheme, twin, y, h, dW)
        if not np.array_equal(first, answer):
            remembers_calls(scheme, problem, y, h, dW, first)
            if np.array_equal(first, ask(scheme, twin, y, h, dW)):
                raise _memory(first, answer)
            raise SchemeFault(
                expected="one answer for one question, whichever record holds the problem",
                received=f"{answer.tolist()} from an equal record, {first.tolist()} before",
                remedy="remember nothing of a problem by its id or name: another may have it later",
            )
        if {id(twin)} == addresses and not blind:
            return
        missed += {id(twin)} != addresses
        elsewhere.append(twin)


def _as_others(problem: Problem, of_noise: float = 1.0, of_energy: float = 1.0) -> Problem:
    """Return the problem with its c_j multiplied by `of_noise`, and H and ∇H (as new functions)
    by `of_energy`.
    """

    def times(function: Any) -> Any:
        return function and (lambda *states: of_energy * function(*states))

    return replace(
        problem,
        noise=of_noise * problem.c,
        hamiltonian=times(problem.hamiltonian),
        gradient=times(problem.gradient),
        hessian=times(problem.hessian),
        mean_gradient=times(problem.mean_gradient),
        check=False,
    )


def _quadratic(problem: Problem, y: Array) -> Problem:
    """Return the problem with H = ½ s|y|² and degree 2,
    where s is chosen so that |∇H(y)| stays the same.
    """
    d, s = len(y), float(np.linalg.norm(problem.gradient(y)) / np.linalg.norm(y))
    return replace(
        problem,
        hamiltonian=lambda y: 0.5 * s * (y * y).sum(axis=0),
        gradient=lambda y: s * y,
        hessian=lambda y: s * np.eye(d).reshape(d, d, *(1,) * (y.ndim - 1)) + np.zeros_like(y),
        mean_gradient=problem.mean_gradient and (lambda y0, y1: 0.5 * s * (y0 + y1)),
        degree=2,
        check=False,
    )


def again(scheme: Scheme, case: Case, before: Array | None) -> None:
    """Repeat the step of a case after the steps of all other cases,
    and compare its result with the first, `before`.
    """
    if before is not None and not np.array_equal(before, answer := ask(scheme, *case.build())):
        raise SchemeFault(
            expected="one answer for one question, in whichever order questions come",
            received=f"{before.tolist()}, and {answer.tolist()} after others",
            remedy=FORGET_REMEDY,
        )
