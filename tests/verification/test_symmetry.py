"""Symmetry and the random step are two laws: each holds and is broken without the other."""

from __future__ import annotations

import math

import numpy as np
import pytest
from sepv.reference.faults.saboteurs import SABOTEURS

from benchmarks.right_schemes import RIGHT
from sepv import schemes, verify
from sepv.schemes import Scheme
from sepv.verification import Effort, Finding, Verdict

LAWS = ("symmetry", "random-step")


def measured(scheme: Scheme, examples: int = 8) -> list[Finding]:
    findings = verify(scheme, laws=LAWS, effort=Effort(examples=examples, shrink_checks=20)).findings
    return sorted(findings, key=lambda f: LAWS.index(f.law))


def test_a_symmetric_scheme_need_not_be_a_function_of_the_random_step() -> None:
    symmetry, random_step = measured(RIGHT["trapezoidal-drift"])
    assert symmetry.verdict is Verdict.HOLDS, symmetry.message
    assert random_step.verdict is Verdict.VIOLATED
    # Not by a little: the two rules differ in Δ³, of the order of a thousandth at |Δ| = 0.1.
    assert (random_step.defect or 0) > 1e6


def test_a_function_of_the_random_step_need_not_be_symmetric() -> None:
    symmetry, random_step = measured(schemes.explicit(4))
    assert symmetry.verdict is Verdict.VIOLATED
    assert random_step.verdict is Verdict.HOLDS, random_step.message


def test_steps_backward_are_steps_with_negative_h() -> None:
    symmetry, random_step = measured(SABOTEURS["absolute-h"].scheme)
    assert symmetry.verdict is Verdict.VIOLATED
    assert random_step.verdict is Verdict.VIOLATED  # cases with h < 0 are among its own


def no_root(problem, y, h, dW):  # type: ignore[no-untyped-def]
    return schemes.energy_preserving.step(problem, y, math.sqrt(h) ** 2, dW)


def not_a_number(problem, y, h, dW):  # type: ignore[no-untyped-def]
    return schemes.energy_preserving.step(problem, y, h, dW) * np.sqrt(np.sign(h))


def refused(problem, y, h, dW):  # type: ignore[no-untyped-def]
    if h < 0:
        raise ArithmeticError("no steps backward in time")
    return schemes.energy_preserving.step(problem, y, h, dW)


@pytest.mark.parametrize("step", [no_root, not_a_number, refused])
def test_a_scheme_without_negative_h_is_not_measured_and_the_table_says_so(step) -> None:  # type: ignore[no-untyped-def]
    symmetry, random_step = measured(Scheme("forward", step, LAWS), examples=5)
    assert symmetry.verdict is Verdict.NOT_APPLICABLE
    assert "makes no step with h < 0" in symmetry.message
    assert random_step.verdict is Verdict.HOLDS, random_step.message


def test_a_step_back_that_fails_where_others_do_not_is_an_error() -> None:
    def step(problem, y, h, dW):  # type: ignore[no-untyped-def]
        if h < -1e-4:
            raise ArithmeticError("too far back")
        return schemes.energy_preserving.step(problem, y, h, dW)

    symmetry, _ = measured(Scheme("short of breath", step, LAWS), examples=20)
    assert symmetry.verdict is Verdict.ERROR
    assert "not solved" in symmetry.message
