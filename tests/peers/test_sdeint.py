"""Schemes nobody here wrote: sdeint's, through its own stepping code."""

from __future__ import annotations

import numpy as np
import sdeint

from sepv import problems
from sepv.peers.sdeint import ito_euler, strat_heun
from sepv.problem import vector_field
from sepv.verification import Effort, Verdict, verify


def test_the_adapter_runs_sdeints_own_code() -> None:
    problem, h, dW = problems.pendulum(), 0.1, np.array([0.2, -0.1])
    y = np.asarray(problem.initial)
    f = lambda state, _t: vector_field(problem, np.asarray(state))  # noqa: E731  (sdeint wants a callable)
    G = lambda state, _t: np.outer(vector_field(problem, np.asarray(state)), problem.c)  # noqa: E731  (the same)
    theirs = sdeint.stratHeun(f, G, y, np.array([0.0, h]), dW=dW[None])[-1]
    assert np.array_equal(strat_heun.step(problem, y, h, dW), theirs)


def test_strat_heun_converges_rightly_and_keeps_nothing() -> None:
    report = verify(
        strat_heun, laws=["contract", "energy", "casimir"], effort=Effort(examples=2, shrink_checks=10)
    )
    assert report.finding("contract").verdict is Verdict.HOLDS
    for law in ("energy", "casimir"):
        finding = report.finding(law)
        assert finding.verdict is Verdict.VIOLATED
        assert finding.witness is not None
        assert "--replay" in finding.replay


def test_ito_euler_given_stratonovich_coefficients_is_caught_at_the_wrong_limit() -> None:
    laws = ["right-limit", "mean-square-order"]
    report = verify(ito_euler, laws=laws, problems="pendulum", effort=Effort(paths=256))
    assert report.finding("right-limit").verdict is Verdict.VIOLATED
    assert report.finding("mean-square-order").verdict is Verdict.VIOLATED
    assert report.exit_code == 1
