"""Proposition 3.2 of Cohen and Dujardin (2014): a step keeps quadratic Casimirs yᵀAy and linear
Casimirs bᵀy.
"""

from __future__ import annotations

import numpy as np
from sepv.reference.problem import exact_problem

from sepv.law import Case, Cases, Effort, Measurement, casimir_bound, require, searched, step_residual
from sepv.law.cases.of_law import only
from sepv.law.tolerance import casimir_ulp
from sepv.problem import hamiltonian_noises
from sepv.schemes import Scheme, ask


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure the largest C(y1) − C(y0) of all Casimirs C,
    evaluated at the binary64 states in extended precision.
    """
    problem, y, h, dW = case.build()
    y1 = ask(scheme, problem, y, h, dW)
    exact = exact_problem(case.problem, 40)
    residual = step_residual(problem, y, y1, h, dW, scheme)
    before, after = exact.casimir_values(exact.state(y)), exact.casimir_values(exact.state(y1))
    measurements = []
    for A, c0, c1 in zip((*problem.casimirs, *problem.linear_casimirs), before, after, strict=True):
        unit = casimir_ulp(A, y, y1)
        form = "yᵀAy" if np.ndim(A) == 2 else "bᵀy"
        detail = (
            f"C = {form}: C(y1) − C(y0) = {float(c1 - c0):.6g}, C(y0) = {float(c0):.6g}, y1 = {y1.tolist()}"
        )
        measurements.append(
            Measurement(abs(float(c1 - c0)) / unit, casimir_bound(A, y, y1, residual) / unit, detail)
        )
    return max(measurements, key=lambda m: m.ratio)


law = searched(
    name="casimir",
    statement="every quadratic Casimir yᵀAy and every linear Casimir bᵀy is kept",
    source="Prop. 3.2",
    unit="ulp of C",
    preserves=True,
    cost=0.4,
    steps=75,
    cases=Cases(
        where={
            "Casimirs": ("linear", "quadratic", "two"),
            "structures": ("common Casimir",),
            "degree of C": ("1", "2"),
        },
        blind={"degree of B": ("0",), "Casimirs": ("linear",)},
        adapt=only(lambda p: len(p.casimirs) or len(p.linear_casimirs)),
        why="the problems name no quadratic or linear Casimir that the exact flow keeps",
        needs={hamiltonian_noises: "additive noise leaves the Casimirs of B: see invariant:casimir"},
    ),
    check=check,
)


def test_casimir(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
