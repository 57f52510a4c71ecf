"""A step solves equation (2.1): y1 is compared with a solution that independent code finds in
extended precision.

A step with s stages solves the collocation equations of Cohen and Hairer (2011) with the random
step. Random systems are tested first, and their steps are solved by the reference code. Then come
the reference vectors, stored solutions that a random search does not reach: states of extreme size,
the longest steps with a solution, separatrices.
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
from sepv.law import (
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
from sepv.law.cases.classes import NARROW_CLASSES
from sepv.law.cases.commuting import of_actions
from sepv.law.cases.fixed_cases import longest, many
from sepv.law.cases.random_parts import coefficient
from sepv.law.tolerance import gradient_majorant, state_error, structure_majorant
from sepv.problem import (
    Array,
    GivenProblem,
    PolynomialSystem,
    Problem,
    matvec,
    one_hamiltonian,
    same_structure,
)
from sepv.problems import commuting_actions
from sepv.record import EPS, TINY, poly
from sepv.schemes import Scheme, Systems, ask

# The `rounding` of a reference vector bounds the error of one evaluation of the equation in
# binary64. As in sepv.law.tolerance, this factor covers implementations that order the same
# operations differently.
ORDER_OF_OPERATIONS = 4.0
# The largest number of nodes of a quadrature that is exact to rounding: 33 Chebyshev points, 20
# Gauss nodes, …
QUADRATURE_NODES = 40
# The first words of the reference solver's error for a step of several Hamiltonians from a critical
# point of H_0, where a structure is undefined (`sepv.problem._structures`).
UNDEFINED = "a structure is undefined"

# The number of steps from critical points of H_0 that are tested.
CRITICAL_STEPS = 16


@cache
def _vectors(name: str) -> dict[Case, ReferenceVector]:
    known = load(name) if name in schemes_with_vectors() else ()
    return {Case(v.problem, v.y, v.h, v.dW): v for v in known}


def vectors(scheme: Scheme) -> dict[Case, ReferenceVector]:
    """Return the reference vectors of the equation that the scheme solves,
    each with its case as key.

    For a scheme in single precision the result is empty, because bounds of vectors are for
    roundings of binary64.
    """
    method = equation_for(scheme.systems, scheme.stages)
    return _vectors(method if isinstance(method, str) else method.name) if scheme.eps == EPS else {}


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure the distance of y1 from the solution of (2.1).
    The bound is proportional to the condition of the step.
    """
    vector = vectors(scheme).get(case)
    return _against_mpmath(scheme, case) if vector is None else _against_vector(scheme, case, vector)


def _against_mpmath(scheme: Scheme, case: Case, near: Array | None = None) -> Measurement:
    """Compare y1 with a new solution of the equation, by Newton's method from `near` if given (for
    one stage).
    """
    problem, y, h, dW = case.build()
    try:
        y1 = ask(scheme, problem, y, h, dW)
    except StepFailure:
        if same_structure not in scheme.systems.facts and _undefined(scheme, case):
            return Measurement(0.0, 0.0, f"refused, as is right: {UNDEFINED}")
        raise
    start = None if near is None else near.tolist()
    method = equation_for(scheme.systems, scheme.stages)
    # With several stages the iteration starts from y, because stages cannot be computed from the
    # state `near`.
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
    """True if the reference solver finds a structure of the case undefined,
    so that the step has no equation.
    """
    try:
        reference_step(equation_for(scheme.systems, scheme.stages), case.problem, case.y, case.h, case.dW)
    except StepFailure as failure:
        return failure.status.startswith(UNDEFINED)
    return False


def quadrature_rounding(problem: Problem, y0: Array, y1: Array, h: float, dW: Array) -> Array:
    """A bound (d,) of the change of a step's right side ΔB∇̄H if another quadrature,
    exact to rounding, computes ∇̄H.

    A sum of N products w_n ∇H(y_n) with rounded weights errs in any order by at most (N + 2)u
    Σ|w_n||∇H(y_n)| (Higham, *Accuracy and Stability of Numerical Algorithms*, §3.1). The weights
    are positive with sum 1, so the bound is N u (|h| + Σ|c_jΔW_j|) M_B M_g with bounds M_B, M_g of
    |B| and |∇H|. Here M_g, or for a polynomial H a part of N, covers the rounding of the points
    y_n. If the bound overflows, the result is 0, the strictest bound.
    """
    with np.errstate(all="ignore"):
        length = abs(h) + float(np.sum(np.abs(problem.c * dW)))
        flow = matvec(structure_majorant(problem, y0, y1), gradient_majorant(problem, y0, y1))
        return np.nan_to_num(0.5 * EPS * QUADRATURE_NODES * length * flow, nan=0.0, posinf=0.0)


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
    # An iteration may stop once its correction is below the rounding of the largest component.
    floor = max(scheme.solver_tolerance, EPS) * scale + TINY
    # The vector's rounding is that of the exact quadrature with the fewest nodes. A scheme may use
    # more nodes.
    other_nodes = vector.condition * float(np.max(quadrature_rounding(problem, y, y1, h, dW)))
    bounds = [ORDER_OF_OPERATIONS * r + other_nodes + floor for r in vector.rounding]
    k = max(range(len(errors)), key=lambda i: errors[i] / bounds[i])
    ulps = errors[k] / unit
    detail = f"y1 = {y1.tolist()}, {ulps:.3g} ulp from the answer of {name}: {', '.join(vector.y1)}"
    measured = Measurement(ulps, bounds[k] / unit, detail)
    if vector.hard and measured.violates:
        # A step as long as this may have other solutions. If y1 is one of them, it does not violate
        # (2.1).
        with suppress(StepFailure):
            other = _against_mpmath(scheme, case, near=y1)
            return measured if other.violates else other
    return measured


def _statistics(scheme: Scheme, seen: list[tuple[Case, Measurement]]) -> str:
    """Summarise the errors divided by their bounds: the largest ratio with its step,
    and the median.
    """
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


def critical_step(random: Random) -> Case:
    """A step from a critical point of H_0 at which some B∇H_j is not zero: a scheme must refuse it.

    Either y is 0 in one plane of variables and a noise turns another plane, or H_0 = ½I² − I_0 I
    with I = ½|y|² has a circle of critical points, I = I_0.
    """
    a, b = random.choice([(1.0, 0.0), (0.5, 0.5), (1.0, -2.0), (-0.25, 0.5)])
    y: tuple[float, ...]
    if random.choice([True, False]):
        n, kept, y = 2, 1, (0.0, 0.0, a, b)
        H = poly.polynomial(2, {(1, 0): 1.0, (2, 0): coefficient(random), (1, 1): coefficient(random)})
    else:
        # I_0 is a sum of squares of few bits, so that ∇H_0 = (I − I_0) y is exactly zero.
        n, kept, y = 1, 0, (a, b)
        H = poly.polynomial(1, [((2,), 0.5), ((1,), -0.5 * (a * a + b * b))])
    m = random.randint(1, 2)
    others = [poly.variable(n, kept), *(of_actions(n, random) for _ in range(m - 1))]
    system = commuting_actions(H, others, (1.0, 0.5)[:m])
    h = random.choice([2.0**-3, 2.0**-6, 2.0**-10])
    return Case(system, y, h, tuple(random.choice([1.0, -1.0, 0.5]) * h**0.5 for _ in range(m)))


@cache
def _critical() -> tuple[Case, ...]:
    """Make steps of several Hamiltonians from critical points of H_0.
    Schemes must refuse these steps.
    """
    return tuple(critical_step(Random(seed)) for seed in range(CRITICAL_STEPS))


@cache
def _flat() -> tuple[Case, ...]:
    """Make steps from a state at which B′ and H″ vanish,
    for a B that is not constant and an H that is not linear.
    """
    H = poly.polynomial(2, {(0, 1): 1.0, (4, 0): 1.0})
    B = ((0, 1, poly.polynomial(2, {(0, 0): 1.0, (2, 0): 1.0})),)
    return longest(PolynomialSystem(2, H, B, (1.0,)), (0.0, 0.5))


def _law(seen: list[tuple[Case, Measurement]], extra: Iterable[Case] = ()) -> Law:
    def measured(scheme: Scheme, case: Case) -> Measurement:
        seen.append((case, check(scheme, case)))
        return seen[-1][1]

    return searched(
        name="reference",
        statement="the step solves (2.1), or with s stages the collocation equations",
        source="(2.1)",
        unit="ulp of y",
        cost=1.5,
        steps=391,
        cases=Cases(
            blind={"degree of H": ("1–2",), "degree of B": ("0",)},
            adapt=lambda case: None if isinstance(case.problem, GivenProblem) else case,
            why="it compares with a solution in extended precision, which needs the problem as data",
            needs={
                one_hamiltonian: "it is about the equation of (2.1), which several Hamiltonians do not have"
            },
            fixed={systems: lambda: extra for systems in Systems if systems not in NARROW_CLASSES}
            | {
                Systems.SEVERAL: lambda: (*_critical(), *extra),
                Systems.SINGLE: lambda: (*many(), *_flat(), *extra),
            },
        ),
        check=measured,
    )


def _run(_: Law, scheme: Scheme, this_run: Run) -> Finding:
    seen: list[tuple[Case, Measurement]] = []
    # A scheme without noise gets no vectors with noise, because without the noise their steps would
    # be others.
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
