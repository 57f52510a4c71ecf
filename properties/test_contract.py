"""The contract of ``step``: pure, deterministic, keeps shape and dtype, changes nothing in place."""

from __future__ import annotations

import numpy as np

from sepv.candidate import ask, check_answer, raw_answer
from sepv.case import Case
from sepv.errors import SchemeFault
from sepv.law import Effort, Measurement, require
from sepv.scheme import Scheme
from sepv.search import searched
from sepv.strategies import any_steps


def check(scheme: Scheme, case: Case) -> Measurement:
    """Ask twice, with another question in between; compare bits, and the arguments before and after."""
    problem, y, h, dW = case.build()
    asked, noise = y.copy(), dW.copy()
    raw = raw_answer(scheme, problem, asked, h, noise)
    for name, before, after in (("y", y, asked), ("dW", dW, noise)):
        if not np.array_equal(before, after):
            raise SchemeFault(
                expected=f"{name} unchanged by the step",
                received=f"{name} = {after.tolist()} after, {before.tolist()} before",
                remedy=f"work on a copy: {name} = {name}.copy(), and no operators such as += on arguments",
            )
    first = check_answer(raw, y).copy()
    ask(scheme, problem, 0.75 * y, h, dW)
    second = ask(scheme, problem, y, h, dW)
    if not np.array_equal(first, second):
        raise SchemeFault(
            expected="one answer for one question: the same bits for the same arguments",
            received=f"{first.tolist()} and then {second.tolist()}",
            remedy="remove state, caches and random numbers from the step; the noise comes in dW",
        )
    return Measurement(0.0, 0.0)


law = searched(
    name="contract",
    statement="step is pure, deterministic, keeps shape and dtype, and changes nothing in place",
    source="contract",
    unit="faults",
    cases=any_steps,
    check=check,
    faults_violate=True,
    always_claimed=True,
)


def test_contract(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
