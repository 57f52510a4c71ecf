"""Cases that no seed may miss, and axes with open ends: sizes far beyond the usual ones, steps where little moves."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from doors import finding
from sepv.properties import test_energy as energy
from sepv.reference.faults.saboteurs import SABOTEURS

from sepv import Scheme, problems, schemes
from sepv.problem import Array, PolynomialSystem, Problem, Systems, mechanics
from sepv.schemes import ask, energy_preserving, milstein
from sepv.verification import Case, Cases, Verdict, verify
from sepv.verification._cases.case import to_json
from sepv.verification._cases.classes import CLASSES
from sepv.verification._cases.ends import beyond, in_other_units
from sepv.verification._cases.fixed_cases import fixed_cases, for_energy, long_steps
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
    own = Scheme("absolute", absolute, claims=["reference"])
    unstated, stated = (
        finding(scheme, "reference", examples=1, shrink_checks=30)
        for scheme in (own, replace(own, solver_tolerance=1e-12))
    )
    assert unstated.verdict is Verdict.VIOLATED
    assert "a number of the scheme has a unit" in unstated.message
    assert stated.verdict is Verdict.HOLDS
    assert "was not asked of a solver with a tolerance" in stated.message
    assert stated.share is None


def test_a_state_of_extreme_size_may_be_refused_and_a_step_without_drift_may_fail() -> None:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        if h == 0:
            return y + np.nan
        if beyond(Case(energy_preserving, tuple(y))):
            raise FloatingPointError("too far")
        return energy_preserving.step(problem, y, h, dW)

    found = finding(Scheme("near", step, claims=["energy"]), "energy", examples=1)
    assert found.verdict is Verdict.HOLDS
    assert "a step with h = 0 ended in" in found.message
    assert "a step from a state larger or smaller than 2^±21 ended in Refusal" in found.message


@pytest.mark.parametrize("name", schemes.PAPER)
def test_every_scheme_solves_every_corner(name: str) -> None:
    for case in fixed_cases():
        assert np.isfinite(schemes.PAPER[name].step(*case.build())).all(), case.describe()


def test_each_degree_has_a_step_that_shows_a_node_too_few() -> None:
    short, six, degrees = SABOTEURS["one-node-short"].scheme, SABOTEURS["six-nodes"].scheme, set()
    for case in set(for_energy()) - set(long_steps()):
        problem = problems.build(case.problem)
        saboteur, least = (short, 1e3) if problem.degree <= 14 else (six, 1e2)
        assert case.given == "bare functions" or energy.check(saboteur, case).ratio > least, case.describe()
        assert energy.check(schemes.energy_preserving, case).ratio < 0.1
        degrees.add(problem.degree)
    assert degrees == {*range(3, 11), 12, 14, 16, 17, 20}


def test_long_steps_are_solved_or_refused_but_not_returned_unsolved() -> None:
    def refuse(problem, y, h, dW):
        raise ArithmeticError("too long")

    def answer(case: Case) -> Verdict:
        return energy.law.replay(energy.law, Scheme("refuses", refuse), to_json(case)).verdict

    for case in long_steps():
        assert energy.check(schemes.energy_preserving, case).ratio < 0.1
        assert answer(case) is Verdict.NOT_APPLICABLE
        assert energy.check(SABOTEURS["newton-thrice"].scheme, case).violates
    assert answer(fixed_cases()[0]) is Verdict.ERROR


def test_polynomial_corners_lie_inside_the_contraction_radius() -> None:
    inside = [c for c in fixed_cases() if isinstance(c.problem, PolynomialSystem)]
    assert len(inside) >= 8
    for case in inside:
        problem, y, h, dW = case.build()
        assert h + float(np.sum(np.abs(problem.c * dW))) <= contraction_radius(problem, y)


# A threshold with a unit, as libraries of particles have, is no fault of an integrator without noise.


def verlet(problem, y, h, dW, *, threshold):
    """Velocity Verlet that keeps the force where positions move by less than a threshold, as ASE's calculators do."""
    system = mechanics(problem)
    q, p = system.split(y)
    force = system.force(q)
    p = p + h / 2 * force
    moved = q + h * system.velocity(p)
    if not np.allclose(moved, q, rtol=1e-15, atol=threshold):
        force = system.force(moved)
    return system.join(moved, p + h / 2 * force)


@pytest.mark.parametrize(("threshold", "verdict"), [(1e-15, "holds"), (1e-6, "violated")])
def test_a_threshold_is_found_where_usual_states_meet_it_alone(threshold, verdict):
    step = partial(verlet, threshold=threshold)
    scheme = Scheme("verlet", step, claims=["symmetry"], order=2, systems="mechanical")
    report = verify(scheme, laws="symmetry,reversibility")
    assert {finding.verdict.text for finding in report.findings} == {verdict}
