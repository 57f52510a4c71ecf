"""Advice on the cause of a violation: one term of the step, a constant with a unit,
or a solver's tolerance.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import combinations, pairwise
from typing import Any

import numpy as np

from sepv import problems
from sepv.errors import SepvError
from sepv.law._law import Law, Measurement
from sepv.law.cases.case import Case, with_noise
from sepv.law.cases.ends import beyond, in_other_units
from sepv.problem import Array, PolynomialSystem, Problem, Systems
from sepv.record import EPS
from sepv.schemes import Scheme, ask

Parts = dict[int, float]
# A function that measures another case by the violated law; it returns None if that fails.
MeasuredAgain = Callable[[Case], Measurement | None]
# Relative defects below this may come from a solver's tolerance: eight times √eps, the default of
# many solvers.
MOST_TOLERANCE = 2.0**-23

# The parts of a step are h and each c_jΔW_j. A part is named if alone it makes at least
# ALONE_MIN_SHARE of the sum of defects. A pair is named if each part alone makes at most
# PAIRED_MAX_SHARE of the pair's defect, and halving a part halves it, within HALVED_RANGE.
ALONE_MIN_SHARE, PAIRED_MAX_SHARE, HALVED_RANGE = 0.95, 1e-3, (0.45, 0.55)
# The lengths of steps, relative to a case's, that an iteration to a tolerance solves with different
# numbers of steps.
STEP_LENGTHS = (1.0, 2.0**-4, 2.0**-10, 2.0**-24)
# The largest number of parts of a step whose pairs are measured.
PAIRED_MAX_PARTS = 5


def advice(
    law: Law, scheme: Scheme, case: Case, measured: Measurement, largest: float, again: MeasuredAgain
) -> str:
    """The lines of advice on a violation; empty if no cause is clear.

    `case` is the simplified counterexample, `measured` its measurement, and `largest` the largest
    defect of the search.
    """
    if (repeated := again(case)) is not None and not repeated.violates:
        return (
            "\nthe same step, asked again, obeys the law: the scheme remembers earlier calls, as by a counter, "
            "a cache, random numbers, or what an earlier run left"
        )
    # Where the bound is 0, equal bits are asked: the defect is one of roundings, and no sum over
    # parts.
    noisy = bool(case.dW or scheme.deterministic or scheme.problems or scheme.systems is not Systems.SINGLE)
    # A counterexample without noise has one part only, so that it gets a noise here.
    parts = case if noisy else with_noise(case, (1.0,), (case.h,))
    share = _largest_share(parts, again) if law.unit.startswith("ulp") and measured.bound else ""
    if share:
        share = f"\n{share}" if noisy else f"\nif the step gets a noise too, c1 = 1: {share}"
    return share + (
        _has_a_unit(case, again) or _may_be_a_tolerance(law, scheme, case, measured, largest, again)
    )


def _may_be_a_tolerance(
    law: Law, scheme: Scheme, case: Case, measured: Measurement, largest: float, again: MeasuredAgain
) -> str:
    """Advice to state the solver's tolerance, if all defects are small and do not decrease like a
    power of Δ.
    """
    small = law.unit.startswith("ulp") and measured.bound > 0 and largest * EPS < MOST_TOLERANCE
    if not small or scheme.solver_tolerance or _is_a_power(case, measured.defect, again):
        return ""
    if is_explicit(scheme, *case.build()):
        return ""
    size = f"the defect is {measured.defect * EPS:.1e}{law.unit.removeprefix('ulp')}"
    return (
        f"\n{size}; if the step solves its equation to a tolerance, state it: Scheme(…, solver_tolerance=…)"
    )


def is_explicit(scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array) -> bool:
    """True if steps of very different lengths evaluate the problem's functions equally often,
    and at least once.

    An iteration that ends by a tolerance needs fewer evaluations for shorter steps, unless the
    equation of the step is linear, as in many simple counterexamples. So a step of the rigid body
    is counted too, if the scheme takes it. If the scheme uses none of these functions, or a step
    fails, nothing is known, and the result is False.
    """
    body = problems.rigid_body(noise=())
    here = _evaluations(scheme, problem, y, h, dW)
    there = _evaluations(scheme, body, np.array([0.8, 0.6, 0.1]), 0.25, np.zeros(0))
    return len(here) == 1 and 0 not in here and len(there) <= 1


def _evaluations(scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array) -> set[int]:
    """The different numbers of evaluations of the problem's functions in steps of very different
    lengths.
    """
    calls = [0]

    def counted(function: Any) -> Any:
        def call(*arguments: Any) -> Any:
            calls[0] += 1
            return function(*arguments)

        return call if callable(function) else function

    functions = ("structure", "hamiltonian", "gradient", "mean_gradient", "hessian", "structure_derivative")
    watched = {name: counted(getattr(problem, name)) for name in functions}
    numbers: set[int] = set()
    with warnings.catch_warnings(), suppress(SepvError, ArithmeticError, TypeError):
        warnings.simplefilter("ignore")
        seen = replace(problem, **watched, data=None, check=False)
        ask(scheme, seen, y, h, dW)  # what a scheme computes once for a problem is not counted
        for share in STEP_LENGTHS:
            calls[0] = 0
            ask(scheme, seen, y, share * h, share * dW)
            numbers.add(calls[0])
    return numbers


def _has_a_unit(case: Case, again: MeasuredAgain) -> str:
    """Advice on a constant with a unit, if a case violates the law at an extreme |y|,
    but not in units with |y| ≈ 1.
    """
    if not beyond(case) or not isinstance(case.problem, PolynomialSystem):
        return ""
    measured = again(in_other_units(case, -round(math.log2(max(map(abs, case.y))))))
    if measured is None or measured.violates:
        return ""
    return (
        "\nin units in which |y| is near 1 the same step obeys the law: a number of the scheme has a unit, as a "
        "threshold or an absolute tolerance has; if it is its solver's, state it, Scheme(…, solver_tolerance=…), and "
        "no such state is asked"
    )


def _is_a_power(case: Case, defect: float, again: MeasuredAgain) -> bool:
    """True if the defects at Δ, Δ/2 and Δ/4 fall like c Δ^p with p ≥ 2,
    as the defects of a method of some order do.

    Both slopes log₂(defect(Δ)/defect(Δ/2)) are then near p; the limits 1.5 and 1 allow for the next
    term in Δ. An iteration that stops at a tolerance stops after fewer iterations for a shorter
    step, so its slopes differ.
    """
    defects = [defect]
    for share in (0.5, 0.25):
        shorter = replace(case, h=share * case.h, dW=tuple(share * w for w in case.dW))
        measured = again(shorter)
        if measured is None:
            return False
        defects.append(measured.defect)
    if not 0 < min(defects) <= max(defects) < math.inf:
        return False
    slopes = [math.log2(long / short) for long, short in pairwise(defects)]
    return min(slopes) > 1.5 and abs(slopes[0] - slopes[1]) < 1


def _largest_share(case: Case, again: MeasuredAgain) -> str:
    """A line that names the part of the step that causes most of the defect;
    empty if no part clearly does.

    The law is measured with each part (h or a c_jΔW_j) alone, all of the same size, and with each
    pair of parts. A fault in one term shows with that part alone. A fault in a product of two parts
    shows only with both, and halves if one of them is halved.
    """
    c = problems.build(case.problem).c
    loud: list[int] = [0, *(np.flatnonzero(c) + 1).tolist()] if case.h else []
    if not 2 <= len(loud) <= PAIRED_MAX_PARTS:
        return ""
    size = float(min(abs(case.h), *np.abs(c * case.dW)[c != 0])) or abs(case.h) / len(loud)

    def of_parts(parts: Parts) -> Measurement:
        dW = tuple(parts.get(j + 1, 0.0) * size / cj if cj else 0.0 for j, cj in enumerate(c))
        other = again(replace(case, h=float(np.copysign(parts.get(0, 0.0) * size, case.h)), dW=dW))
        return Measurement(float("nan"), 0.0) if other is None else other

    alone = {j: of_parts({j: 1.0}) for j in loud}
    total = sum(m.defect for m in alone.values())
    first = max(alone, key=lambda j: alone[j].defect)
    if alone[first].violates and alone[first].defect >= ALONE_MIN_SHARE * total:
        return f"nearly all of it is in {_name(first)}: alone it makes {_defects(alone)}"
    for j, k in combinations(loud, 2):
        both = of_parts({j: 1.0, k: 1.0})
        halves = [
            of_parts({j: a, k: b}).defect / both.defect for a, b in ((0.5, 1.0), (1.0, 0.5)) if both.defect
        ]
        least = max(alone[j].defect, alone[k].defect) <= PAIRED_MAX_SHARE * both.defect
        if (
            both.violates
            and least
            and halves
            and all(HALVED_RANGE[0] <= share <= HALVED_RANGE[1] for share in halves)
        ):
            return f"nearly all of it is in the product of {_name(j)} and {_name(k)}, each of which alone makes none"
    return ""


def _name(j: int) -> str:
    return "h" if j == 0 else f"c{j} ΔW{j}"


def _defects(alone: dict[int, Measurement]) -> str:
    return ", ".join(f"{m.defect:.2g} with {_name(j)}" for j, m in alone.items())
