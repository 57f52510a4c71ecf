"""H and any Casimir in dimension three: B(y)v = g(y)(v × ∇C(y)) keeps C, quadratic or not, and so may a scheme.

Cohen and Dujardin (2014), §5, leave the preservation of other invariants open; (2.1) keeps quadratic Casimirs only.
"""

from __future__ import annotations

import numpy as np
from sepv.reference.problem import exact_problem

from sepv.problem import Problem, Systems
from sepv.record import PolynomialMap
from sepv.record._binary64 import EPS, TINY
from sepv.schemes import Scheme, ask
from sepv.verification import Case, Cases, Effort, Measurement, require, searched, step_residual
from sepv.verification._cases.of_law import only


def slope(problem: Problem, *states: np.ndarray) -> np.ndarray:
    """A majorant of ∇C (3,) over the states: absolute coefficients, else |∇C| + |C″||y|."""
    nambu = problem.nambu
    assert nambu is not None
    if isinstance(nambu.gradient, PolynomialMap):
        return np.max([nambu.gradient.majorant(y) for y in states], axis=0)
    return np.max([np.abs(nambu.gradient(y)) + np.abs(nambu.hessian(y)) @ np.abs(y) for y in states], axis=0)


def check(scheme: Scheme, case: Case) -> Measurement:
    """C(y1) − C(y0), C evaluated at the binary64 states in extended precision.

    C(y1) − C(y0) = ∇̄Cᵀ(y1 − y0) = ∇̄Cᵀr for a step with residual r. ∇̄C is now among the factors of r: its sums of
    terms of degree ≤ 4 double the operations of (2.1).
    """
    problem, y, h, dW = case.build()
    y1 = ask(scheme, problem, y, h, dW)
    exact = exact_problem(case.problem, 40)
    assert exact.casimir is not None
    before, after = exact.casimir(exact.state(y)), exact.casimir(exact.state(y1))
    M = slope(problem, y, y1)
    residual = 2 * step_residual(problem, y, y1, h, dW, scheme)
    unit = EPS * max(float(np.linalg.norm(M) * np.linalg.norm(v)) for v in (y, y1)) + TINY
    detail = f"C(y1) − C(y0) = {float(after - before):.6g}, C(y0) = {float(before):.6g}, y1 = {y1.tolist()}"
    return Measurement(abs(float(after - before)) / unit, (float(M @ residual) + TINY) / unit, detail)


_OF_ONE = "its cases have one Hamiltonian and one structure: see casimir"
law = searched(
    name="any-casimir",
    statement="in dimension 3 every Casimir is kept, quadratic or not",
    source="§5",
    unit="ulp of C",
    cost=0.3,
    steps=51,
    cases=Cases(
        instead={Systems.SINGLE: Systems.NAMBU},
        blind={"degree of C": ("1", "2")},
        adapt=only(lambda p: p.nambu is not None, data=True),
        why="the problems have no Casimir and factor in dimension 3 as data",
        not_of={Systems.SEVERAL: _OF_ONE, Systems.HAMILTONIANS: _OF_ONE},
    ),
    check=check,
)


def test_any_casimir(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
