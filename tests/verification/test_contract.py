"""What the contract sees beyond one question asked twice, and what it leaves alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sepv.faults._saboteurs import SABOTEURS
from sepv.problem import Array, Problem
from sepv.schemes import Scheme, midpoint
from sepv.verification import Effort, Verdict, verify

FEW = Effort(examples=1, shrink_checks=0)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("remembers-digits", "another answer for another state"),
        ("refuses-once", "a refusal and then"),
        ("writes-and-restores", "an attempt to write into one of them"),
        ("reads-memory", "however they lie in memory"),
        ("off-each-five-thousandth", "however often it is asked"),
    ],
)
def test_a_step_that_is_not_pure_is_found(name: str, said: str) -> None:
    (found,) = verify(SABOTEURS[name].scheme, laws="contract", effort=FEW).findings
    assert found.verdict is Verdict.VIOLATED
    assert said in found.message


def test_a_change_of_an_argument_is_an_error_of_every_law() -> None:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y1 = midpoint.step(problem, y, h, dW)
        y *= 1.0 + (len(y) == 3)  # in three dimensions alone
        return y1

    (found,) = verify(step, laws="identity", effort=FEW).findings
    assert found.verdict is Verdict.ERROR
    assert "y unchanged by the step" in found.message


def test_a_step_for_contiguous_arrays_alone_is_left_alone() -> None:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        if not (y.flags.c_contiguous and y.flags.writeable):
            raise ValueError("buffer source array is read-only, or not contiguous")
        return midpoint.step(problem, y, h, dW)

    (found,) = verify(Scheme("typed", step), laws="contract", effort=FEW).findings
    assert found.verdict is Verdict.HOLDS, found.message


def test_a_step_that_returns_nan_where_nothing_solves_it_is_none_of_the_contract() -> None:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        try:
            return midpoint.step(problem, y, h, dW)
        except ArithmeticError:
            return np.full_like(y, np.nan)

    (found,) = verify(step, laws="contract", effort=FEW).findings
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
def test_a_counterexample_is_replayed_in_a_fresh_process(
    most: int, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / f"counts_from_{most}.py").write_text(MODULE.format(most=most))
    monkeypatch.syspath_prepend(str(tmp_path))
    report = verify(f"counts_from_{most}:scheme", laws="energy", effort=FEW)
    (found,) = report.findings
    assert (found.verdict, found.verdict_text) == (Verdict.VIOLATED, said)
    assert f"energy {said}" in str(report)
    assert report.exit_code == 1
