"""Faults that come seldom are seen by the contract, and noises at each other's place by noise-sum."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from sepv.properties import test_contract

from sepv import StepFailure, schemes
from sepv.errors import SchemeFault
from sepv.faults._saboteurs import SABOTEURS
from sepv.problem import Array, Problem
from sepv.schemes import Scheme
from sepv.verification import Effort, Finding, Verdict, verify
from sepv.verification._verify import replay

FEW = Effort(examples=1, shrink_checks=0)


def counting(period: int, spoil) -> Scheme:  # type: ignore[no-untyped-def]
    """(2.1) with each so-manieth answer spoilt."""
    calls = [0]

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        calls[0] += 1
        y1 = schemes.energy_preserving.step(problem, y, h, dW)
        return spoil(y, y1) if calls[0] % period == 0 else y1

    return Scheme("seldom wrong", step)


def contract(scheme: Scheme) -> Finding:
    (finding,) = verify(scheme, laws="contract", effort=FEW).findings
    return finding


def refuse(y: Array, _: Array) -> Array:
    raise StepFailure(problem="any", y=y, delta=1.0, residual=1.0, status="tired", iterations=1)


@pytest.mark.parametrize("period", [200, 700, 1024])
def test_an_ulp_in_one_of_a_thousand_calls_breaks_the_contract(period: int) -> None:
    finding = contract(counting(period, lambda _, y1: np.nextafter(y1, 0.0)))
    assert finding.verdict is Verdict.VIOLATED


@pytest.mark.parametrize("spoil", [lambda y, _: y.copy(), refuse])
def test_a_step_that_is_left_out_or_refused_now_and_then_breaks_it_too(spoil) -> None:  # type: ignore[no-untyped-def]
    finding = contract(counting(1000, spoil))
    assert finding.verdict is Verdict.VIOLATED
    assert "asked 1024 times in a row" in finding.message


def test_the_witness_of_a_seldom_fault_is_found_again() -> None:
    saboteur = SABOTEURS["thousandth-call"]
    finding = contract(saboteur.scheme)
    assert finding.witness is not None
    assert finding.witness["times"] == 1024
    assert replay(saboteur.scheme, "contract", finding.witness).verdict is Verdict.VIOLATED
    assert replay(schemes.energy_preserving, "contract", finding.witness).verdict is Verdict.HOLDS


def test_a_scheme_too_slow_to_be_asked_so_often_is_asked_as_often_as_time_allows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(test_contract, "MOST_SECONDS", 0.0)
    asked = [0]

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        asked[0] += 1
        return schemes.energy_preserving.step(problem, y, h, dW)

    assert contract(Scheme("slow", step)).verdict is Verdict.HOLDS
    assert asked[0] < 1024


@pytest.mark.parametrize("noises", [2, 3, 4])
def test_increments_at_each_others_place_are_seen_whatever_their_number(noises: int) -> None:
    """Reversing two noises, or turning four by two, leaves an exchange alone that the other questions change."""

    def turned(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        m = problem.noises
        order = np.roll(np.arange(m), m // 2) if m == noises else np.arange(m)
        moved = replace(problem, noise=problem.c[order], check=False)
        return schemes.several_structures.step(moved, y, h, dW[order])

    scheme = replace(schemes.several_structures, name="turned", step=turned, solve=None)
    (finding,) = verify(scheme, laws="noise-sum", effort=FEW).findings
    assert finding.verdict is Verdict.VIOLATED


def test_several_structures_summed_in_any_order_keep_noise_sum() -> None:
    def backward(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        order = np.arange(problem.noises)[::-1]
        structures = tuple(problem.noise_structures[j] for j in order)  # type: ignore[attr-defined]
        moved = replace(problem, noise=problem.c[order], noise_structures=structures, check=False)
        return schemes.several_structures.step(moved, y, h, dW[order])

    scheme = replace(schemes.several_structures, name="backward", step=backward, solve=None)
    (finding,) = verify(scheme, laws="noise-sum", effort=FEW).findings
    assert finding.verdict is Verdict.HOLDS


@pytest.mark.parametrize("name", ["remembers-without-y", "remembers-the-last"])
def test_one_answer_for_two_states_breaks_the_contract(name: str) -> None:
    finding = contract(SABOTEURS[name].scheme)
    assert finding.verdict is Verdict.VIOLATED
    assert "another answer for another state" in finding.message


@pytest.mark.parametrize(("size", "accused"), [(1e-20, False), (1e-3, True)])
def test_a_state_that_is_lost_in_the_rounding_of_the_answer_is_no_second_question(
    size: float, accused: bool
) -> None:
    y, answer = np.array([size, 0.0]), np.array([0.5, 0.25])
    with pytest.raises(SchemeFault) if accused else nullcontext() as caught:
        test_contract._tells_apart(y, 0.75 * y, answer, answer.copy(), test_contract.APART)
    assert (caught is not None) is accused
