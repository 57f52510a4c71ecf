"""Errors of one step on the problems that a user names: fast, slow, without noise, with seven."""

from __future__ import annotations

import pytest

from sepv import problems
from sepv.verification import verify

LAWS = ("truncation", "local-mean", "local-mean-square", "local-weak")
GIVEN = {
    "without noise": problems.rigid_body(noise=()),
    "seven noises": problems.rigid_body(noise=(0.3,) * 7),
    "loud": problems.rigid_body(noise=30.0),
    "nearly silent": problems.pendulum(noise=0.01),
    "attracting": problems.kepler(),
}


@pytest.mark.parametrize("name", GIVEN)
def test_the_midpoint_rule_is_of_order_one_on_every_problem(name: str) -> None:
    report = verify("midpoint", laws=LAWS, problems=[GIVEN[name]])
    assert [f.verdict.value for f in report.findings] == ["holds"] * 4
    assert all(GIVEN[name].name in f.message for f in report.findings[1:])


def test_moments_serve_where_noises_do_not_commute_and_fields_are_linear() -> None:
    """No solution for each ΔW is known there: (3.9) is not measured, the means are."""
    report = verify("several-structures", laws=LAWS, problems=["noncommuting-tops"])
    assert [f.verdict.value for f in report.findings] == ["holds", "holds", "not_applicable", "holds"]
    assert report.finding("local-weak").defect == pytest.approx(2.0, abs=0.02)
    assert "only moments are known" in report.finding("local-mean-square").message


def test_problems_without_an_exact_solution_are_not_applicable() -> None:
    report = verify("several-structures", laws=LAWS, problems=["noncommuting-drift"])
    assert [f.verdict.value for f in report.findings] == ["holds"] + ["not_applicable"] * 3
    assert "not linear" in report.findings[1].message
