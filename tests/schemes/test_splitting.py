"""The splitting of H into parts with exact flows: what it keeps, and what each part is."""

from __future__ import annotations

import numpy as np
import pytest

import sepv
from sepv import problems, schemes
from sepv.errors import Skipped


def test_casimirs_and_positivity_of_lotka_volterra_over_many_steps() -> None:
    problem = problems.lotka_volterra()
    assert problem.nambu is not None
    rng = np.random.default_rng(5)
    y = np.repeat(np.array(problem.initial)[:, None], 64, axis=1)
    before = problem.nambu.casimir(y)
    for _ in range(512):
        y = schemes.splitting.step(problem, y, 2.0**-6, 0.125 * rng.standard_normal((1, 64)))
    assert np.all(y > 0)
    # Each of five exponentials a step rounds ln y by an ulp of it: 8 eps √n for n = 2560 of them, ln y up to 10.
    assert np.max(np.abs(problem.nambu.casimir(y) - before)) < 8 * 2.0**-52 * np.sqrt(2560) * 10


def test_the_way_back_and_the_order_against_the_exact_flow() -> None:
    problem = problems.rigid_body()
    y = np.array([0.8, 0.5, -0.3])
    there = schemes.splitting.step(problem, y, 0.125, np.array([0.25]))
    back = schemes.splitting.step(problem, there, -0.125, np.array([-0.25]))
    assert np.max(np.abs(back - y)) < 4e-16
    deltas = 2.0 ** -np.arange(4, 8)
    exact = sepv.exact_flow(problem, deltas, y0=y).y
    errors = [
        np.max(np.abs(schemes.splitting.step(problem, y, d, np.zeros(1)) - end))
        for d, end in zip(deltas, exact.T, strict=True)
    ]
    assert np.all(np.abs(-np.diff(np.log2(errors)) - 3) < 0.2)  # local order three: c = 0 has order two


def test_a_problem_without_flows_is_skipped_by_name() -> None:
    with pytest.raises(Skipped, match=r"kepler gives no exact flows of parts of H \(Problem.flows\)"):
        schemes.splitting.step(problems.by_name("kepler"), np.array([0.0, 1.0, 1.0, 0.0]), 0.1, np.zeros(1))
