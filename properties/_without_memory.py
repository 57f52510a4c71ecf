"""A step has no memory: one answer for one question, however often and in whichever order it is asked.

These are the questions of *contract* that take more than one call. Each raises SchemeFault with both answers.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from sepv.errors import SchemeFault, SepvError, StepFailure
from sepv.problem import Array, Problem
from sepv.problems.shown_to_schemes import shown
from sepv.schemes import Scheme, ask
from sepv.verification import Case

# The least distance of states, as a share of the result: closer ones may have one result by rounding.
APART = 2.0**-20
# The steps in between are short: this share of the step without a solution.
SHORT_OF_FOLD = 2.0**-10
# States in each repeated call of a scheme that takes batches: ten thousand steps, in less than twice the time.
LANES = 10
# The most records that are built until one has the address of its predecessor, and until one has a new address.
ADDRESSES, FRESH = 16, 64
# A step of more than 30 ms is repeated only as often as fits in this many seconds.
MOST_SECONDS = 30.0


def repeats(scheme: Scheme, case: Case) -> None:
    """Repeat one step and compare the bits.

    Raises
    ------
    SchemeFault
    """
    problem, y, h, dW = case.build()
    if scheme.batched:
        y, dW = (np.repeat(a[:, None], LANES, axis=1) for a in (y, dW))
    first, end = ask(scheme, problem, y, h, dW), time.monotonic() + MOST_SECONDS
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
                remedy="remove counters, caches and random numbers from the step",
            )
        if time.monotonic() > end:
            break


def refuses_again(scheme: Scheme, case: Case) -> None:
    """Ask for a step without a solution twice, and for a short one from there before, in between and at the end.

    Raises
    ------
    SchemeFault
    """
    problem, y, h, dW = case.build()

    def outcome(share: float) -> Array | None:
        try:
            return ask(scheme, problem, y, share * h, share * dW)
        except SepvError:  # NaN, or a skipped system, is no state either
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


def tells_apart(y: Array, other: Array, answer: Array, to_other: Array, least: float) -> None:
    """Check that two states have two results: a memory by h and dW alone passes every repetition.

    Inside the radius where the equation is a contraction with factor κ, a step leaves two states apart by at least
    (1 − κ)/(1 + κ) of their distance. Distances that the rounding of the result may hide are not judged.

    Raises
    ------
    SchemeFault
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
    """Step the same problem in a new record, at an address where one with half the noise and one with half of H were.

    Python mostly gives a freed record's memory to the next one of its size. A memory by `id`, or by `id` and Δ, then
    returns the wrong problem's result. Where the address differs, other addresses are tried.
    """
    if np.array_equal(first, y):  # at a rest point half the noise gives the same result
        return
    whole, missed = shown(problem), 0
    # The last of them has the noise of the whole, so that a memory of the noise still has half of it.
    parts = [(0.5, 1.0)] * bool(problem.noises) + [(1.0, 0.5)]
    elsewhere: list[Problem] = []
    while missed < ADDRESSES and len(elsewhere) < FRESH:
        addresses, blind = set[int](), False
        for factors in parts:
            half = _as_others(whole, *factors)
            addresses.add(id(half))
            # If the memory already held the whole, the half gets its result, and this comparison is blind.
            blind = np.array_equal(first, ask(scheme, half, y, h, dW)) or blind
            del half
        twin = _as_others(whole)
        answer = ask(scheme, twin, y, h, dW)
        if not np.array_equal(first, answer):
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
    """The problem with multiples of its noises and of H and ∇H, which are new functions."""

    def times(function: Any) -> Any:
        return function and (lambda y: of_energy * function(y))

    return replace(
        problem,
        noise=of_noise * problem.c,
        hamiltonian=times(problem.hamiltonian),
        gradient=times(problem.gradient),
        check=False,
    )


def again(scheme: Scheme, case: Case, before: Array | None) -> None:
    """Measure a case once more, after all others."""
    if before is not None and not np.array_equal(before, answer := ask(scheme, *case.build())):
        raise SchemeFault(
            expected="one answer for one question, in whichever order questions come",
            received=f"{before.tolist()}, and {answer.tolist()} after others",
            remedy="remove state, caches and random numbers from the step",
        )
