"""Right schemes that look unusual, each claiming what theory gives it: no claim of theirs is called violated."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from benchmarks.right_schemes import RIGHT
from sepv import StepFailure, problems, schemes, verify
from sepv.schemes import Scheme, ask
from sepv.schemes._guard import Refusal
from sepv.simulate._batch import run_chunk
from sepv.verification import Effort, Verdict

# Laws over paths have budgets of their own and are run by `benchmarks.false_alarms`.
PATHS = {"mean-square-order", "weak-order", "right-limit", "rounding"}
# What each run asks: *energy* of all, and *symmetry* of every other one and of those that claim no energy. The others
# cost minutes, and have a deep run and `benchmarks.false_alarms`.
QUICK = {
    name: {"energy"} & claims or {"symmetry"} & claims or {"contract"}
    if number % 2
    else {"energy", "symmetry"} & claims or {"contract"}
    for number, (name, claims) in enumerate((name, set(scheme.claims)) for name, scheme in RIGHT.items())
}
# A hundred vectors and more each: the others in the deep run.
WITH_VECTORS = (
    "twenty-nodes",
    pytest.param("lists-and-fsum", marks=pytest.mark.deep),
)


# A thousand exact flows, which *contract* asks for, take a minute.
SLOW = ("weak-two",)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.deep] * (name in SLOW)) for name in RIGHT]
)
def test_energy_and_symmetry_hold_where_they_are_claimed(name: str) -> None:
    assert accused(name, QUICK[name], 2) == []


@pytest.mark.deep
@pytest.mark.parametrize("name", RIGHT)
def test_every_claimed_law_about_steps_holds(name: str) -> None:
    assert accused(name, (RIGHT[name].claims | {"contract"}) - PATHS - {"reference"}, 4) == []


@pytest.mark.parametrize("name", WITH_VECTORS)
def test_other_quadratures_and_other_solvers_meet_the_reference_vectors(name: str) -> None:
    assert accused(name, {"reference"}, 4) == []


@pytest.mark.deep
@pytest.mark.parametrize("name", RIGHT)
def test_every_claimed_law_holds(name: str) -> None:
    assert accused(name, RIGHT[name].claims | {"contract"}, 100) == []


def accused(name: str, laws: Iterable[str], examples: int) -> list[tuple[str, Verdict, str]]:
    """What did not hold: law, verdict and message."""
    report = verify(RIGHT[name], laws=laws, effort=Effort(examples=examples, seed=1))
    return [(f.law, f.verdict, f.message) for f in report.findings if f.verdict is not Verdict.HOLDS]


@pytest.mark.parametrize(
    "error", [ArithmeticError, ZeroDivisionError, FloatingPointError, np.linalg.LinAlgError]
)
def test_an_arithmetic_error_is_a_refusal_and_says_so(error: type[Exception]) -> None:
    def step(problem, y, h, dW):  # type: ignore[no-untyped-def]
        raise error("no solution found")

    problem = problems.rigid_body()
    scheme = Scheme("refuses", step)
    with pytest.raises(StepFailure, match=r"refused the step by .*no solution found") as caught:
        ask(scheme, problem, np.asarray(problem.initial), 0.1, np.array([0.1]))
    assert isinstance(caught.value, Refusal)
    assert caught.value.delta == pytest.approx(0.2)
    ends = run_chunk(scheme, problem, np.asarray(problem.initial), 0.1, np.zeros((2, 1, 3)), None)
    assert np.all(ends.status != 0)


def test_a_refusal_where_a_solution_exists_is_an_error_of_the_law() -> None:
    def step(problem, y, h, dW):  # type: ignore[no-untyped-def]
        raise ArithmeticError("never")

    (finding,) = verify(
        Scheme("never", step, ("energy",)), laws=["energy"], effort=Effort(examples=3)
    ).findings
    assert finding.verdict is Verdict.ERROR
    assert finding.message.startswith("not solved:")
    assert "refused the step" in finding.message


def test_a_refusal_of_a_hard_vector_is_counted_and_no_crash() -> None:
    def step(problem, y, h, dW):  # type: ignore[no-untyped-def]
        if abs(problem.random_step(h, dW)) > 8:
            raise ZeroDivisionError("too long for this solver")
        return schemes.energy_preserving.step(problem, y, h, dW)

    (finding,) = verify(
        Scheme("short", step, ("reference",)), laws=["reference"], effort=Effort(examples=3)
    ).findings
    assert finding.verdict is Verdict.HOLDS, finding.message
    assert "8 steps without a solution or hard to solve refused" in finding.message
