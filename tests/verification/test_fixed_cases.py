"""The cases that no seed may miss: each is solved by each scheme, and together they have what laws ask for."""

from __future__ import annotations

import numpy as np
import pytest
from sepv.properties.test_energy import check, law
from sepv.reference.faults.saboteurs import SABOTEURS

from sepv import Scheme, Verdict, problems, schemes
from sepv.problem import PolynomialSystem
from sepv.verification import Case
from sepv.verification._cases.case import to_json
from sepv.verification._cases.fixed_cases import (
    fixed_cases,
    for_energy,
    long_steps,
)
from sepv.verification._contraction import contraction_radius


@pytest.mark.parametrize("name", schemes.PAPER)
def test_every_scheme_solves_every_corner(name: str) -> None:
    for case in fixed_cases():
        assert np.isfinite(schemes.PAPER[name].step(*case.build())).all(), case.describe()


def test_each_degree_has_a_step_that_shows_a_node_too_few() -> None:
    short, six, degrees = SABOTEURS["one-node-short"].scheme, SABOTEURS["six-nodes"].scheme, set()
    for case in set(for_energy()) - set(long_steps()):
        problem = problems.build(case.problem)
        saboteur, least = (short, 1e3) if problem.degree <= 14 else (six, 1e2)
        assert case.given == "bare functions" or check(saboteur, case).ratio > least, case.describe()
        assert check(schemes.energy_preserving, case).ratio < 0.1
        degrees.add(problem.degree)
    assert degrees == {*range(3, 11), 12, 14, 16, 17, 20}


def test_long_steps_are_solved_or_refused_but_not_returned_unsolved() -> None:
    def refuse(problem, y, h, dW):  # type: ignore[no-untyped-def]
        raise ArithmeticError("too long")

    def answer(case: Case) -> Verdict:
        return law.replay(law, Scheme("refuses", refuse), to_json(case)).verdict

    for case in long_steps():
        assert check(schemes.energy_preserving, case).ratio < 0.1
        assert answer(case) is Verdict.NOT_APPLICABLE
        assert check(SABOTEURS["newton-thrice"].scheme, case).violates
    assert answer(fixed_cases()[0]) is Verdict.ERROR


def test_polynomial_corners_lie_inside_the_contraction_radius() -> None:
    inside = [c for c in fixed_cases() if isinstance(c.problem, PolynomialSystem)]
    assert len(inside) >= 8
    for case in inside:
        problem, y, h, dW = case.build()
        assert h + float(np.sum(np.abs(problem.c * dW))) <= contraction_radius(problem, y)
