"""§2 of Cohen and Dujardin (2014): for constant B the scheme (2.1) is (2.2),
for c = 0 a deterministic method.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from sepv.properties._exact_step import exact_step
from sepv.properties._structures import is_constant
from sepv.reference.equations_by_class import equation_for

from sepv.law import Case, Cases, Effort, Measurement, require, searched
from sepv.law.cases.case import with_noise
from sepv.law.tolerance import state_error
from sepv.problem import GivenProblem, PolynomialSystem, one_field, one_hamiltonian, same_structure
from sepv.schemes import Scheme, ask


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure the distance of y1 from (2.2); if all G_j = B, from (2.1); if c = 0,
    from the deterministic method.
    """
    problem, y, h, dW = case.build()
    y1 = ask(scheme, problem, y, h, dW)
    if same_structure not in scheme.systems.facts and isinstance(case.problem, PolynomialSystem):
        single = replace(case.problem, noise_structures=())
        exact, condition = exact_step("energy-preserving", single, case.y, h, case.dW)
        error, bound = state_error(exact, condition, problem, y, y1, h, dW, scheme)
        return Measurement(error, bound, f"y1 = {y1.tolist()}, {error:.3g} ulp from (2.1), all G_j = B")
    method = equation_for(scheme.systems, scheme.stages)
    if problem.c.any() and scheme.stages == 1:
        exact, condition = exact_step("averaged-vector-field", case.problem, case.y, h, case.dW)
        name = "(2.2)"
    elif problem.c.any():
        # For s stages the reference solves the general equations, whose matrix is equal at all
        # stages if B is constant.
        exact, condition = exact_step(method, case.problem, case.y, h, case.dW)
        name = "the method for constant B"
    else:
        quiet = ask(scheme, problem, y, h, np.zeros_like(dW))
        if not np.array_equal(quiet, y1):
            return Measurement(
                float("inf"), 0.0, f"c = 0, but dW changes y1 from {quiet.tolist()} to {y1.tolist()}"
            )
        exact, condition = exact_step(method, case.problem, case.y, h, case.dW)
        name = "the deterministic method"
    error, bound = state_error(exact, condition, problem, y, y1, h, dW, scheme)
    return Measurement(error, bound, f"y1 = {y1.tolist()}, {error:.3g} ulp from {name}")


def reduced(case: Case) -> Case | None:
    """Keep a case if B is constant, c = 0 or all G_j = B.
    Else drop it if it has several structures, or set c = 0.
    """
    if isinstance(case.problem, GivenProblem):
        return None
    problem, y, h, dW = case.build()
    if not one_field(problem):
        data = case.problem
        same = (
            isinstance(data, PolynomialSystem) and data.noise_structures == (data.structure,) * problem.noises
        )
        return case if same else None
    if not problem.c.any() or is_constant(problem, y):
        return case
    length = float(np.copysign(abs(h) + np.abs(problem.c * dW).sum(), h))
    return replace(with_noise(case, (0.0,) * problem.noises, case.dW), h=length)


law = searched(
    name="reduction",
    statement="for constant B the step is that of (2.2), for c = 0 that of the deterministic method",
    source="§2",
    unit="ulp of y",
    cost=0.9,
    steps=124,
    cases=Cases(
        where={"structures": ("all are B",)},
        adapt=reduced,
        why="it compares with a solution in extended precision, which needs the problem as data",
        needs={one_hamiltonian: "it is about the equation of (2.1), which several Hamiltonians do not have"},
    ),
    check=check,
)


def test_reduction(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
