"""Axes of cases have open ends: sizes far beyond the usual ones, and steps in which little moves, are asked."""

from __future__ import annotations

import numpy as np
import pytest

from sepv import Scheme, problems, verify
from sepv.problem import Array, PolynomialSystem, Problem, Systems
from sepv.schemes import ask, energy_preserving, milstein
from sepv.verification import Case, Cases, Effort, Verdict
from sepv.verification._cases.classes import CLASSES
from sepv.verification._cases.ends import beyond, in_other_units
from sepv.verification._cases.strata import FAR, NEAR, STILL, UNDONE, UNEVEN
from sepv.verification._contraction import contraction_radius
from sepv.verification._tolerance import step_residual

SINGLE = Cases().space(Systems.SINGLE)
assert SINGLE is not None


def length(case: Case) -> float:
    return abs(case.h) + float(np.sum(np.abs(problems.build(case.problem).c * case.dW)))


def test_a_few_seeds_reach_the_ends_of_every_axis() -> None:
    cases = [case for seed in range(6) for _, case in SINGLE.cases(seed)]
    systems = [case.problem for case in cases if isinstance(case.problem, PolynomialSystem)]
    assert max(system.dimension for system in systems) > 30
    assert max(len(system.noise) for system in systems) > 15
    assert max(system.hamiltonian.degree for system in systems) > 15
    assert {0.25, 0.5, 0.3, 1.7} < {c for system in systems for c in system.noise}
    sizes = [float(np.max(np.abs(case.y))) for case in cases]
    assert min(sizes) < 1e-40
    assert max(sizes) > 1e40
    assert min(map(length, cases)) < 1e-12
    assert max(map(length, cases)) > 1e10
    assert any(not any(e) for system in systems for e, _ in system.hamiltonian.terms)
    assert all(length(c) <= contraction_radius(*c.build()[:2]) * (1 + 1e-12) for c in cases)


@pytest.mark.parametrize("systems", CLASSES)
def test_one_case_of_each_kind_follows_the_design(systems: Systems) -> None:
    found = CLASSES[systems].space.part().further(3)
    for name, case in found.items():
        problem, y, h, dW = case.build()
        parts = np.abs(problem.c * dW)
        if name == STILL.name:
            assert h == 0 < parts.max()
        elif name == UNDONE.name:
            assert h > 0 == problem.random_step(h, dW)
        elif name == UNEVEN.name and np.count_nonzero(problem.c) > 1:
            assert parts.max() > 10 * parts[problem.c > 0].min()
        elif name in (FAR[0].name, FAR[1].name):
            # The brackets of several Hamiltonians are products of three coefficients.
            assert abs(np.log10(np.abs(y).max())) > (90 if systems is Systems.SINGLE else 20)
        assert length(case) <= contraction_radius(problem, y)
    assert {NEAR.name, FAR[0].name} <= set(found) or systems not in (Systems.SINGLE, Systems.HAMILTONIANS)


@pytest.mark.parametrize(("power", "time"), [(1, 0), (-40, 3), (300, -8), (-333, 13)])
@pytest.mark.parametrize("scheme", [energy_preserving, milstein], ids=lambda scheme: scheme.name)
def test_a_step_in_other_units_is_the_same_step(scheme: Scheme, power: int, time: int) -> None:
    for _, case in SINGLE.cases(1)[::5]:
        other = in_other_units(case, power, time)
        (y, y1), (z, z1) = ((c.build()[1], ask(scheme, *c.build())) for c in (case, other))
        unit = np.max(np.abs(z)) / np.max(np.abs(y))
        assert np.log2(unit) % 1 == 0
        problem, _, h, dW = case.build()
        allowed = step_residual(problem, y, y1, h, dW)
        assert np.all((np.abs(z1 / unit - y1) <= allowed) | ~np.isfinite(y1))


def absolute(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """(2.1), but for a state smaller than an absolute tolerance."""
    return y if np.max(np.abs(y)) < 1e-12 else energy_preserving.step(problem, y, h, dW)


def test_a_number_with_a_unit_is_named_and_one_that_is_stated_is_not_asked_about() -> None:
    def found(**stated: float):  # type: ignore[no-untyped-def]
        scheme = Scheme("absolute", absolute, claims=["reference"], **stated)
        return verify(scheme, laws=["reference"], effort=Effort(examples=1, shrink_checks=30)).finding(
            "reference"
        )

    unstated, stated = found(), found(solver_tolerance=1e-12)
    assert unstated.verdict is Verdict.VIOLATED
    assert "a number of the scheme has a unit" in unstated.message
    assert stated.verdict is Verdict.HOLDS
    assert "was not asked of a solver with a tolerance" in stated.message
    assert stated.share is None


def test_a_state_of_extreme_size_may_be_refused_and_a_step_without_drift_may_fail() -> None:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        if h == 0:
            return y + np.nan
        if beyond(Case(energy_preserving, tuple(y))):  # type: ignore[arg-type]
            raise FloatingPointError("too far")
        return energy_preserving.step(problem, y, h, dW)

    found = verify(
        Scheme("near", step, claims=["energy"]), laws=["energy"], effort=Effort(examples=1)
    ).finding("energy")
    assert found.verdict is Verdict.HOLDS
    assert "a step with h = 0 ended in" in found.message
    assert "a step from a state larger or smaller than 2^±21 ended in Refusal" in found.message
