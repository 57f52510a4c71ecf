"""Advice beside a violation names its cause: faults of real programs in small schemes;
right schemes get none.
"""

import json
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from doors import Reader, command

import sepv
from sepv import Effort, Scheme, StatefulStep, problems, schemes
from sepv.law import first_order
from sepv.law.advice import advice, is_explicit
from sepv.law.cases.ends import in_other_units
from sepv.law.cases.shrink import shrunk
from sepv.law.cases.users_problems import items
from sepv.law.power_of_h import power_of_h, words
from sepv.law.search import _Question, _simplify
from sepv.law.search_log import SearchLog
from sepv.problem import Array, PolynomialSystem, Problem, vector_field
from sepv.record import poly
from sepv.verification import Case, Cases, Measurement, load_laws, verify


def factor(problem: Problem, y: Array, *shares: float) -> Array:
    """The factors of the components of y (d,) or (d, M)."""
    return np.reshape(shares, (-1, *(1,) * (y.ndim - 1)))


def heun(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    delta = problem.random_step(h, dW)
    f = vector_field(problem, y)
    return y + 0.5 * delta * (f + vector_field(problem, y + delta * f))


def half_kick(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return y + problem.random_step(h, dW) * vector_field(problem, y) * factor(problem, y, 0.5, 1.0)


def wrong_torque(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return y + problem.random_step(h, dW) * vector_field(problem, y) * factor(problem, y, 1.0, -1.0, 1.0)


def drift_twice(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return heun(problem, y, 2 * h, dW)


def noise_times_root_h(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return heun(problem, y, h, np.sqrt(abs(h)) * dW)


def without_correction(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return y + problem.random_step(h, dW) * vector_field(problem, y)


def offset(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return heun(problem, y, h, dW) + 1e-3


FAULTS = [
    (half_kick, "pendulum", "as h → 0 p moves by 0.50 of h f, q by 1.00"),
    (half_kick, "pendulum", "as h → 0 p moves by 0.50 of c1 ΔW1 f1, q by 1.00"),
    (wrong_torque, "rigid-body", "as h → 0 y1 moves by 1.00 of h f, y2 by -1.00, y3 by 1.00"),
    (drift_twice, "rigid-body", "as h → 0 y moves by 2.00 of h f"),
    (noise_times_root_h, "pendulum", "as h → 0 the share of c1 ΔW1 f1 by which y moves is like h^0.50"),
    (without_correction, "rigid-body", "the mean of y1 has 0.00 of Itô's correction"),
    (offset, "pendulum", "y1 − y0 does not vanish with h and ΔW"),
]


@pytest.mark.parametrize(("step", "problem", "line"), FAULTS, ids=lambda v: getattr(v, "__name__", None))
def test_the_response_of_a_step_names_the_cause(step, problem: str, line: str) -> None:
    lines = first_order(Scheme("faulty", step), problems.by_name(problem))
    assert any(said.startswith(line) for said in lines), lines


@pytest.mark.parametrize("problem", [*problems.PAPER])
@pytest.mark.parametrize("scheme", [*schemes.PAPER])
def test_the_response_of_a_right_step_is_the_field(scheme: str, problem: str) -> None:
    """Euler-Maruyama has Itô's drift, which is another drift and the right limit."""
    assert first_order(schemes.by_name(scheme), problems.by_name(problem)) == []


@pytest.mark.parametrize(
    ("scheme", "problem"),
    [
        ("stochastic-midpoint", "noisy-henon-heiles"), ("area-midpoint", "two-spins"), ("conformal", "damped-top"),
        ("several-structures", "commuting-rotations"), ("drift-preserving", "pushed-rigid-body"),
        ("leapfrog", "kepler"), ("darboux-lie", "random-lotka-volterra"), ("collocation-3", "toda"),
    ],
)  # fmt: skip
def test_of_other_classes_too(scheme: str, problem: str) -> None:
    assert first_order(schemes.by_name(scheme), problems.by_name(problem)) == []


def test_the_line_stands_beside_order_zero_and_the_limit_and_no_tolerance_is_advised() -> None:
    faulty = Scheme("half a kick", half_kick, claims=["deterministic-order"])
    report = verify(
        faulty, laws="deterministic-order,right-limit", problems="pendulum", effort=Effort(paths=128)
    )
    for law in ("deterministic-order", "right-limit"):
        message = report.finding(law).message
        assert "as h → 0 p moves by 0.50 of h f, q by 1.00" in message
        assert "solver_tolerance" not in message
    assert "order 0 is no convergence" in report.finding("deterministic-order").message


def test_a_first_step_that_is_right_and_later_ones_that_are_not_are_told_apart() -> None:
    def step(problem: Problem, state: tuple[int, Array], h: float, dW: Array) -> tuple[int, Array]:
        n, y = state
        return n + 1, heun(problem, y, h, dW) if n == 0 else y + 0.25 * (heun(problem, y, h, dW) - y)

    kept = Scheme(
        "later steps are short", StatefulStep(lambda _, y: (0, y.copy()), step, lambda state: state[1])
    )
    (line, *_) = first_order(kept, problems.pendulum())
    assert line == "the first step is right, later ones are not; step 8: as h → 0 y moves by 0.25 of h f"


def test_an_explicit_step_is_told_from_an_iteration() -> None:
    problem = problems.rigid_body()
    at = problem, np.array(problem.initial), 0.25, np.zeros(1)

    def iterated(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        z, delta = np.zeros_like(y), problem.random_step(h, dW)
        for _ in range(100):
            new = delta * vector_field(problem, y + 0.5 * z)
            if np.abs(new - z).max() < 1e-9:
                break
            z = new
        return y + z

    assert is_explicit(Scheme("heun", heun), *at)
    assert not is_explicit(Scheme("iterated", iterated), *at)
    assert not is_explicit(Scheme("a program of its own", lambda problem, y, h, dW: 1.0 * y), *at)


def powers(step, law: str) -> float | None:
    return verify(Scheme("near", step), laws=law).finding(law).power


def test_the_power_of_h_with_which_a_defect_falls_stands_beside_it() -> None:
    """The midpoint rule moves H by Δ³ = O(h^{3/2}); Heun's method has a defect Δ⁴ of quadratic
    Casimirs, O(h²).
    """
    assert powers(schemes.midpoint.step, "energy") == pytest.approx(1.5, abs=0.1)
    report = verify(Scheme("heun", heun), laws="casimir,poisson-map:constant")
    for law in ("casimir", "poisson-map:constant"):
        finding = report.finding(law)
        assert finding.power == pytest.approx(2.0, abs=0.1)
        assert "the defect falls like h^2 (h halved, ΔW ~ √h)" in finding.message
        assert next(f for f in report.to_json()["laws"] if f["law"] == law)["power"] == finding.power
    held = verify("energy-preserving", laws="energy").finding("energy")
    assert held.power is None
    assert "falls" not in held.message


def test_a_power_is_not_named_where_none_is_clear() -> None:
    case, start = Case(problems.pendulum().data, (0.5, 0.5), 0.5, (0.25, 0.0)), Measurement(1e12, 1.0)

    def again(defect):
        return lambda case: Measurement(defect(case.h), 1.0)

    numbers = count()
    assert power_of_h(case, start, again(lambda h: 8e12 * h**3)) == pytest.approx(3.0)
    assert power_of_h(case, start, again(lambda h: 1e12)) == 0
    assert power_of_h(case, start, again(lambda h: 1e12 * 2.0 ** (-(next(numbers) ** 2) / 4))) is None
    assert power_of_h(case, start, lambda _: None) is None
    assert power_of_h(case, Measurement(3.0, 1.0), again(lambda h: 3.0 * h)) is None  # at once near its bound
    assert words(None) == "with which power of h the defect falls is not clear"
    assert words(0.01) == "the defect does not fall with h"
    assert words(-1.0) == "the defect grows like h^-1 (h halved, ΔW ~ √h)"
    assert words(1.73) == "the defect falls like h^1.7 (h halved, ΔW ~ √h)"


def test_where_equal_bits_are_asked_no_part_of_the_step_is_looked_for() -> None:
    """The defect is one of roundings there, and each part costs a measurement of a batch of
    thousands of states.
    """
    (law,), asked = load_laws(["reproducibility"]), list[Case]()
    case = Case(problems.rigid_body().data, (0.8, 0.6, 0.1), 0.125, (0.25,))

    def again(other: Case) -> Measurement:
        asked.append(other)
        return Measurement(1.0, 0.0)

    assert advice(law, schemes.midpoint, case, Measurement(1.0, 0.0), 1.0, again) == ""
    assert asked == [case]
    advice(law, schemes.midpoint, case, Measurement(1.0, 0.5), 1.0, again)
    assert len(asked) > 3


def test_a_counter_is_called_memory_and_no_fault_of_arrays_records_or_units() -> None:
    """A step that is wrong by an ulp in every n-th call, for several n."""
    for period in (2, 3, 5, 7, 11):
        calls = count(1)

        def step(problem: Problem, y: Array, h: float, dW: Array, calls=calls, period=period) -> Array:
            return heun(problem, y, h, dW) * (1 + 2.0**-40 * (next(calls) % period == 0))

        finding = verify(Scheme("counts", step), laws="contract").finding("contract")
        assert finding.verdict is sepv.Verdict.VIOLATED
        assert "counter" in finding.message
        for wrong in ("id(y)", "threshold", "another may have it later", "ascontiguousarray"):
            assert wrong not in finding.message, (period, finding.message)


def test_an_array_that_is_recognised_as_an_object_is_still_named() -> None:
    last: dict[str, object] = {}

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        if last.get("y") is not y:
            last.update(y=y, f=vector_field(problem, y))
        return y + problem.random_step(h, dW) * last["f"]

    message = verify(Scheme("by identity", step), laws="contract").finding("contract").message
    assert "recognise arguments by their numbers" in message
    assert "counter" not in message


def test_init_that_remembers_an_earlier_run_is_named() -> None:
    runs = count()

    def init(problem: Problem, y: Array) -> Array:
        return y if next(runs) % 2 else y * (1 + 2.0**-50)

    kept = Scheme("starts otherwise", StatefulStep(init, heun, lambda y: y.copy()))
    message = verify(kept, laws="contract").finding("contract").message
    assert "counter" in message or "init or the scheme remembers an earlier run" in message


def in_strange_units(case: Case) -> bool:
    sizes = [v for v in (abs(case.h), max(map(abs, case.y))) if v]
    return any(not 2.0**-16 <= size <= 2.0**16 for size in sizes)


def test_a_counterexample_in_strange_units_is_shown_in_known_ones() -> None:
    """The law is violated in all units; and one that is violated in strange units alone stays as it
    is.
    """
    plain = Case(problems.build(problems.rigid_body().data).data, (0.5, 0.5, 0.0), 0.25, (0.0,))
    assert not in_strange_units(plain)
    H = {
        "dimension": 2,
        "hamiltonian": [[[2, 0], 0.5], [[0, 2], 0.5]],
        "structure": [[0, 1, [[[0, 0], -1.0]]]],
    }
    case = Case(problems.from_json(H | {"noise": [1.0]}), (1.0, 0.5), 0.125, (0.0625,))
    strange = in_other_units(case, 60, 20)
    assert in_strange_units(strange)
    shown = shrunk(strange, lambda c: True)
    assert not in_strange_units(shown)
    alone = shrunk(strange, in_strange_units)
    assert in_strange_units(alone)


@pytest.mark.parametrize(
    ("asked", "strange"), [("canonical-separable", False), ("harmonic-oscillator", True)]
)
def test_a_familys_counterexample_is_shown_in_known_units_and_a_users_problem_stays(asked, strange) -> None:
    """A family has its systems in all units; another problem than the user's would be none of the
    scheme's.
    """
    where = Cases().of_problems(items(asked))
    assert not isinstance(where, str)
    one = PolynomialSystem(
        2, poly.squares((0.5, 0.5)), ((0, 1, poly.polynomial(2, {(0, 0): -1.0})),), noise=()
    )
    case = in_other_units(Case(one, (1.0, 0.5), 0.125, ()), 0, 20)
    assert in_strange_units(case)
    log, violates = SearchLog(), Measurement(2.0, 1.0)
    log.violation = case, violates
    _simplify(log, schemes.midpoint, Effort(), _Question(where, lambda *_: violates, False, ()))
    assert in_strange_units(log.violation[0]) == strange


MODULE = """
import sepv
from sepv.problem import vector_field

def step(problem, y, h, dW):
    return y + problem.random_step(h, dW) * vector_field(problem, y)

own = sepv.problems.rigid_body((1.0, 2.0, 3.0))
scheme = sepv.Scheme("euler", step, problems=[own])
"""


def test_problems_of_a_scheme_get_a_replay_command_that_works(reader: Reader) -> None:
    (reader.folder / "brings.py").write_text(MODULE)
    shown = command("verify brings:scheme --law energy --json out.json", 0).output
    replay = next(
        line.strip()
        for line in shown.splitlines()
        if "sepv verify brings:scheme --law energy --replay" in line
    )
    assert "report.replay" not in shown
    again = command(replay.removeprefix("sepv "), 1).output
    assert "energy violated" in again
    found = json.loads((Path(reader.folder) / "out.json").read_text())
    assert found["laws"][0]["power"] == pytest.approx(1.0, abs=0.2)


def test_coverage_of_a_family_is_that_of_its_run(reader: Reader) -> None:
    whole = command("verify energy-preserving --coverage --law energy").output
    family = command("verify energy-preserving --coverage --law energy -p rigid-bodies -p pendulum").output
    assert "rigid-bodies:" in family
    assert "pendulum: no design" in family
    assert "9–20" in whole  # degrees of H up to 20, and bodies have degree 2
    assert "9–20" not in family
