"""§2: for constant B the scheme is (2.2), and for c = 0 it is the deterministic method with step h."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st
from sepv.reference.equations_by_class import equation_for
from sepv.reference.steps import reference_step

from sepv.problem import PolynomialSystem
from sepv.record import _polynomial as poly
from sepv.schemes import Scheme, Systems, ask
from sepv.verification import Case, Effort, Measurement, require, searched
from sepv.verification._cases.fixed_cases import with_constant_structure
from sepv.verification._tolerance import DIGITS, state_error
from sepv.verification.strategies import coefficients, hamiltonians, noises, poisson_systems, steps


@st.composite
def constant_structures(draw: st.DrawFn) -> PolynomialSystem:
    """A constant B with any skew entries."""
    d = draw(st.integers(2, 6))
    pairs = draw(st.lists(st.tuples(st.integers(0, d - 2), st.integers(1, d - 1)), min_size=1, max_size=6))
    entries = {(min(i, j), max(i, j)): draw(coefficients()) for i, j in pairs if i != j} or {(0, 1): -1.0}
    B = tuple((i, j, poly.constant(d, value)) for (i, j), value in sorted(entries.items()))
    return PolynomialSystem(d, draw(hamiltonians(d)), B, draw(noises(least=1)))


def cases() -> st.SearchStrategy[Case]:
    """Constant B with noise; any B with noise of size zero."""
    silent = poisson_systems().map(lambda s: replace(s, noise=(0.0, 0.0)))
    return st.one_of(steps(constant_structures()), steps(silent))


def check(scheme: Scheme, case: Case) -> Measurement:
    """Distance from (2.2), or from the deterministic step, at 30 digits."""
    problem, y, h, dW = case.build()
    y1 = ask(scheme, problem, y, h, dW)
    if scheme.systems == Systems.SEVERAL and isinstance(case.problem, PolynomialSystem):
        single = replace(case.problem, noise_structures=())
        exact = reference_step("energy-preserving", single, case.y, h, case.dW, DIGITS)
        error, bound = state_error(exact.y1, exact.condition, problem, y, y1, h, dW, scheme)
        return Measurement(error, bound, f"y1 = {y1.tolist()}, {error:.3g} ulp from (2.1), all G_j = B")
    method = equation_for(scheme.systems, scheme.stages)
    if problem.c.any() and scheme.stages == 1:
        exact = reference_step("averaged-vector-field", case.problem, case.y, h, case.dW, DIGITS)
        name = "(2.2)"
    elif problem.c.any():
        # Constant B, s stages: the equations are those of any B, with one matrix at all stages.
        exact = reference_step(method, case.problem, case.y, h, case.dW, DIGITS)
        name = "the method for constant B"
    else:
        quiet = ask(scheme, problem, y, h, np.zeros_like(dW))
        if not np.array_equal(quiet, y1):
            return Measurement(
                float("inf"), 0.0, f"c = 0, but dW changes y1 from {quiet.tolist()} to {y1.tolist()}"
            )
        exact = reference_step(method, case.problem, case.y, h, case.dW, DIGITS)
        name = "the deterministic method"
    error, bound = state_error(exact.y1, exact.condition, problem, y, y1, h, dW, scheme)
    return Measurement(error, bound, f"y1 = {y1.tolist()}, {error:.3g} ulp from {name}")


def admits(case: Case) -> bool:
    """B constant, or no noise."""
    problem, y, _, _ = case.build()
    return not problem.c.any() or bool(np.all(problem.structure(2 * y + 1) == problem.structure(y)))


law = searched(
    name="reduction",
    statement="constant B: the step is that of (2.2); c = 0: that of the deterministic method",
    source="§2",
    unit="ulp of y",
    cost=0.9,
    steps=124,
    cases=cases,
    check=check,
    fixed_cases=with_constant_structure,
    admits=admits,
)


def test_reduction(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
