"""Searches: designs and targets find what chance alone would miss, and a violation names the part that makes it."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from doors import finding
from hypothesis import strategies as st
from sepv.reference.faults.saboteurs import SABOTEURS
from sepv.reference.faults.saboteurs.noise import _with

from benchmarks.power import FAULTS, Fault, measured, power
from sepv import problems, schemes
from sepv.problem import Array, Problem, Systems
from sepv.schemes import Scheme
from sepv.verification import Case, Cases, Effort, Law, Measurement, Run, Verdict, load_laws, searched, verify
from sepv.verification import _search as search
from sepv.verification._verify import replay

# A violation lies in a thousandth of the states, on a slope of the defect that is seen from all of them.
MOST, BEST, NEAR = 10**4, 6_543, 4


def states() -> st.SearchStrategy[Case]:
    data = problems.harmonic_oscillator().data
    assert data is not None
    return st.integers(0, MOST).map(lambda n: Case(data, (float(n), 0.0), 0.5, (0.0,)))


def slope(_: Scheme, case: Case) -> Measurement:
    away = abs(case.y[0] - BEST)
    return Measurement(1.0 + 1.0 / MOST if away <= NEAR else 1.0 - away / MOST, 1.0)


def law() -> Law:
    words = dict.fromkeys(("statement", "source"), "")
    return searched(
        name="slope", unit="1", cases=Cases(instead={Systems.SINGLE: states}), check=slope, **words
    )


def verdicts() -> list[Verdict]:
    tried = [Run(Effort(examples=25, seed=seed, shrink_checks=0)) for seed in range(8)]
    return [law().run(law(), schemes.energy_preserving, run).verdict for run in tried]


def test_a_violation_at_the_top_of_a_slope_is_climbed_to() -> None:
    """A hundred examples of chance alone would meet it with one seed of ten."""
    assert verdicts() == [Verdict.VIOLATED] * 8


def test_without_the_target_it_is_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "target", lambda *_, **__: None)
    assert verdicts().count(Verdict.VIOLATED) <= 2


def test_a_defect_that_is_not_a_number_is_no_tolerance() -> None:
    log, case = search.SearchLog(), Case(problems.rigid_body().data, (0.8, 0.6, 0.0), 0.125, (0.25,))

    def check(*_: object) -> Measurement:
        return Measurement(float("nan"), 1.0)

    with pytest.raises(search._Violation):
        search._measure(log, schemes.midpoint, case, check, False)
    (energy,) = load_laws(["energy"])
    assert "tolerance" not in search.conclude(energy, schemes.midpoint, log, check).message


@pytest.mark.parametrize("checks", [0, 3, 10, 30])
def test_a_defect_is_that_of_the_witness_wherever_simplifying_ends(checks: int) -> None:
    """The midpoint rule does not keep the energy of the pendulum, by more the longer the step."""
    found = finding("midpoint", "energy", "pendulum", shrink_checks=checks, corpus=False)
    again = replay("midpoint", "energy", found.witness)
    assert found.verdict is again.verdict is Verdict.VIOLATED
    assert (found.defect, found.bound) == (again.defect, again.bound)


def test_steps_longer_than_a_scheme_takes_are_left_out_and_their_share_is_said() -> None:
    refused = []

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        if abs(h) + np.abs(problem.c * dW).sum() > 1.0:
            refused.append(h)
        return schemes.energy_preserving.step(problem, y, h, dW)

    limited = Scheme("limited", step, claims=["energy"], longest_step=1.0)
    report = verify(limited, laws="energy")
    found = report.finding("energy")
    assert not refused
    assert found.share is not None
    assert 0.7 < found.share < 0.9
    assert f"holds on {int(100 * found.share)} %" in str(report)
    assert report.exit_code == 0


def test_a_law_of_which_few_cases_are_left_does_not_hold() -> None:
    some = replace(schemes.energy_preserving, longest_step=lambda problem, y, h, dW: len(y) == 7)
    report = verify(some, laws="energy")
    (found,) = report.findings
    assert found.verdict is Verdict.INCONCLUSIVE
    assert "% of the cases were measured: a law holds on 25 % at least" in found.message
    assert report.exit_code == 1


# Of the subtler faults, those that err by a power of the step: their cases have to be made for them.
BROKEN = ("one-point-quadrature", "b-at-y0", "(2.1)")
SUBTLE = [f for f in FAULTS if f.broken in BROKEN and f.law != "reference"]


@pytest.mark.parametrize("fault", SUBTLE, ids=lambda f: f"{f.systems}-{f.law}-{f.broken}")
def test_a_fault_of_a_pair_of_strata_is_found_in_that_pair(fault: Fault) -> None:
    strata, of_strata, pairs, of_pairs, missed = power(fault, measured(fault, 29))
    assert strata == of_strata
    # H = (y1 y3)^n is kept by one node too: a case of a few hundred pairs in several hundred may be of that kind.
    assert pairs >= 0.97 * of_pairs, missed
    assert of_pairs > 500


@pytest.mark.parametrize(
    ("delta", "named"),
    [
        (lambda c, h, w: 1.001 * h + np.sum(c * w, axis=0), "nearly all of it is in h: alone it makes"),
        (lambda c, h, w: h + np.sum(c * w, axis=0) + 0.01 * np.sum((c * w)[1:2], axis=0),
         "nearly all of it is in c2 ΔW2: alone it makes"),
        (lambda c, h, w: h + (1 + 1e-3 * h) * np.sum(c * w, axis=0),
         "nearly all of it is in the product of h and c1 ΔW1, each of which alone makes none"),
    ],
)  # fmt: skip
def test_a_wrong_term_is_named(delta: Callable[..., Any], named: str) -> None:
    found = finding(_with(delta)(), "reference", examples=8, corpus=False)
    assert found.verdict is Verdict.VIOLATED
    assert named in found.message


@pytest.mark.parametrize(("name", "law"), [("b-at-y0", "reference"), ("one-point-quadrature", "energy")])
def test_a_fault_of_every_part_has_no_name(name: str, law: str) -> None:
    found = finding(SABOTEURS[name].scheme, law, examples=8, corpus=False)
    assert found.verdict is Verdict.VIOLATED
    assert "nearly all of it" not in found.message
