"""The space of cases: designs meet every possible pair, axes have open ends,
and cases lie where their row says.
"""

import math
import re
import time
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import Any

import doors
import numpy as np
import pytest
from doors import but_deep, command, says
from drawn import refusing
from sepv.properties import test_energy as energy
from sepv.properties._long_steps import for_energy, long_steps

from sepv import Skipped, problems, schemes
from sepv.faults.saboteurs import SABOTEURS
from sepv.law import corpus, search
from sepv.law.cases import case as cases
from sepv.law.cases.case import to_json
from sepv.law.cases.classes import CLASSES
from sepv.law.cases.clipped import PROBES
from sepv.law.cases.covering import pairwise, shown_pairs
from sepv.law.cases.ends import beyond, in_other_units
from sepv.law.cases.families import body
from sepv.law.cases.fixed_cases import fixed_cases
from sepv.law.cases.from_problem import is_near
from sepv.law.cases.random_parts import ALL_COMPONENTS_DIMENSION
from sepv.law.cases.shrink import shrunk
from sepv.law.cases.strata import EXTREME_SIZES, NEAR_REST, NO_STEP, NO_TIME, UNEVEN_NOISES, Levels, Space
from sepv.law.contraction import contraction_radius
from sepv.law.search import MOST_SKIPPED
from sepv.problem import Array, NamedProblem, PolynomialSystem, Problem, Systems, mechanics, vector_field
from sepv.problems.shown_to_schemes import WORDS_OF_VIEWS, shown
from sepv.schemes import Scheme, ask, energy_preserving, milstein
from sepv.verification import Case, Cases, Effort, Verdict, load_laws, replay, step_residual, verify
from sepv.verification import _coverage as coverage

KINDS = (Systems.SINGLE, Systems.NAMBU, Systems.SEVERAL, Systems.HAMILTONIANS)
SINGLE = Cases().space(Systems.SINGLE)
assert SINGLE is not None


def cases_of(law: str) -> Cases:
    (found,) = load_laws([law])
    assert found.cases is not None
    return found.cases


def space_of(kind: Systems, law: str) -> Space:
    space = cases_of(law).space(kind)
    assert space is not None
    return space


ALL = [(k, law.name) for law in load_laws() if law.cases for k in KINDS if law.cases.space(k) is not None]


# *invariant* speaks of problems that state functions, and random problems state none.
@pytest.mark.parametrize(("kind", "law"), [(kind, law) for kind, law in ALL if law != "invariant"])
@pytest.mark.parametrize("seed", but_deep([0, 3], 3))
def test_a_law_speaks_of_each_case_of_its_design_and_leaves_what_it_made_of_it(seed, kind, law):
    asked = cases_of(law)
    for _, case in space_of(kind, law).cases(seed):
        adapted = asked.adapted(case)
        assert adapted is not None, case.describe()
        assert asked.admits(adapted), case.describe()


@pytest.mark.parametrize(("kind", "law"), ALL)
def test_a_design_meets_every_pair_that_is_possible(kind: Systems, law: str) -> None:
    space = space_of(kind, law)
    design = space.design()
    met = {pair for row in design.rows for pair in space.shown(row)}
    levels = [(a, k) for a, axis in enumerate(space.axes) for k in range(len(axis.strata))]
    wanted = {(p, q) for p, q in combinations(levels, 2) if p[0] != q[0]}
    assert met | design.impossible == wanted
    assert not met & design.impossible
    assert all(space.impossible(pair) for pair in design.impossible)
    assert len(design.rows) <= 60


def test_beside_a_level_that_hides_only_its_own_pairs_are_met() -> None:
    hiding = frozenset({(1, 1)})
    assert shown_pairs((0, 0, 0), hiding) == [((0, 0), (1, 0)), ((0, 0), (2, 0)), ((1, 0), (2, 0))]
    assert shown_pairs((0, 1, 0), hiding) == [((0, 0), (1, 1)), ((1, 1), (2, 0))]
    design = pairwise([3, 2, 3], lambda _: True, hiding)
    assert {row[1] for row in design.rows} == {0, 1}
    assert not design.impossible


@pytest.mark.parametrize("seed", [0, 7])
def test_cases_lie_in_their_strata_and_inside_the_contraction_radius(seed: int) -> None:
    assert [wrong for row, case in SINGLE.cases(seed) for wrong in outside(SINGLE.levels(row), case)] == []


def outside(levels: Levels, case: Case) -> list[tuple[str, object, Case]]:
    """Of which axes a case is not in its strata."""
    system = case.problem
    assert isinstance(system, PolynomialSystem)
    problem, y, h, dW = case.build()
    length = abs(h) + float(np.abs(problem.c * dW).sum())
    measured = {
        "d": system.dimension,
        "degree of H": system.hamiltonian.degree,
        "terms of H": sum(any(e) for e, _ in system.hamiltonian.terms),
        "degree of B": max(e.degree for _, _, e in system.structure),
        "m": len(system.noise),
        "|y|": float(np.max(np.abs(y))),
        "|Δ|": abs(float(problem.random_step(h, dW))),
        "h": float(np.sign(h)),
        "step/radius": length / contraction_radius(problem, y),
    }
    # Units of time are powers of four, and |Δ| is a quarter of the parts' sum at least.
    ends = {axis: (s.low, s.high) for axis, s in levels.items()}
    for axis, s in levels.items():
        if s.end:
            ends[axis] += (s.end / 8, 2 * s.end) if isinstance(s.end, float) else (s.end,)
    if system.dimension > ALL_COMPONENTS_DIMENSION:
        del measured["terms of H"]
    slack = {"|y|": 1e-12, "|Δ|": 1e-12, "step/radius": 1e-3}
    found: list[tuple[str, object, Case]] = [
        (axis, value, case)
        for axis, value in measured.items()
        if max(min(ends[axis]) - value, value - max(ends[axis])) > slack.get(axis, 0.0) * abs(value)
    ]
    casimirs = len(system.casimirs) + len(system.linear_casimirs)
    if casimirs != {"none": 0, "two": 2}.get(levels["Casimirs"].name, 1):
        found.append(("Casimirs", casimirs, case))
    if case.given != levels["given as"].name:
        found.append(("given as", case.given, case))
    return found


def test_the_coverage_table_counts_what_the_designs_visit() -> None:
    shown = " ".join(command("verify energy-preserving --coverage --law energy").output.split())
    energy = space_of(Systems.SINGLE, "energy")
    design = energy.design()
    met, possible = coverage.pairs(energy)
    assert met == possible
    known = len(corpus.cases("energy", Systems.SINGLE))
    counts = f"energy {known} {len(design.rows)} {met} {possible} {len(design.impossible)}"
    for words in (counts, "10–40", "near ∇H = 0", "impossible, B of rank 2 at least"):
        assert words in shown


def test_another_seed_has_other_content_in_the_same_strata() -> None:
    first, second = SINGLE.cases(0), SINGLE.cases(1)
    assert [row for row, _ in first] == [row for row, _ in second]
    assert all(a != b for (_, a), (_, b) in zip(first, second, strict=True))


@pytest.mark.parametrize(
    ("kind", "law"),
    [(Systems.SINGLE, "reproducibility"), (Systems.NAMBU, "energy"), (Systems.SEVERAL, "energy")],
)
def test_a_token_keeps_how_a_case_is_given_and_its_batch(kind: Systems, law: str) -> None:
    for _, case in space_of(kind, law).cases(0):
        assert cases.from_token(cases.to_token(case)) == case


@pytest.mark.parametrize("kind", KINDS)
def test_bare_functions_say_nothing_of_themselves(kind: Systems) -> None:
    case = next(c for _, c in space_of(kind, "contract").cases(0) if c.given == "bare functions")
    whole, y, _, _ = case.build()
    seen = shown(whole)
    for name in ("data", "degree", "hessian", "structure_derivative", "mean_gradient"):
        assert getattr(seen, name) is None
    assert not getattr(seen, "noise_hessians", ())
    assert type(seen.gradient).__name__ == "function"
    assert seen.name != problems.build(case.problem).name
    for name in ("structure", "hamiltonian", "gradient"):
        assert np.array_equal(getattr(seen, name)(y), getattr(whole, name)(y))
    assert shown(problems.build(case.problem)).data is not None


def test_a_scheme_sees_the_problem_as_it_is_given() -> None:
    seen: list[Problem] = []

    def step(problem, y, h, dW):
        seen.append(problem)
        return y

    for given in WORDS_OF_VIEWS:
        ask(
            Scheme("looks", step),
            *Case(NamedProblem("rigid-body"), (1.0, 0.0, 0.0), 0.1, (0.0,), given).build(),
        )
    assert [p.data is None for p in seen] == [False, True, True]
    assert [p.degree for p in seen] == [2, 2, None]


def faulty(broken) -> Scheme:
    """(2.1), a ten-thousandth off where `broken(problem, y, h, dW)`."""

    def step(problem, y, h, dW):
        y1 = energy_preserving.step(problem, y, h, dW)
        return y1 * (1 + 1e-4) if broken(problem, y, h, dW) else y1

    return Scheme("faulty", step, ("energy",))


@pytest.mark.parametrize(
    "broken",
    [
        lambda p, _y, _h, _dW: p.noises >= 5 and p.dimension == 2,
        lambda _p, y, h, _dW: h < 0 and np.max(np.abs(y)) > 1e5,
        lambda _p, y, _h, _dW: 0 < np.max(np.abs(y)) < 1e-5,
    ],
)
def test_a_fault_of_a_pair_of_strata_is_found_and_its_counterexample_replays(broken) -> None:
    scheme = faulty(broken)
    finding = doors.finding(scheme, "energy", examples=1, shrink_checks=50)
    assert finding.verdict is Verdict.VIOLATED
    assert finding.witness is not None
    again = replay(scheme, "energy", cases.to_json(cases.from_json(finding.witness)))
    assert again.verdict is Verdict.VIOLATED


# Each factor of a design with a fault that shows in one of its strata alone, and what is left of a
# counterexample: (d, m, terms of H and B) are at most this.
FACTORS: dict[str, tuple[Any, tuple[int, int, int]]] = {
    "dimension": (lambda p, *_: p.dimension >= 8, (8, 0, 2)),
    "degree": (lambda p, *_: (p.degree or 0) >= 6, (2, 0, 2)),
    "noises": (lambda p, *_: p.noises >= 3, (2, 3, 2)),
    "step size": (lambda p, y, h, dW: 0 < abs(p.random_step(h, dW)) < 1e-4, (2, 0, 2)),
    "state size": (lambda p, y, h, dW: np.max(np.abs(y)) > 1e4, (2, 0, 2)),
    "structure": (lambda p, *_: bool(p.casimirs), (3, 0, 4)),
}


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("listed", [True, False])
def test_a_fault_of_each_factor_is_shown_in_a_small_case(factor, listed, monkeypatch) -> None:
    """Whether a listed case shows it or a random one: there is one way to simplify."""
    shows, (d, m, terms) = FACTORS[factor]
    if not listed:
        monkeypatch.setattr(search, "_visit", lambda _log, _scheme, visited, _question: list(visited))
    found = doors.finding(faulty(shows), "energy", examples=8 if listed else 200, corpus=False)
    assert found.verdict is Verdict.VIOLATED
    case = cases.from_json(found.witness)
    assert (len(case.y) <= max(d, 3), len(case.dW) <= max(m, 1)) == (True, True), case.describe()
    if isinstance(system := case.problem, PolynomialSystem):
        count = len(system.hamiltonian.terms) + sum(len(p.terms) for _, _, p in system.structure)
        assert (len(case.y) <= d, len(case.dW) <= m, count <= terms) == (True,) * 3, case.describe()
        numbers = [v for v in (*case.y, *case.dW) if v]
        assert all(float(f"{v:.1e}") == v or math.log2(abs(v)).is_integer() for v in numbers), numbers
    assert replay(faulty(shows), "energy", found.witness).verdict is Verdict.VIOLATED


def test_simplifying_ends_after_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "SIMPLIFY_MAX_SECONDS", 0.0)
    ended = doors.finding("milstein", "casimir", corpus=False)
    as_found = doors.finding("milstein", "casimir", corpus=False, shrink_checks=0)
    assert (ended.witness, ended.checks) == (as_found.witness, as_found.checks)


def test_only_the_state_and_the_step_of_a_users_problem_are_simplified() -> None:
    """They stay where its cases are drawn: the problem, its domain and its initial state are the
    user's.
    """
    for name in ("lotka-volterra", "pendulum"):
        found = doors.finding("midpoint", "energy", name, corpus=False)
        problem = problems.by_name(name)
        case = cases.from_json(found.witness)
        assert case.problem == problem.data
        assert is_near(case)
        assert sum(a != b for a, b in zip(case.y, problem.initial, strict=True)) <= 1, case.describe()


def test_a_familys_counterexample_stays_in_the_family_with_fewer_terms() -> None:
    def euler(problem, y, h, dW):
        return y + problem.random_step(h, dW) * vector_field(problem, y)

    found = doors.finding(euler, "energy", "canonical-separable")
    system = cases.from_json(found.witness).problem
    assert isinstance(system, PolynomialSystem)
    assert system.structure == problems.canonical(system.dimension)
    assert len(system.hamiltonian.terms) <= 2
    half = system.dimension // 2
    assert all(not any(e[:half]) or not any(e[half:]) for e, _ in system.hamiltonian.terms)


def test_a_counterexample_of_a_design_is_simplified() -> None:
    case = next(c for row, c in SINGLE.cases(0) if SINGLE.levels(row)["d"].name == "7–9")
    small = shrunk(case, lambda c: c.problem.dimension >= 4)
    system = small.problem
    assert isinstance(system, PolynomialSystem)
    assert (system.dimension, len(system.noise), small.given) == (4, 0, "data")
    assert len(system.hamiltonian.terms) == 1
    assert len(system.structure) == 1


def test_a_scheme_that_takes_nothing_is_asked_about_little() -> None:
    calls = []

    def step(problem, y, h, dW):
        calls.append(1)
        raise Skipped("never")

    says(Scheme("picky", step), "energy", "not applicable", "cases skipped: never")
    known, rows = corpus.cases("energy", Systems.SINGLE), space_of(Systems.SINGLE, "energy").design().rows
    fixed = len((*known, *rows, *fixed_cases(), *for_energy(), *SINGLE.kinds))
    # PROBES cases come before, to see whether the scheme clips increments; each search ends beyond
    # MOST_SKIPPED.
    assert fixed <= len(calls) <= fixed + 2 * (MOST_SKIPPED + 1) + PROBES


def test_who_takes_no_negative_h_is_accused_of_nothing() -> None:
    step = refusing(ValueError("math domain error"), lambda problem, y, h, dW: h < 0)
    words = "cases skipped: a step back in time, h < 0, ended in "
    found = says(Scheme("forward", step), "energy", "holds", words, examples=2)
    said = "the first: The scheme (refused the step by|raised) ValueError: math domain"
    assert re.search(said, found.message)
    assert len(found.message.splitlines()) == 1


def test_what_a_search_finds_does_not_depend_on_the_clock() -> None:
    found = []
    for pause in (0.0, 0.01):

        def step(problem, y, h, dW, pause=pause):
            time.sleep(pause)
            return milstein.step(problem, y, h, dW)

        finding = doors.finding(step, "symmetry", examples=5, shrink_checks=40)
        found.append((finding.verdict, finding.checks, finding.witness, finding.defect))
    assert found[0] == found[1]
    assert found[0][0] is Verdict.VIOLATED


def test_simplifying_ends_where_states_of_one_and_of_minus_one_both_fail() -> None:
    """Each was once taken for simpler than the other, until the budget was spent."""
    case = Case(body((1.0, 0.5, 0.25), (1.0, 0.0, 0.0, 0.0), (1.0,)), (-1.0, 1.0, -1.0), 0.0, (0.0,))
    asked: list[Case] = []

    def fails(candidate: Case) -> bool | None:
        asked.append(candidate)
        signs = len(candidate.y) == 3 and all(abs(v) == 1 for v in candidate.y)
        return None if len(asked) > 100 else signs

    assert shrunk(case, fails).y == (1.0, 1.0, 1.0)
    assert len(asked) < 60


def test_a_counterexample_is_simplified_with_so_many_checks_and_no_more() -> None:
    as_found, few, many = (
        doors.finding("milstein", "casimir", shrink_checks=n, corpus=False).checks for n in (0, 5, 50)
    )
    assert as_found < few <= as_found + 6 < many


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
        if name == NO_TIME.name:
            assert h == 0 < parts.max()
        elif name == NO_STEP.name:
            assert h > 0 == problem.random_step(h, dW)
        elif name == UNEVEN_NOISES.name and np.count_nonzero(problem.c) > 1:
            assert parts.max() > 10 * parts[problem.c > 0].min()
        elif name in (EXTREME_SIZES[0].name, EXTREME_SIZES[1].name):
            # The brackets of several Hamiltonians are products of three coefficients.
            assert abs(np.log10(np.abs(y).max())) > (90 if systems is Systems.SINGLE else 20)
        assert length(case) <= contraction_radius(problem, y)
        if systems is Systems.RIGID_BODIES:
            assert {abs(c) for _, _, p in case.problem.structure for _, c in p.terms} == {1.0}
    assert {NEAR_REST.name, EXTREME_SIZES[0].name} <= set(found) or systems not in (
        Systems.SINGLE,
        Systems.HAMILTONIANS,
    )


def test_rigid_bodies_have_products_of_inertia_and_every_size() -> None:
    cases = [case for _, case in CLASSES[Systems.RIGID_BODIES].space.part().cases(0)]
    full = [c for c in cases if any(sum(map(bool, e)) > 1 for e, _ in c.problem.hamiltonian.terms)]
    assert len(full) > len(cases) / 2
    for case in cases:
        inverse = np.linalg.inv(case.build()[0].hessian(np.array(case.y)))
        moments = np.sort(np.linalg.eigvalsh(inverse))
        assert 0 < moments[2] < moments[0] + moments[1]  # it is the tensor of a body
    sizes = [np.log10(1 / c.build()[0].hessian(np.array(c.y))[0, 0]) for c in full]
    assert min(sizes) < -4 < 4 < max(sizes)


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
    few = {"examples": 1, "shrink_checks": 30}
    says(own, "reference", "violated", "a number of the scheme has a unit", **few)
    stated, words = replace(own, solver_tolerance=1e-12), "was not asked of a solver with a tolerance"
    assert says(stated, "reference", "holds", words, **few).share is None


def test_a_state_of_extreme_size_may_be_refused_and_a_step_without_drift_may_fail() -> None:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        if h == 0:
            return y + np.nan
        if beyond(Case(energy_preserving, tuple(y))):
            raise FloatingPointError("too far")
        return energy_preserving.step(problem, y, h, dW)

    far = "a step from a state larger or smaller than 2^±21 ended in Refusal"
    own = Scheme("near", step, claims=["energy"])
    says(own, "energy", "holds", "a step with h = 0 ended in", far, examples=1)


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
    refuses = Scheme("refuses", refusing(ArithmeticError("too long")))

    def answer(case: Case) -> Verdict:
        return energy.law.replay(energy.law, refuses, to_json(case)).verdict

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


# A threshold with a unit, as libraries of particles have, is no fault of an integrator without
# noise.


def verlet(problem, y, h, dW, *, threshold):
    """Velocity Verlet that keeps the force where positions move by less than a threshold,
    as ASE's calculators do.
    """
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
    report = verify(scheme, laws="symmetry,reversibility", effort=Effort(shrink_checks=0))
    assert {finding.verdict.text for finding in report.findings} == {verdict}
