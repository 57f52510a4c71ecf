"""Steps with a state, which paths carry and single steps begin anew;
and steps in single precision with its bounds.
"""

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pytest
from doors import measured, says, verdicts
from drawn import refusing
from sepv.properties._states_of_a_path import keeps_states

import sepv
from benchmarks.right_schemes import RIGHT_SCHEMES
from sepv import PathSolver, SchemeFault, StatefulStep, UsageError, problems
from sepv.core.newton import Status
from sepv.law.cases.single_precision import in_range, single
from sepv.problem import Array, PolynomialSystem, Problem, mechanics, vector_field
from sepv.problems._common import canonical
from sepv.record import _polynomial as poly
from sepv.schemes import (
    Scheme,
    SchemeCrash,
    ask,
    energy_preserving,
    guarded,
    joined_lanes,
    lanes,
    load_scheme,
)
from sepv.simulate import run_chunk
from sepv.verification import Case, Effort

HEUN = RIGHT_SCHEMES["reversible-heun"]
FEW = Effort(examples=1)
h, N = 2.0**-6, 16


def by_hand(problem: Problem, y0: Array, h: float, dW: Array, euler: bool = False) -> Array:
    """Whole paths of reversible Heun, or of Euler's rule, in a plain loop;
    they refuse an increment above 10⁵.
    """
    y = z = np.repeat(y0[:, None], dW.shape[2], axis=1)
    f, states = vector_field(problem, y), [y]
    for row in dW:
        if np.max(np.abs(row), initial=0.0) > 1e5:
            raise sepv.StepFailure("the increment is too large")
        delta = problem.random_step(h, row)
        z = y + delta * f if euler else 2 * y - z + delta * f
        f, before = vector_field(problem, z), f
        y = z if euler else y + 0.5 * delta * (before + f)
        states.append(y)
    return np.array(states)


@pytest.mark.parametrize("batched", [True, False])
def test_a_path_carries_its_state_and_a_single_step_begins_anew(batched: bool) -> None:
    problem, scheme = problems.rigid_body(), replace(HEUN, batched=batched)
    path = sepv.integrate(scheme, problem, h=h, steps=N, seed=3)
    np.testing.assert_array_equal(
        path.y[:, -1], by_hand(problem, path.y[:, 0], h, path.dW[:, :, None])[-1, :, 0]
    )
    many = sepv.ensemble(scheme, problem, h=h, steps=N, paths=5, seed=3)
    alike = sepv.long_path(scheme, problem, h=h, steps=N, seed=3, path=0)
    np.testing.assert_allclose(many.y[:, 0], path.y[:, -1], rtol=1e-14)
    np.testing.assert_allclose(alike.y, path.y[:, -1], rtol=1e-14)
    anew = path.y[:, 0]
    for row in path.dW:
        anew = ask(scheme, problem, anew, h, row)
    assert np.max(np.abs(anew - path.y[:, -1])) > 1e-6


def test_a_path_that_fails_leaves_the_states_of_the_others_in_place() -> None:
    """Each path counts its steps; one refuses its third,
    another leaves the finite numbers in its second.
    """

    def step(problem: Problem, state: Any, h: float, dW: Array) -> Any:
        y, count, rate = state["y"], state["count"] + 1, state["rate"]
        if np.any((rate == 2) & (count == 3)):
            raise ArithmeticError("the third step")
        grown = np.where((rate == 3) & (count == 2), np.inf, y + rate * count)
        return {"y": grown, "count": count, "rate": rate}

    def init(problem: Problem, y: Array) -> Any:
        return {"y": y, "count": 0 * y, "rate": np.sign(y) * np.floor(np.abs(y))}

    rule = StatefulStep(init, step, lambda state: state["y"])
    problem = sepv.Problem(
        dimension=1, structure=lambda y: np.zeros((1, 1, *y.shape[1:])), hamiltonian=lambda y: y[0], noise=(),
        initial=(1.0,), check=False,
    )  # fmt: skip
    from sepv.simulate._batch import Carried, advance

    for scheme in (Scheme("counts", rule, batched=True), Scheme("counts", rule)):
        for asked in (scheme, guarded(scheme)):
            y, alive, carried = np.array([[1.0, 2.0, 3.0, 4.0]]), np.arange(4), Carried(scheme)
            for _ in range(4):
                end, status, *_ = advance(asked, problem, y[:, alive], h, np.empty((0, len(alive))), carried)
                ok = status == Status.CONVERGED
                y[:, alive[ok]] = end[:, ok]
                alive = alive[ok]
                carried.keep(ok)
            assert alive.tolist() == [0, 3]
            assert y[0, alive].tolist() == [1 + 10, 4 + 4 * 10]


class Pair(NamedTuple):
    """A state with names."""

    y: Array
    extra: Any


def test_paths_are_taken_from_states_made_of_arrays_alone() -> None:
    state = Pair(np.arange(6.0).reshape(2, 3), [None, {"f": np.arange(3)}, 7])
    some = lanes(state, [0, 2])
    assert some.y.tolist() == [[0, 2], [3, 5]]
    assert some.extra[1]["f"].tolist() == [0, 2]
    assert some.extra[2] == 7
    whole = joined_lanes([lanes(state, [0]), lanes(state, [1, 2])])
    assert type(whole) is Pair
    assert whole.y.tolist() == state.y.tolist()
    with pytest.raises(UsageError, match="leave out batched"):
        lanes(Pair(state.y, object()), [0])


def changed(**functions: Any) -> Scheme:
    """Reversible Heun with other functions."""
    assert isinstance(HEUN.step, StatefulStep)
    return replace(HEUN, step=replace(HEUN.step, **functions), batched=functions.pop("batched", False))


BUFFER = np.zeros(3)


def _in_a_buffer(problem: Problem, state: Any, h: float, dW: Array) -> Any:
    """The new f stands in one array, for all paths."""
    y, z, f = HEUN.step.step(problem, state, h, dW)
    BUFFER[...] = f
    return y, z, BUFFER


WRONG = {
    "paths that share nothing": changed(step=_in_a_buffer),
    "equal to y": changed(value=lambda state: 1.5 * state[0]),
    "y unchanged": changed(init=lambda _, y: (y.__iadd__(1.0), y, y)),
}


@pytest.mark.parametrize("expected", WRONG)
def test_the_contract_names_what_is_wrong_with_a_state(expected: str) -> None:
    problem = problems.rigid_body()
    y = np.array(problem.initial)
    keeps_states(HEUN, problem, y, h, np.array([0.1]), 2.0**-20)
    with pytest.raises(SchemeFault, match=expected):
        keeps_states(WRONG[expected], problem, y, h, np.array([0.1]), 2.0**-20)


def test_a_batch_that_mixes_its_paths_is_found() -> None:
    def init(_: Problem, y: Array) -> Any:
        return y, np.array([y.T]).T  # the paths are not on the last axis

    rule = StatefulStep(init, lambda problem, s, h, dW: (s[0] + h * s[1][..., 0], s[1]), lambda s: s[0])
    problem = problems.rigid_body()
    y = np.array(problem.initial)[:, None] * np.array([1.0, 1.1, 1.2])
    with pytest.raises(SchemeFault, match="last axis"):
        keeps_states(Scheme("mixed", rule, batched=True), problem, y, h, np.zeros((1, 3)), 2.0**-20)


def test_a_rule_alone_is_a_scheme_and_what_is_no_function_is_refused() -> None:
    assert isinstance(HEUN.step, StatefulStep)
    scheme = load_scheme(HEUN.step)
    assert not scheme.batched
    assert sepv.verify(scheme, laws="contract", effort=FEW).finding("contract").verdict.text == "holds"
    with pytest.raises(UsageError, match="value a function"):
        StatefulStep(HEUN.step.init, HEUN.step.step, 3)


def test_a_solver_of_whole_paths_is_judged_by_its_paths() -> None:
    for euler, verdict in ((False, "holds"), (True, "violated")):
        scheme = Scheme("whole", PathSolver(partial(by_hand, euler=euler)), mean_square_order=1.0)
        assert scheme.claims == {"mean-square-order", "right-limit"}
        assert set(verdicts(scheme, ",".join(scheme.claims), "pendulum").values()) == {verdict}


@pytest.mark.deep  # a step of it is a whole path; tests of the contract have schemes of paths that are quicker
def test_a_solver_of_whole_paths_keeps_the_contract_of_a_step() -> None:
    scheme = Scheme("whole", PathSolver(by_hand), mean_square_order=1.0)
    assert verdicts(scheme, "contract", examples=5) == {"contract": "holds"}


def test_whole_paths_are_those_of_the_steps_and_a_refused_step_is_named() -> None:
    problem, solver = problems.rigid_body(), Scheme("whole", PathSolver(by_hand), truncation=None)
    raw = sepv.simulate.increments(3, T=1.0, steps=N, noises=1, paths=range(3))
    raw[5, 0, 1] = 1e6
    many = run_chunk(guarded(solver), problem, np.array(problem.initial), 1 / N, raw, None)
    assert (many.status.tolist(), many.failed_step.tolist()) == ([0, Status.OVERFLOW, 0], [-1, 5, -1])
    path = sepv.integrate(solver, problem, h=1 / N, T=1.0, dW=raw[:, :, 0])
    np.testing.assert_array_equal(path.y[:, -1], many.y[:, 0])
    path = sepv.integrate(solver, calm := problems.pendulum(noise=()), h=1 / N, T=1.0)
    np.testing.assert_array_equal(path.y, by_hand(calm, path.y[:, 0], 1 / N, np.zeros((N, 0, 1)))[:, :, 0].T)
    with pytest.raises(UsageError, match="one path at a time"):
        replace(solver, batched=True)
    with pytest.raises(SchemeCrash, match=r"states \(N \+ 1, d, M\) = \(2, 3, 1\)"):
        ask(replace(solver, step=PathSolver(lambda *_: np.zeros(3))), problem, np.ones(3), h, np.zeros(1))
    refuses = Scheme("refuses", PathSolver(refusing(ArithmeticError("no root"))), order=2.0)
    says(refuses, "long-time-energy", "error", "no root")


SINGLE = RIGHT_SCHEMES["energy-preserving-in-single-precision"]
LEAST: dict[str, Any] = {"examples": 1, "shrink_checks": 0}


@pytest.mark.parametrize(
    "name", [n for n in RIGHT_SCHEMES if "-single-" in n and "casimir" in RIGHT_SCHEMES[n].claims]
)
def test_what_holds_in_binary64_holds_in_units_of_single_precision(name: str) -> None:
    report = measured(RIGHT_SCHEMES[name], "contract,identity,casimir,midpoint,symmetry", examples=1)
    assert [f.verdict.text for f in report.findings] == ["holds"] * 5
    found = report.finding("symmetry")
    assert found.unit == "ulp32 of y"
    assert found.bound is not None
    assert 1 < found.bound < 1000
    assert report.to_json()["scheme"]["dtype"] == "float32"


def altered(change: Any, **facts: Any) -> Scheme:
    """The right step with a change of its answer."""
    return replace(SINGLE, step=lambda problem, y, h, dW: change(SINGLE.step(problem, y, h, dW), y), **facts)


def test_a_step_that_loses_more_than_single_precision_is_found() -> None:
    half = altered(lambda y1, y: y1.astype(np.float16).astype(np.float32))
    assert set(verdicts(half, "casimir,midpoint", **LEAST).values()) == {"violated"}
    slightly = altered(lambda y1, y: y1 * np.float32(1 + 2.0**-12))
    assert verdicts(slightly, "energy", **LEAST) == {"energy": "violated"}
    # The bounds of single precision are not those of a scheme that says nothing.
    step = lambda *a: np.float64(np.float32(energy_preserving.step(*a)))  # noqa: E731
    rounded = replace(energy_preserving, step=step, solve=None)
    assert verdicts(rounded, "energy", **LEAST) == {"energy": "violated"}


def leapfrog(kick: Any = np.float32, state: Any = np.float32) -> Scheme:
    """A leapfrog in single precision; a wrong one keeps its kicks or its momenta in another."""

    def step(problem: Problem, y: Any, h: float, dW: Any) -> Any:
        system, length = mechanics(problem), np.float32(h)
        with np.errstate(over="ignore"):
            q, p = system.split(y)
            p = state(p + kick(length / 2 * system.force(q))).astype(np.float32)
            q = q + np.float32(length * system.velocity(p))
            return system.join(q, state(p + kick(length / 2 * system.force(q))).astype(np.float32))

    return Scheme("leapfrog", step, claims=KEPT, systems="mechanical", order=2, dtype="float32")


KEPT = ("poisson-map:constant", "volume", "symmetry", "reversibility")


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(n, marks=pytest.mark.deep) for n in range(2, 10))])
def test_a_leapfrog_in_single_precision_is_accused_by_no_seed(seed: int) -> None:
    report = measured(leapfrog(), ["contract", *KEPT], examples=1, seed=seed)
    assert [f.verdict.text for f in report.findings] == ["holds"] * 5


def test_a_leapfrog_that_keeps_half_precision_is_found() -> None:
    says(leapfrog(), "deterministic-order", "holds")
    # Kicks that are rounded alike come back: the step stays symmetric, but has no order.
    says(leapfrog(kick=np.float16), "deterministic-order", "violated")
    says(leapfrog(state=np.float16), "symmetry", "violated", **LEAST)


def _in_place(y1: Any, y: Any) -> Any:
    y[...] = y1
    return y


@pytest.mark.parametrize(
    ("scheme", "words"),
    [
        (replace(energy_preserving, step=lambda *a: np.float32(energy_preserving.step(*a)), solve=None),
         "dtype='float32'"),
        (altered(lambda y1, y: y1.astype(np.float64)), "return y's dtype"),
        (altered(_in_place), "unchanged"),
    ],
)  # fmt: skip
def test_the_contract_names_the_wrong_precision_and_a_changed_argument(scheme: Scheme, words: str) -> None:
    says(scheme, "contract", "violated", words, **LEAST)


@pytest.mark.parametrize("batched", [True, False])
def test_paths_are_those_of_single_precision(batched: bool) -> None:
    problem = problems.rigid_body()

    def step(problem: Problem, y: Any, h: float, dW: Any) -> Any:
        assert y.dtype == dW.dtype == np.float32
        return y * np.float32(1.1)

    scheme = Scheme("grows", step, dtype="float32", batched=batched)
    y = np.float32(np.array(problem.initial))
    for _ in range(4):
        y = y * np.float32(1.1)
    np.testing.assert_array_equal(sepv.integrate(scheme, problem, h=0.5, steps=4).y[:, -1], y)
    ends = sepv.ensemble(scheme, problem, h=0.5, steps=4, paths=3).y
    assert ends.dtype == np.float64
    np.testing.assert_array_equal(ends, np.repeat(y[:, None], 3, axis=1))


def test_cases_have_numbers_of_single_precision_and_stay_in_its_range() -> None:
    plane = PolynomialSystem(2, poly.squares((1.0, 1.0)), canonical(2))
    case = single(Case(plane, (0.1, 1 / 3), 0.1, (0.7,)))
    assert single(case) == case
    assert case.y == (float(np.float32(0.1)), float(np.float32(1 / 3)))
    assert in_range(case)
    steep = poly.polynomial(2, {(10, 0): 1e-30, (0, 2): 1.0})
    assert not in_range(replace(case, problem=PolynomialSystem(2, steep, canonical(2)), y=(1e6, 1.0)))
