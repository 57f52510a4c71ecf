"""A step keeps each Casimir C, quadratic or not: for d = 3 each C with B(y)v = g(y)(v × ∇C(y)), else polynomials C.

The scheme (2.1) keeps only linear and quadratic Casimirs. Cohen and Dujardin (2014), §5, leave other invariants open.
If d > 3, a system is built from two or three Casimirs C_1, … of degree one to four by B_ij = Σ ε_ijk… ∂_kC_1 …, or it
is a system on su(3), whose Casimir of third degree is tr P³ (`sepv.problems._matrix_algebras`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from random import Random
from typing import Any

import numpy as np
from sepv.reference.problem import exact_problem

from sepv.problem import PolynomialSystem, Problem, Systems
from sepv.record import EPS, TINY, PolynomialMap, poly
from sepv.schemes import Scheme, ask
from sepv.verification import Case, Cases, Effort, Measurement, require, searched, step_residual
from sepv.verification._cases import random_parts as some
from sepv.verification._cases.of_law import only
from sepv.verification._cases.random_cases import placed
from sepv.verification._tolerance import majorant_over

# The number of fixed systems of dimension 4 and 5 on which each scheme for (1.1) is tested, with every seed.
SYSTEMS = 12


def slopes(case: Case, problem: Problem, *states: np.ndarray) -> Iterator[np.ndarray]:
    """Yield for each Casimir C a bound (d,) of the terms of ∇C on the box of the states (`majorant_over`)."""
    for C in case.problem.polynomial_casimirs if isinstance(case.problem, PolynomialSystem) else ():
        yield majorant_over(PolynomialMap((C.dimension,), poly.gradient(C)), None, states)
    nambu = problem.nambu
    if nambu is not None:
        yield majorant_over(nambu.gradient, nambu.hessian, states, potential=nambu.casimir)


def values(exact: Any, y: np.ndarray) -> list[Any]:
    """Evaluate the Casimirs at a binary64 state in extended precision, in the order of `slopes`."""
    at = exact.state(y)
    return [*exact.polynomial_casimirs(at), *([exact.casimir(at)] if exact.casimir else [])]


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure the largest C(y1) − C(y0) of all Casimirs C, evaluated at the binary64 states in extended precision.

    With the averaged gradient ∇̄C and the residual r of the step, C(y1) − C(y0) = ∇̄Cᵀ(y1 − y0) = ∇̄Cᵀr. The step
    evaluates ∇̄C too. The sums of terms in ∇̄C double the operations of (2.1), so the bound of r is doubled.
    """
    problem, y, h, dW = case.build()
    y1 = ask(scheme, problem, y, h, dW)
    exact = exact_problem(case.problem, 40)
    residual = 2 * step_residual(problem, y, y1, h, dW, scheme)
    measurements = []
    for M, before, after in zip(
        slopes(case, problem, y, y1), values(exact, y), values(exact, y1), strict=True
    ):
        unit = EPS * max(float(np.linalg.norm(M) * np.linalg.norm(v)) for v in (y, y1)) + TINY
        change = float(after - before)
        detail = f"C(y1) − C(y0) = {change:.6g}, C(y0) = {float(before):.6g}, y1 = {y1.tolist()}"
        measurements.append(Measurement(abs(change) / unit, (float(M @ residual) + TINY) / unit, detail))
    return max(measurements, key=lambda m: m.ratio)


def beyond_three() -> Iterable[Case]:
    """Make steps of at least half the contraction radius for systems (1.1) with d = 4 or 5 and d − 2 given Casimirs."""
    made = (_step(Random(seed), 4 + seed % 2) for seed in range(4 * SYSTEMS))
    return [case for case in made if case is not None][:SYSTEMS]


def of_casimirs(d: int, random: Random) -> PolynomialSystem:
    """A system (1.1) with d − 2 Casimirs C_1, … of degree one to four, not all quadratic: B_ij = Σ ε_ijk… ∂_kC_1 …."""
    casimirs = [some.polynomial(d, 1, 4, 4, random) for _ in range(d - 3)]
    casimirs.append(some.polynomial(d, 3, 4, 4, random))
    B = some.contracted(d, [list(poly.gradient(C)) for C in casimirs], random)
    H = some.polynomial(d, 2, 4, 6, random)
    return PolynomialSystem(d, H, B, (1.0,), polynomial_casimirs=tuple(casimirs))


def _step(random: Random, d: int) -> Case | None:
    from sepv.verification._cases import strata

    axes = (strata.STEP, strata.SIGN, strata.SHARE, strata.GIVEN)
    levels = {axis.name: axis.strata[0] for axis in axes}
    y = tuple(random.choice([1.0, -1.0]) * random.randint(1, 8) / 8 for _ in range(d))
    return placed(of_casimirs(d, random), y, levels, random)


_OF_ONE = "its cases have one structure: see casimir"
law = searched(
    name="any-casimir",
    statement="every Casimir is kept, quadratic or not",
    source="§5",
    unit="ulp of C",
    preserves=True,
    cost=0.3,
    steps=51,
    cases=Cases(
        where={"matrices": ("su(3)",)},
        instead={Systems.SINGLE: Systems.NAMBU, Systems.HAMILTONIANS: Systems.MATRIX_HAMILTONIANS},
        blind={"degree of C": ("1", "2")},
        adapt=only(
            lambda p: p.nambu is not None or getattr(p.data, "polynomial_casimirs", ()),
            data=True,
        ),
        why="the problems have no Casimir as data that is neither linear nor quadratic",
        not_of={
            Systems.SEVERAL: _OF_ONE,
            Systems.ADDITIVE: "additive noise leaves the Casimirs of B",
        },
        fixed={Systems.SINGLE: beyond_three},
    ),
    check=check,
)


def test_any_casimir(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
