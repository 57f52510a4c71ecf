"""What the contract sees beyond one question asked twice, what comes seldom, and what it leaves alone."""

from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from doors import finding
from sepv.properties import _without_memory
from sepv.reference.faults.saboteurs import SABOTEURS

from sepv import StepFailure, schemes
from sepv.errors import SchemeFault
from sepv.problem import Array, Problem
from sepv.schemes import Scheme, midpoint
from sepv.verification import Effort, Finding, Verdict, verify
from sepv.verification._verify import replay

FEW: dict[str, Any] = {"examples": 1, "shrink_checks": 0}


def measured(scheme: Any, law: str = "contract") -> Finding:
    return finding(scheme, law, **FEW)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("remembers-digits", "another answer for another state"),
        ("remembers-without-y", "another answer for another state"),
        ("remembers-the-last", "another answer for another state"),
        ("refuses-once", "a refusal and then"),
        ("writes-and-restores", "an attempt to write into one of them"),
        ("reads-memory", "however they lie in memory"),
        ("off-each-five-thousandth", "however often it is asked"),
    ],
)
def test_a_step_that_is_not_pure_is_found(name: str, said: str) -> None:
    found = measured(SABOTEURS[name].scheme)
    assert found.verdict is Verdict.VIOLATED
    assert said in found.message


def test_a_change_of_an_argument_is_an_error_of_every_law() -> None:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y1 = midpoint.step(problem, y, h, dW)
        y *= 1.0 + (len(y) == 3)  # in three dimensions alone
        return y1

    found = measured(step, "identity")
    assert found.verdict is Verdict.ERROR
    assert "y unchanged by the step" in found.message


def test_a_step_for_contiguous_arrays_alone_is_left_alone() -> None:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        if not (y.flags.c_contiguous and y.flags.writeable):
            raise ValueError("buffer source array is read-only, or not contiguous")
        return midpoint.step(problem, y, h, dW)

    found = measured(Scheme("typed", step))
    assert found.verdict is Verdict.HOLDS, found.message


def test_a_step_that_returns_nan_where_nothing_solves_it_is_none_of_the_contract() -> None:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        try:
            return midpoint.step(problem, y, h, dW)
        except ArithmeticError:
            return np.full_like(y, np.nan)

    found = measured(step)
    assert found.verdict is Verdict.HOLDS, found.message


MODULE = """
import sepv
from sepv.schemes import energy_preserving

calls = 0

def moved(problem, y, h, dW):
    global calls
    calls += 1
    y1 = energy_preserving.step(problem, y, h, dW)
    return y1 * (1 + 1e-6) if calls > {most} else y1

scheme = sepv.Scheme("counting", moved, claims=["energy"])
"""


@pytest.mark.parametrize(("most", "said"), [(40, "depends on earlier calls"), (0, "violated")])
def test_a_counterexample_is_replayed_in_a_fresh_process(most, said, tmp_path, monkeypatch):
    (tmp_path / f"counts_from_{most}.py").write_text(MODULE.format(most=most))
    monkeypatch.syspath_prepend(str(tmp_path))
    report = verify(f"counts_from_{most}:scheme", laws="energy", effort=Effort(**FEW))
    (found,) = report.findings
    assert (found.verdict, found.verdict_text) == (Verdict.VIOLATED, said)
    assert f"energy {said}" in str(report)
    assert report.exit_code == 1


def counting(period: int, spoil) -> Scheme:
    """(2.1) with each so-manieth answer spoilt."""
    calls = [0]

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        calls[0] += 1
        y1 = schemes.energy_preserving.step(problem, y, h, dW)
        return spoil(y, y1) if calls[0] % period == 0 else y1

    return Scheme("seldom wrong", step)


def refuse(y: Array, _: Array) -> Array:
    raise StepFailure(problem="any", y=y, delta=1.0, residual=1.0, status="tired", iterations=1)


@pytest.mark.parametrize(
    ("period", "spoil"),
    [
        *((n, lambda _, y1: np.nextafter(y1, 0.0)) for n in (200, 1024)),
        (1000, lambda y, _: y.copy()),
        (1000, refuse),
    ],
    ids=["an ulp", "an ulp, seldom", "left out", "refused"],
)
def test_what_is_wrong_in_one_of_a_thousand_calls_is_found(period: int, spoil) -> None:
    found = measured(counting(period, spoil))
    assert found.verdict is Verdict.VIOLATED
    assert period < 1000 or "asked 1024 times in a row" in found.message


def test_the_witness_of_a_seldom_fault_is_found_again() -> None:
    saboteur = SABOTEURS["thousandth-call"]
    witness = measured(saboteur.scheme).witness
    assert witness is not None
    assert witness["times"] == 1024
    assert replay(saboteur.scheme, "contract", witness).verdict is Verdict.VIOLATED
    assert replay(schemes.energy_preserving, "contract", witness).verdict is Verdict.HOLDS


def test_a_scheme_too_slow_to_be_asked_so_often_is_asked_as_often_as_time_allows(
    monkeypatch,
):
    monkeypatch.setattr(_without_memory, "MOST_SECONDS", 0.0)
    asked = [0]

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        asked[0] += 1
        return schemes.energy_preserving.step(problem, y, h, dW)

    assert measured(Scheme("slow", step)).verdict is Verdict.HOLDS
    assert asked[0] < 1500  # 1,060 without the repeats, a thousand more with them


@pytest.mark.parametrize("noises", [2, 3, 4])
def test_increments_at_each_others_place_are_seen_whatever_their_number(noises: int) -> None:
    """Reversing two noises, or turning four by two, leaves an exchange alone that the other questions change."""

    def turned(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        m = problem.noises
        order = np.roll(np.arange(m), m // 2) if m == noises else np.arange(m)
        moved = replace(problem, noise=problem.c[order], check=False)
        return schemes.several_structures.step(moved, y, h, dW[order])

    scheme = replace(schemes.several_structures, name="turned", step=turned, solve=None)
    assert measured(scheme, "noise-sum").verdict is Verdict.VIOLATED


def test_several_structures_summed_in_any_order_keep_noise_sum() -> None:
    def backward(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        order = np.arange(problem.noises)[::-1]
        structures = tuple(problem.noise_structures[j] for j in order)
        moved = replace(problem, noise=problem.c[order], noise_structures=structures, check=False)
        return schemes.several_structures.step(moved, y, h, dW[order])

    scheme = replace(schemes.several_structures, name="backward", step=backward, solve=None)
    assert measured(scheme, "noise-sum").verdict is Verdict.HOLDS


@pytest.mark.parametrize(("size", "accused"), [(1e-20, False), (1e-3, True)])
def test_a_state_that_is_lost_in_the_rounding_of_the_answer_is_no_second_question(size, accused):
    y, answer = np.array([size, 0.0]), np.array([0.5, 0.25])
    with pytest.raises(SchemeFault) if accused else nullcontext() as caught:
        _without_memory.tells_apart(y, 0.75 * y, answer, answer.copy(), _without_memory.APART)
    assert (caught is not None) is accused
