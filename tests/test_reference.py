"""The references: exact invariants, independence of precision, and formulas written out in another way."""

from __future__ import annotations

import mpmath
import pytest
from hypothesis import given, settings
from sepv.reference.arithmetic import context, gauss_nodes
from sepv.reference.implicit import energy_preserving, midpoint
from sepv.reference.problem import exact_problem

from sepv import problems, strategies
from sepv.case import Case
from sepv.errors import StepFailure, UsageError
from sepv.problem import NamedProblem


@settings(max_examples=40)
@given(strategies.any_steps())
def test_the_reference_keeps_energy_and_casimirs_to_its_digits(case: Case) -> None:
    exact = exact_problem(case.problem, 65)
    y0, y1 = exact.state(case.y), energy_preserving(case.problem, case.y, case.h, case.dW).y1
    scale = 1 + abs(exact.hamiltonian(y0)) + max(abs(v) for v in exact.gradient(y0))
    assert abs(exact.hamiltonian(y1) - exact.hamiltonian(y0)) < 1e-45 * scale
    for before, after in zip(exact.casimir_values(y0), exact.casimir_values(y1), strict=True):
        assert abs(after - before) < 1e-45 * (1 + abs(before))


@settings(max_examples=30)
@given(strategies.any_steps())
def test_thirty_digits_agree_with_sixty(case: Case) -> None:
    for solve in (energy_preserving, midpoint):
        coarse, fine = (solve(case.problem, case.y, case.h, case.dW, digits) for digits in (30, 60))
        for a, b in zip(coarse.y1, fine.y1, strict=True):
            assert abs(b - a) < 1e-29 * (1 + abs(b))


def test_oscillator_is_the_printed_formula_to_fifty_digits() -> None:
    data, ctx = problems.harmonic_oscillator().data, context(60)
    assert isinstance(data, NamedProblem)
    p, x, delta = ctx.mpf(0.2), ctx.mpf(0.1), ctx.mpf(0.5) + ctx.mpf(0.25)
    q = 1 + delta**2 / 4
    expected = [(-delta * x + (1 - delta**2 / 4) * p) / q, ((1 - delta**2 / 4) * x + delta * p) / q]
    for solve in (energy_preserving, midpoint):
        for a, b in zip(solve(data, [0.2, 0.1], 0.5, [0.25]).y1, expected, strict=True):
            assert abs(a - b) < 1e-49


@pytest.mark.parametrize("nodes", [1, 2, 3, 6])
def test_gauss_nodes_integrate_powers_exactly(nodes: int) -> None:
    rule, ctx = gauss_nodes(nodes, 50), context(50)
    for degree in range(2 * nodes):
        assert abs(ctx.fsum(w * x**degree for x, w in rule) - ctx.one / (degree + 1)) < 1e-48


def test_no_global_precision_is_touched() -> None:
    before = mpmath.mp.dps
    energy_preserving(problems.pendulum().data, [0.2, 1.0], 0.1, [0.1, 0.1], 80)
    assert mpmath.mp.dps == before


def test_no_solution_is_a_step_failure() -> None:
    with pytest.raises(StepFailure, match="extended precision"):
        energy_preserving(problems.lotka_volterra().data, [1.0, 1.9, 0.5], 0.5, [3.0])


def test_unknown_problems_are_refused() -> None:
    with pytest.raises(UsageError, match="known to the references"):
        exact_problem(NamedProblem("nosuch"), 50)
