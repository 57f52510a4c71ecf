"""The hard cases end in a solution within its bound, or in a refusal that says which."""

import json
from dataclasses import replace

import numpy as np
import pytest
from doors import command, obeys
from drawn import refusing

from sepv import Problem, Scheme, StepFailure, hard_cases, schemes
from sepv.core.newton import Status
from sepv.core.step import Solution
from sepv.studies._hard_cases import Seen, run
from sepv.verification import LAWS


@pytest.mark.parametrize("case", hard_cases.CATALOGUE, ids=lambda c: c.name)
def test_every_case_says_why_it_is_hard_and_what_is_expected(case: hard_cases.HardCase) -> None:
    assert hard_cases.by_name(case.name.replace("-", "_")) is case  # so that no name stands twice
    assert case.reason
    assert case.expected
    assert set(case.refusals) <= {s.name for s in Status} - {"CONVERGED"}
    assert set(case.laws) <= set(LAWS)
    sample = case.sample(np.random.default_rng(0), 7)
    assert sample.y.shape == (case.problem.dimension, 7)
    assert sample.dW.shape == (case.problem.noises, 7)
    assert np.isfinite(sample.y).all()
    assert case.problem.domain is None or case.problem.domain(sample.y).all()


@pytest.mark.parametrize("case", hard_cases.CATALOGUE, ids=lambda c: c.name)
def test_the_energy_preserving_scheme_solves_to_its_bound_or_refuses(case: hard_cases.HardCase) -> None:
    (seen,) = run(schemes.energy_preserving, [case], steps=300, laws=2)
    assert seen.as_expected, f"{seen.statuses} {seen.wrong} {seen.laws} {seen.worst}"
    assert sum(seen.statuses.values()) == seen.steps == 300
    assert seen.solved == seen.defects.size
    assert seen.ratio <= 1


@pytest.mark.parametrize(
    "scheme", [schemes.midpoint, schemes.discrete_gradient, schemes.collocation(2)], ids=lambda s: s.name
)
def test_the_other_implicit_schemes_leave_nothing_unmarked(scheme) -> None:
    # Stages may lie higher up the walls of the Toda chain than y0 and y1, where the bound looks.
    cases = [c for c in hard_cases.CATALOGUE if scheme.stages == 1 or c.name != "toda-steep"]
    for seen in run(scheme, cases, steps=60, laws=0):
        assert not seen.wrong, f"{seen.case.name}: {seen.wrong}, {seen.worst}"
        assert sum(seen.statuses.values()) == 60


def broken(change) -> list[Seen]:
    """The catalogue's quiet cases, their solutions changed behind the solver's back."""

    def solve(problem: Problem, y, h, dW) -> Solution:
        return change(schemes.energy_preserving.solve(problem, y, h, dW))

    scheme = replace(schemes.energy_preserving, solve=solve)
    return run(scheme, [hard_cases.by_name(n) for n in ("henon-heiles", "huge-constant")], steps=50, laws=0)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda s: replace(s, value=np.where(s.value > 0.1, np.nan, s.value)), "not finite"),
        (lambda s: replace(s, value=s.value * (1 + 1e-12)), "beyond the bound"),
        (lambda s: replace(s, residual=s.residual + 1e-12), "residual beyond the bound"),
    ],
)
def test_values_that_pass_for_solutions_are_counted(change, word: str) -> None:
    for seen in broken(change):
        assert seen.wrong.get(word, 0) > 0
        assert not seen.as_expected
        assert seen.worst is not None


def test_refusals_that_a_case_does_not_allow_are_not_as_expected() -> None:
    (seen, _) = broken(lambda s: replace(s, status=np.full_like(s.status, Status.OVERFLOW)))
    assert seen.statuses == {"OVERFLOW": 50}
    assert not seen.as_expected


def test_collocation_solves_where_the_argument_of_the_sine_is_rounded() -> None:
    for name in ("pendulum-far-angles", "pendulum-separatrix"):
        (seen,) = run(schemes.collocation(2), [hard_cases.by_name(name)], steps=60, laws=0)
        assert seen.solved == 60


def test_a_third_party_step_is_run_state_by_state() -> None:
    def step(problem, y, h, dW):
        if y[0] > 1:
            raise StepFailure(problem="p", y=y, delta=h, residual=1.0, status="gave up", iterations=1)
        if y[0] < -1:
            raise RuntimeError("out of order")
        return y.copy()

    (seen,) = run(Scheme("mine", step), [hard_cases.by_name("rank-0")], steps=60, laws=0)
    assert set(seen.statuses) == {"CONVERGED", "REFUSED", "CRASH"}
    assert sum(seen.statuses.values()) == 60
    assert not seen.as_expected
    # With a step that shows it.
    assert seen.worst is not None
    assert abs(seen.worst.y[0]) > 1


@pytest.mark.parametrize(("name", "right"), [("overflowing-energy", True), ("rank-0", False)])
def test_a_refusal_without_a_status_is_right_where_the_case_allows_one(name: str, right: bool) -> None:
    scheme = Scheme("mine", refusing(StepFailure("no convergence")))
    (seen,) = run(scheme, [hard_cases.by_name(name)], steps=4, laws=0)
    assert seen.statuses == {"REFUSED": 4}
    assert seen.as_expected == right
    assert (seen.worst is None) == right


def test_the_command_shows_the_table_and_writes_json(tmp_path) -> None:
    out = tmp_path / "hard.json"
    shown = command(f"hard --case rank-0 --case mixed-scales --steps 20 --json {out}").output
    for word in ("rank-0", "20 solved", "0 not finite", "2 cases as expected"):
        assert word in shown
    report = json.loads(out.read_text())
    unbounded = {"cases": [report["cases"][0] | {"largest_defect_over_bound": None}]}
    obeys(report, "hard", {"seed": -1}, unbounded, {"more": 1})
    assert len(report["cases"][1]["worst"]["y"]) > 1
    assert [c["case"] for c in report["cases"]] == ["rank-0", "mixed-scales"]
    assert all(c["statuses"] == {"CONVERGED": 20} for c in report["cases"])


def test_the_command_explains() -> None:
    explained = command("hard --explain").output
    assert not [case.name for case in hard_cases.CATALOGUE if case.name not in explained]


@pytest.mark.deep
def test_a_million_steps() -> None:
    found = run(schemes.energy_preserving, steps=1_000_000 // len(hard_cases.CATALOGUE) + 1, laws=50, seed=1)
    assert sum(s.steps for s in found) >= 1_000_000
    assert all(s.as_expected for s in found)
