"""Steps in single precision: bounds follow, cases are made of its numbers, and what is lost beyond it is found."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from doors import finding, measured, verdicts

import sepv
from benchmarks.right_schemes import RIGHT
from sepv import problems
from sepv.problem import PolynomialSystem, Problem, mechanics
from sepv.problems._common import canonical
from sepv.record import _polynomial as poly
from sepv.schemes import Scheme, energy_preserving
from sepv.verification import Case
from sepv.verification._cases.single_precision import in_range, single

SINGLE = RIGHT["energy-preserving-in-single-precision"]
FEW: dict[str, Any] = {"examples": 1, "shrink_checks": 0}


@pytest.mark.parametrize("name", [name for name, scheme in RIGHT.items() if scheme.dtype == "float32"])
def test_what_holds_in_binary64_holds_in_units_of_single_precision(name: str) -> None:
    report = measured(RIGHT[name], "contract,identity,casimir,midpoint,symmetry", examples=1)
    assert [f.verdict.text for f in report.findings] == ["holds"] * 5
    found = report.finding("symmetry")
    assert found.unit == "ulp32 of y"
    assert found.bound is not None
    assert 1 < found.bound < 1000
    assert report.to_json()["scheme"]["dtype"] == "float32"


def changed(change: Any, **facts: Any) -> Scheme:
    """The right step with a change of its answer."""
    return replace(SINGLE, step=lambda problem, y, h, dW: change(SINGLE.step(problem, y, h, dW), y), **facts)


def test_a_step_that_loses_more_than_single_precision_is_found() -> None:
    half = changed(lambda y1, y: y1.astype(np.float16).astype(np.float32))
    assert set(verdicts(half, "casimir,midpoint", **FEW).values()) == {"violated"}
    slightly = changed(lambda y1, y: y1 * np.float32(1 + 2.0**-12))
    assert verdicts(slightly, "energy", **FEW) == {"energy": "violated"}
    # The bounds of single precision are not those of a scheme that says nothing.
    step = lambda *a: np.float64(np.float32(energy_preserving.step(*a)))  # noqa: E731
    rounded = replace(energy_preserving, step=step, solve=None)
    assert verdicts(rounded, "energy", **FEW) == {"energy": "violated"}


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


KEPT = ("symplecticity", "volume", "symmetry", "reversibility")


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(n, marks=pytest.mark.deep) for n in range(2, 10))])
def test_a_leapfrog_in_single_precision_is_accused_by_no_seed(seed: int) -> None:
    report = measured(
        leapfrog(), "contract,symplecticity,volume,symmetry,reversibility", examples=1, seed=seed
    )
    assert [f.verdict.text for f in report.findings] == ["holds"] * 5


def test_a_leapfrog_that_keeps_half_precision_is_found() -> None:
    assert finding(leapfrog(), "deterministic-order").verdict.text == "holds"
    # Kicks that are rounded alike come back: the step stays symmetric, but has no order.
    assert finding(leapfrog(kick=np.float16), "deterministic-order").verdict.text == "violated"
    assert finding(leapfrog(state=np.float16), "symmetry", **FEW).verdict.text == "violated"


def _in_place(y1: Any, y: Any) -> Any:
    y[...] = y1
    return y


@pytest.mark.parametrize(
    ("scheme", "words"),
    [
        (replace(energy_preserving, step=lambda *a: np.float32(energy_preserving.step(*a)), solve=None),
         "dtype='float32'"),
        (changed(lambda y1, y: y1.astype(np.float64)), "return y's dtype"),
        (changed(_in_place), "unchanged"),
    ],
)  # fmt: skip
def test_the_contract_names_the_wrong_precision_and_a_changed_argument(scheme: Scheme, words: str) -> None:
    found = finding(scheme, "contract", **FEW)
    assert found.verdict.text == "violated"
    assert words in found.message


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
    case = single(
        Case(PolynomialSystem(2, poly.squares((1.0, 1.0)), canonical(2)), (0.1, 1 / 3), 0.1, (0.7,))
    )
    assert single(case) == case
    assert case.y == (float(np.float32(0.1)), float(np.float32(1 / 3)))
    assert in_range(case)
    steep = poly.polynomial(2, {(10, 0): 1e-30, (0, 2): 1.0})
    assert not in_range(replace(case, problem=PolynomialSystem(2, steep, canonical(2)), y=(1e6, 1.0)))
