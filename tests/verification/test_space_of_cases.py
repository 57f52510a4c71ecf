"""The space of cases: designs meet every possible pair, cases lie where their row says, and they replay to the bit."""

import re
import time
from itertools import combinations

import doors
import numpy as np
import pytest
from doors import command

from sepv import problems
from sepv.errors import Skipped
from sepv.problem import NamedProblem, PolynomialSystem, Systems
from sepv.problem import Problem as ProblemRecord
from sepv.problems.shown_to_schemes import GIVEN, shown
from sepv.schemes import Scheme, ask, energy_preserving, milstein
from sepv.verification import Case, Cases, Verdict, load_laws, verify
from sepv.verification import _corpus as corpus
from sepv.verification import _coverage as coverage
from sepv.verification._cases import case as cases
from sepv.verification._cases.covering import pairwise, shown_pairs
from sepv.verification._cases.fixed_cases import fixed_cases, for_energy
from sepv.verification._cases.random_cases import MANY
from sepv.verification._cases.shrink import shrunk
from sepv.verification._cases.strata import Levels, Space
from sepv.verification._contraction import contraction_radius
from sepv.verification._search import MOST_SKIPPED
from sepv.verification._verify import replay

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


@pytest.mark.parametrize(("kind", "law"), ALL)
def test_a_law_speaks_of_each_case_of_its_design_and_leaves_what_it_made_of_it(kind, law):
    asked = cases_of(law)
    for seed in (0, 3):
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
    if system.dimension > MANY:
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
    seen: list[ProblemRecord] = []

    def step(problem, y, h, dW):
        seen.append(problem)
        return y

    for given in GIVEN:
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

    finding = verify(Scheme("picky", step), laws=["energy"]).finding("energy")
    assert finding.verdict is Verdict.NOT_APPLICABLE
    known, rows = corpus.cases("energy", Systems.SINGLE), space_of(Systems.SINGLE, "energy").design().rows
    fixed = len((*known, *rows, *fixed_cases(), *for_energy(), *SINGLE.kinds))
    assert fixed <= len(calls) <= fixed + 2 * MOST_SKIPPED
    assert "cases skipped: never" in finding.message


def test_who_takes_no_negative_h_is_accused_of_nothing() -> None:
    def step(problem, y, h, dW):
        if h < 0:
            raise ValueError("math domain error")
        return energy_preserving.step(problem, y, h, dW)

    finding = doors.finding(Scheme("forward", step), "energy", examples=2)
    assert finding.verdict is Verdict.HOLDS
    assert "cases skipped: a step back in time, h < 0, ended in " in finding.message
    said = "the first: The scheme (refused the step by|raised) ValueError: math domain"
    assert re.search(said, finding.message)
    assert len(finding.message.splitlines()) == 1


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
    case = Case(problems.rigid_body().data, (-1.0, 1.0, -1.0), 0.125, (0.25,))
    asked: list[Case] = []

    def fails(candidate: Case) -> bool | None:
        asked.append(candidate)
        return None if len(asked) > 100 else all(abs(v) == 1 for v in candidate.y)

    assert shrunk(case, fails).y == (1.0, 1.0, 1.0)
    assert len(asked) < 20


def test_a_counterexample_is_simplified_with_so_many_checks_and_no_more() -> None:
    as_found, few, many = (
        doors.finding("milstein", "casimir", examples=1, shrink_checks=n).checks for n in (0, 5, 50)
    )
    assert as_found < few <= as_found + 6 < many
