"""Errors of one step on the problems that a user names: fast, slow, without noise, with seven."""

from __future__ import annotations

import pytest

from sepv import problems
from sepv.suite import verify

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


def test_problems_without_an_exact_solution_are_not_applicable() -> None:
    report = verify("several-structures", laws=LAWS, problems=["noncommuting-tops"])
    assert [f.verdict.value for f in report.findings] == ["holds"] + ["not_applicable"] * 3
    assert "no closed form" in report.findings[1].message
