"""The step is the solution of (2.1) in extended precision, computed by code that shares nothing with the core.

With s stages it solves the collocation equations of Cohen and Hairer (2011) with the random step. Random systems come
first, and their steps are solved anew. Then come the reference vectors: states of extreme size, steps next to a fold,
separatrices, which a random search does not reach.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from functools import cache
from random import Random
from statistics import median
from typing import Any

import numpy as np
from sepv.properties._exact_step import exact_step
from sepv.reference.arithmetic import context
from sepv.reference.equations_by_class import equation_for
from sepv.reference.steps import reference_step
from sepv.reference.vector import ReferenceVector, load, schemes_with_vectors

from sepv.errors import StepFailure
from sepv.problem import Array, GivenProblem
from sepv.record import EPS, TINY
from sepv.schemes import Scheme, Systems, ask
from sepv.verification import (
    Case,
    Cases,
    Effort,
    Finding,
    Law,
    Measurement,
    Run,
    Verdict,
    require,
    searched,
    state_ulp,
)
from sepv.verification._cases.commuting import critical_step
from sepv.verification._tolerance import quadrature_rounding, state_error

# A vector's `rounding` bounds the error of one evaluation of the equation in binary64. As in
# sepv.verification._tolerance, a factor of 4 covers implementations that order the same operations differently.
ORDER_OF_OPERATIONS = 4.0
# The reference's error for a step with several Hamiltonians from a critical point of the first
# (`sepv.problem._structures`).
UNDEFINED = "a structure is undefined"

# The number of critical points of H_0 that are tried.
CRITICAL = 16


@cache
def _vectors(name: str) -> dict[Case, ReferenceVector]:
    known = load(name) if name in schemes_with_vectors() else ()
    return {Case(v.problem, v.y, v.h, v.dW): v for v in known}


def vectors(scheme: Scheme) -> dict[Case, ReferenceVector]:
    """The reference vectors of the equation that the scheme is compared with, each under its case.

    None for a scheme in single precision: bounds and conditions of vectors are for roundings of binary64.
    """
    method = equation_for(scheme.systems, scheme.stages)
    return _vectors(method if isinstance(method, str) else method.name) if scheme.eps == EPS else {}


def check(scheme: Scheme, case: Case) -> Measurement:
    """The distance from the solution of (2.1), against a bound scaled by the condition."""
    vector = vectors(scheme).get(case)
    return _against_mpmath(scheme, case) if vector is None else _against_vector(scheme, case, vector)


def _against_mpmath(scheme: Scheme, case: Case, near: Array | None = None) -> Measurement:
    """Compare with the equation solved anew, near a given state where it has several solutions."""
    problem, y, h, dW = case.build()
    try:
        y1 = ask(scheme, problem, y, h, dW)
    except StepFailure:
        if scheme.systems == Systems.SEVERAL and _undefined(scheme, case):
            return Measurement(0.0, 0.0, f"refused, as is right: {UNDEFINED}")
        raise
    start = None if near is None else near.tolist()
    method = equation_for(scheme.systems, scheme.stages)
    # Stages cannot be computed from y1: their equation is solved from y.
    try:
        exact, condition = exact_step(
            method, case.problem, case.y, h, case.dW, start if scheme.stages == 1 else None
        )
    except StepFailure as failure:
        if failure.status.startswith(UNDEFINED):
            return Measurement(float("inf"), 0.0, f"y1 = {y1.tolist()}, and no refusal: {failure.status}")
        raise
    error, bound = state_error(exact, condition, problem, y, y1, h, dW, scheme)
    equation = method if isinstance(method, str) else method.name
    name = "the solution of (2.1)" if equation == "energy-preserving" else equation
    return Measurement(error, bound, f"y1 = {y1.tolist()}, {error:.3g} ulp from {name}")


def _undefined(scheme: Scheme, case: Case) -> bool:
    """True if the equation of the step does not exist in exact numbers."""
    try:
        reference_step(equation_for(scheme.systems, scheme.stages), case.problem, case.y, case.h, case.dW)
    except StepFailure as failure:
        return failure.status.startswith(UNDEFINED)
    return False


def _against_vector(scheme: Scheme, case: Case, vector: ReferenceVector) -> Measurement:
    problem, y, h, dW = case.build()
    name = f"vector {vector.id} ({vector.note})"
    try:
        y1 = ask(scheme, problem, y, h, dW)
    except StepFailure:
        if not vector.hard:
            raise
        return Measurement(0.0, 0.0, f"{name}: not solved, and said so")
    ctx, unit = context(60), state_ulp(y, y1)
    errors = [abs(float(ctx.mpf(exact) - float(value))) for exact, value in zip(vector.y1, y1, strict=True)]
    scale = max(map(abs, (*y, *y1)))
    # An iteration may stop where its correction is below the rounding of the largest component.
    floor = max(scheme.solver_tolerance, EPS) * scale + TINY
    # The vector's quadrature has the fewest exact nodes; others may have more.
    other_nodes = vector.condition * float(np.max(quadrature_rounding(problem, y, y1, h, dW)))
    bounds = [ORDER_OF_OPERATIONS * r + other_nodes + floor for r in vector.rounding]
    k = max(range(len(errors)), key=lambda i: errors[i] / bounds[i])
    ulps = errors[k] / unit
    detail = f"y1 = {y1.tolist()}, {ulps:.3g} ulp from the answer of {name}: {', '.join(vector.y1)}"
    measured = Measurement(ulps, bounds[k] / unit, detail)
    if vector.hard and measured.violates:
        # So long a step may have other solutions. One of them is no violation of (2.1); any other state is.
        with suppress(StepFailure):
            other = _against_mpmath(scheme, case, near=y1)
            return measured if other.violates else other
    return measured


def _statistics(scheme: Scheme, seen: list[tuple[Case, Measurement]]) -> str:
    """Summarise the errors as shares of their bounds: the largest with its place, and the median."""
    known = vectors(scheme)
    measured = [(m.ratio, case, m) for case, m in seen if m.bound > 0]
    if not measured:
        return ""
    ratio, case, _ = max(measured, key=lambda entry: entry[0])
    vector = known.get(case)
    where = f"vector {vector.id}" if vector else "a random system"
    count = sum(case in known for _, case, _ in measured)
    refused = len(seen) - len(measured)
    return (
        f"error / bound: largest {ratio:.3g} ({where}), median {median(r for r, _, _ in measured):.2g}, "
        f"over {count} vectors and {len(measured) - count} other steps"
        + (f"; {refused} steps without a solution or hard to solve refused" if refused else "")
    )


@cache
def _critical() -> tuple[Case, ...]:
    """Steps from critical points, which must be refused."""
    return tuple(critical_step(Random(seed)) for seed in range(CRITICAL))


def _law(seen: list[tuple[Case, Measurement]], extra: Iterable[Case] = ()) -> Law:
    def measured(scheme: Scheme, case: Case) -> Measurement:
        seen.append((case, check(scheme, case)))
        return seen[-1][1]

    return searched(
        name="reference",
        statement="the step solves (2.1) (s stages: its collocation equations)",
        source="(2.1)",
        unit="ulp of y",
        cost=1.5,
        steps=391,
        cases=Cases(
            blind={"degree of H": ("1–2",), "degree of B": ("0",)},
            adapt=lambda case: None if isinstance(case.problem, GivenProblem) else case,
            why="it compares with a solution in extended precision, which needs the problem as data",
            not_of={
                Systems.HAMILTONIANS: "it is about the equation of (2.1), which several Hamiltonians do not have"
            },
            fixed={systems: lambda: extra for systems in Systems}
            | {Systems.SEVERAL: lambda: (*_critical(), *extra)},
        ),
        check=measured,
    )


def _run(_: Law, scheme: Scheme, this_run: Run) -> Finding:
    seen: list[tuple[Case, Measurement]] = []
    # Vectors are long steps, with a solution of their own: without its noise each would be another step.
    inner = _law(seen, [case for case in vectors(scheme) if not (scheme.deterministic and case.dW)])
    finding = inner.run(inner, scheme, this_run)
    if finding.verdict is not Verdict.HOLDS:
        return finding
    return replace(finding, message="\n".join(filter(None, (finding.message, _statistics(scheme, seen)))))


def _replay(_: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    inner = _law([])
    return inner.replay(inner, scheme, witness)


law = replace(_law([]), run=_run, replay=_replay)


def test_reference(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
