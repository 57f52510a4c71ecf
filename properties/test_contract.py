"""The contract of ``step``: pure, deterministic, keeps shape and dtype, changes nothing in place."""

from __future__ import annotations

import random
from typing import Any

import numpy as np

from sepv.candidate import ask, check_answer, raw_answer
from sepv.case import Case
from sepv.corners import corners
from sepv.errors import SchemeFault
from sepv.law import Effort, Measurement, require
from sepv.scheme import Scheme
from sepv.search import searched
from sepv.strategies import any_steps


def check(scheme: Scheme, case: Case) -> Measurement:
    """Ask again and again, with other questions in between; compare bits, arguments, and the state of the process."""
    problem, y, h, dW = case.build()
    asked, noise, before = y.copy(), dW.copy(), _surroundings()
    raw = raw_answer(scheme, problem, asked, h, noise)
    for name, was, now in (("y", y, asked), ("dW", dW, noise)):
        if not np.array_equal(was, now):
            raise SchemeFault(
                expected=f"{name} unchanged by the step",
                received=f"{name} = {now.tolist()} after, {was.tolist()} before",
                remedy=f"work on a copy: {name} = {name}.copy(), and no operators such as += on arguments",
            )
    changed = [key for key, value in _surroundings().items() if value != before[key]]
    if changed:
        raise SchemeFault(
            expected="a step that leaves the process as it was",
            received=f"a change of {', '.join(changed)}",
            remedy="use a generator of your own, and np.errstate as a context manager",
        )
    answer = check_answer(raw, y)
    first = answer.copy()
    # What was at rest moves a little in between: a step that starts from its last answer is then seen.
    moved = np.where(y == 0, np.max(np.abs(y)) / 64, y)
    for factor in (0.75, 0.5, 0.875):
        ask(scheme, problem, factor * moved, h, dW)
        if not np.array_equal(answer, first):
            raise SchemeFault(
                expected="an answer that stays as it is",
                received=f"{answer.tolist()} after the next call, {first.tolist()} before",
                remedy="return a new array each time, not a buffer that is used again",
            )
        second = ask(scheme, problem, y, h, dW)
        if not np.array_equal(first, second):
            raise SchemeFault(
                expected="one answer for one question: the same bits for the same arguments",
                received=f"{first.tolist()} and then {second.tolist()}",
                remedy="remove state, caches and random numbers from the step; the noise comes in dW",
            )
    return Measurement(0.0, 0.0)


def _surroundings() -> dict[str, Any]:
    """What a step of others would notice: global random numbers and floating-point error handling."""
    kind, keys, *rest = np.random.get_state(legacy=True)  # noqa: NPY002  (the global generator is the point)
    return {
        "NumPy's global random numbers": (kind, keys.tobytes(), *rest),  # type: ignore[union-attr]  # legacy tuple
        "Python's global random numbers": random.getstate(),
        "NumPy's error handling": np.geterr(),
    }


law = searched(
    name="contract",
    statement="step is pure, deterministic, keeps shape and dtype, and changes nothing around it",
    source="contract",
    unit="faults",
    cases=any_steps,
    check=check,
    corners=corners,
    faults_violate=True,
    always_claimed=True,
)


def test_contract(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
