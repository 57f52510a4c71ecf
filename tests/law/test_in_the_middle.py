"""Laws about a step are asked of steps in the middle of a path;
orders of methods with memory are those of paths.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from doors import but_deep, doc, finding, measured, obeys, says, verdicts
from sepv.properties._orders.without_noise import path_errors

import sepv
from benchmarks.law_pages import middles
from benchmarks.right_schemes import RIGHT_SCHEMES
from benchmarks.right_schemes.with_memory import SCHEMES_WITH_MEMORY
from sepv import Scheme, StatefulStep, problems, schemes
from sepv.faults.saboteurs import SABOTEURS
from sepv.law.middle import STEPS_BEFORE, anywhere
from sepv.law.tolerance import step_residual
from sepv.problem import Array, Problem
from sepv.schemes import energy_preserving, has_memory, resumed, several
from sepv.verification import Case, Effort, Measurement, Middle, load_laws, replay, require, searched

ORDER, SYMMETRY = "deterministic-order", "symmetry"
LEAST: dict[str, Any] = {"examples": 1, "shrink_checks": 60}


def test_the_growth_of_residuals_over_the_steps_of_a_path_is_bounded() -> None:
    kappa = 0.25
    for n in range(2, 65):
        grown = ((1 + kappa / n) / (1 - kappa / n)) ** n / (1 - kappa / n)
        assert grown <= np.exp(2 * kappa) / (1 - kappa)
    problem, y = problems.rigid_body(), np.array([0.8, 0.6, 0.0])
    one, eight = (
        step_residual(problem, y, y, 0.1, np.zeros(1), scheme)
        for scheme in (energy_preserving, several(energy_preserving, 8))
    )
    np.testing.assert_allclose(eight, 8 * np.exp(2 * kappa) * one)


def test_several_steps_as_one_and_a_resumed_step_are_those_of_a_path() -> None:
    scheme, problem = RIGHT_SCHEMES["reversible-heun"], problems.rigid_body()
    h, dW = 0.25, np.array([0.5])
    path = sepv.integrate(scheme, problem, h=h / 4, steps=4, dW=np.repeat(dW[None] / 4, 4, axis=0)).y
    np.testing.assert_array_equal(several(scheme, 4).step(problem, path[:, 0], h, dW), path[:, 4])
    assert isinstance(scheme.step, StatefulStep)
    state = scheme.step.init(problem, path[:, 0])
    for n in range(4):
        answer = resumed(scheme, state).step(problem, path[:, n], h / 4, dW / 4)
        np.testing.assert_array_equal(answer, path[:, n + 1])
        state = scheme.step.step(problem, state, h / 4, dW / 4)


@pytest.mark.parametrize("middle", [Middle.STEPS, Middle.MAP])
def test_a_step_in_the_middle_stays_in_the_ball_of_the_case(middle: Middle) -> None:
    """All steps of a path are together as long as the step of the case."""
    seen: list[Case] = []

    def check(scheme: Scheme, case: Case) -> Any:
        seen.append(case)
        return Measurement(0.0, 1.0)

    case = Case(problems.rigid_body().data, (0.8, 0.6, 0.0), 0.5, (0.25,), after=7)
    anywhere(middle, check)(RIGHT_SCHEMES["compensated"], case)
    assert len(seen) == (8 if middle is Middle.STEPS else 1)
    assert sum(c.h for c in seen) == 0.5
    assert sum(abs(c.dW[0]) for c in seen) <= 0.25
    assert not any(c.after for c in seen)


OF_PATHS = [s.name for s in SCHEMES_WITH_MEMORY if s.order]
# One of each kind: two steps, a force that is kept, paths as a whole.
EVERY_RUN = ("explicit-midpoint", "stored-force", "adams-bashforth-2-by-paths")


@pytest.mark.parametrize("name", but_deep(OF_PATHS, *(name for name in OF_PATHS if name not in EVERY_RUN)))
def test_orders_of_methods_with_memory_are_those_at_a_fixed_time(name: str) -> None:
    scheme = next(s for s in SCHEMES_WITH_MEMORY if s.name == name)
    found = says(
        scheme, ORDER, "holds", "order 2: the error of a path, divided by its number of steps, is h^3.00"
    )
    assert found.witness is not None
    assert {m["order"] for m in found.witness["measured"]} == {2}
    # A higher order is not proved.
    says(replace(scheme, order=3.0), ORDER, "violated", "order 3 claimed, 2 found")


def test_the_error_of_two_steps_started_by_euler_falls_by_four_and_that_of_its_first_step_too() -> None:
    errors = path_errors(RIGHT_SCHEMES["adams-bashforth-2"], problems.rigid_body(noise=()))
    at_the_end = errors.errors * 2.0 ** np.arange(10)
    np.testing.assert_allclose(at_the_end[:, 7] / at_the_end[:, 8], 4, rtol=0.05)
    assert verdicts(RIGHT_SCHEMES["adams-bashforth-2"], "local-mean") == {"local-mean": "not applicable"}


@pytest.mark.parametrize(
    "name",
    but_deep(
        ["adams-bashforth-2-by-paths", "explicit-midpoint", "stored-force-reversed"],
        "explicit-midpoint", "stored-force-reversed",
    ),
)  # fmt: skip
def test_what_methods_with_memory_claim_holds(name: str) -> None:
    laws = RIGHT_SCHEMES[name].claims - {"long-time-energy", "reproducibility"} | {"contract"}
    found = measured(RIGHT_SCHEMES[name], sorted(laws), examples=1)
    assert {f.law: f.verdict.text for f in found.findings} == dict.fromkeys(laws, "holds"), found.findings


def test_a_violation_in_the_middle_names_the_step_and_is_replayed() -> None:
    scheme = SABOTEURS["off-the-middle-later"].scheme
    found = says(scheme, "casimir", "violated", "step 5 of a path", "as 5 steps of a path", **LEAST)
    assert found.witness is not None
    obeys(found.witness, "witness", {"after": -1}, {"after": "7"})
    assert 0 < found.witness["after"] <= max(STEPS_BEFORE)
    again = replay(scheme, "casimir", found.witness)
    assert (again.verdict, again.defect) == (found.verdict, found.defect)
    assert "step 5 of a path" in again.message
    # The right scheme passes the same case, with a state and without one.
    for right in (RIGHT_SCHEMES["compensated"], energy_preserving):
        assert replay(right, "casimir", found.witness).verdict.text == "holds"


def test_a_path_that_stands_still_after_its_first_step_has_no_order() -> None:
    stands = replace(SABOTEURS["leapfrog-once"].scheme, mean_square_order=None, weak_order=None)
    says(stands, ORDER, "violated", "order 2 claimed, 0 found", "the first step of a path has the order")


def test_init_gets_the_step_size_if_it_has_a_third_argument() -> None:
    seen: list[tuple[float, ...]] = []

    def step(problem: Problem, state: Any, h: float, dW: Array) -> Any:
        return state

    def with_size(problem: Problem, y: Array, h: float) -> Array:
        seen.append((h,))
        return y.copy()

    def with_option(problem: Problem, y: Array, steps: int = 3) -> Array:
        seen.append((steps,))
        return y.copy()

    for init in (with_size, with_option, lambda problem, y: y.copy()):
        scheme = Scheme("still", StatefulStep(init, step, lambda state: state))
        sepv.integrate(scheme, "rigid-body", h=0.25, steps=3)
        sepv.ensemble(scheme, "rigid-body", h=0.125, steps=3, paths=2)
    assert set(seen) == {(0.25,), (0.125,), (3,)}


def two_steps(reverse: Any) -> Scheme:
    rule = RIGHT_SCHEMES["explicit-midpoint"].step
    assert isinstance(rule, StatefulStep)
    return replace(RIGHT_SCHEMES["explicit-midpoint"], step=replace(rule, reverse=reverse))


def test_a_path_goes_back_by_the_reversed_state_alone() -> None:
    without = finding(two_steps(None), SYMMETRY, **LEAST)
    assert without.verdict.text == "not applicable"
    assert without.message == REMEMBERS
    assert measured(two_steps(None), f"contract,{SYMMETRY}", **LEAST).exit_code == 0
    says(two_steps(lambda state: state), SYMMETRY, "violated", **LEAST)
    says(two_steps(lambda s: (-s[0], *s[1:])), SYMMETRY, "not applicable", "changes signs of y", **LEAST)
    says(two_steps(lambda s: (1.5 * s[0], *s[1:])), SYMMETRY, "error", "at the y of the state", **LEAST)


REMEMBERS = "a path depends on more than y: StatefulStep(…, reverse=…) says how it goes back"


@pytest.mark.parametrize(
    ("scheme", "law"),
    [
        # It stands still after its first step, and returns from nowhere but from rest.
        (SABOTEURS["midpoint-once"].scheme, SYMMETRY),
        # A fifth to a quarter of the cases are at rest or have tiny steps, and showed a return.
        (replace(RIGHT_SCHEMES["reversible-heun"], systems="mechanical"), SYMMETRY),
        (RIGHT_SCHEMES["reversible-heun"], "reversibility"),
        # Roundings hid its memory where y is large and H small: it was accused there.
        (RIGHT_SCHEMES["adams-bashforth-2-started-back"], SYMMETRY),
    ],
)
def test_one_case_with_a_memory_tells_that_no_case_shows_how_a_path_goes_back(
    scheme: Scheme, law: str
) -> None:
    found = finding(scheme, law)
    assert (found.verdict.text, found.message, found.checks) == ("not applicable", REMEMBERS, 0)


def test_a_memory_that_only_a_case_shows_is_told_at_its_replay_too() -> None:
    euler = replace(RIGHT_SCHEMES["adams-bashforth-2-started-back"], step=schemes.by_name("euler-heun").step)
    wrong = finding(euler, SYMMETRY, **LEAST)
    assert wrong.witness is not None
    assert wrong.verdict.text == "violated"
    again = replay(RIGHT_SCHEMES["adams-bashforth-2-started-back"], SYMMETRY, wrong.witness)
    assert (again.verdict.text, again.message) == ("not applicable", REMEMBERS)


def test_a_path_without_memory_that_does_not_return_is_a_violation() -> None:
    """A state that is y alone, beside a number of steps that nothing reads."""

    def step(problem: Problem, state: Any, h: float, dW: Array) -> Any:
        return schemes.by_name("explicit-4").step(problem, state[0], h, dW), state[1] + 1

    rule = StatefulStep(lambda _, y: (y.copy(), 0), step, lambda state: state[0])
    laws = {SYMMETRY: "violated", "reversibility": "violated"}
    assert verdicts(Scheme("counted", rule), list(laws), **LEAST) == laws


def test_a_stored_force_goes_back_without_a_reversed_state_and_a_late_one_does_not() -> None:
    laws = f"{SYMMETRY},reversibility"
    assert set(verdicts(RIGHT_SCHEMES["stored-force"], laws, **LEAST).values()) == {"holds"}
    late = SABOTEURS["late-force"].scheme
    assert set(verdicts(late, laws, **LEAST).values()) == {"violated"}


def test_each_law_says_how_it_is_asked_in_the_middle_and_the_page_prints_it() -> None:
    for law in load_laws():
        assert isinstance(law.middle, Middle) or len(law.middle.split()) > 4
    assert middles() in doc("adapting.md")
    first_steps = {law.name for law in load_laws() if isinstance(law.middle, str)}
    assert {"identity", "expansion"} <= first_steps
    assert not any(_later("identity"))
    assert any(_later("energy"))
    assert any(_later("noise-sum"))


def _later(name: str) -> list[bool]:
    """For each measurement of a law, if it is of later steps than the first one of a path."""
    later: list[bool] = []
    (law,) = load_laws([name])
    assert law.cases is not None

    def step(problem: Problem, state: Any, h: float, dW: Array) -> Any:
        return energy_preserving.step(problem, state, h, dW)

    scheme = Scheme("kept", StatefulStep(lambda _, y: y.copy(), step, lambda state: state))
    assert has_memory(scheme)

    def check(asked: Scheme, _: Case) -> Measurement:
        later.append(asked is not scheme)
        return Measurement(0.0, 1.0)

    own = searched(
        name=name, statement="", source="", unit="", check=check, cases=law.cases, middle=law.middle
    )
    require(own, scheme, Effort(examples=1))
    return later
