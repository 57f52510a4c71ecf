"""Schemes without noise, c = (): their cases, and laws that do not apply."""

from __future__ import annotations

import numpy as np
import pytest

import sepv
from sepv.errors import UsageError
from sepv.problem import Problem, Systems, mechanics
from sepv.verification._law import NO_NOISE


def verlet(problem: Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
    """A step of length h; any noise is a mistake of the suite."""
    assert problem.noises == 0
    assert dW.shape == (0, *y.shape[1:])
    m = mechanics(problem)
    q, p = m.split(y)
    p = p + h / 2 * m.force(q)
    q = q + h * m.velocity(p)
    return m.join(q, p + h / 2 * m.force(q))


def test_no_law_asks_for_noise() -> None:
    scheme = sepv.Scheme("verlet", verlet, order=2.0, batched=True)
    report = sepv.verify(scheme, problems=["mechanical", "kepler", "noisy-henon-heiles"])
    verdicts = {f.law: f.verdict.text for f in report.findings}
    assert not report.counts["error"], report
    for law in ("contract", "reproducibility", "identity", "symplecticity", "poisson-map", "symmetry"):
        assert verdicts[law] == "holds", report.finding(law).message
    silent = {f.law for f in report.findings if f.message == NO_NOISE}
    assert silent == {
        "noise-sum", "random-step", "expansion", "truncation", "local-mean", "local-mean-square", "local-weak",
        "mean-square-order", "weak-order", "right-limit", "commutation",
    }  # fmt: skip


def test_a_whole_class_without_noise() -> None:
    def step(problem: Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
        assert dW.size == 0
        return sepv.schemes.energy_preserving.step(problem, y, h, dW)

    scheme = sepv.Scheme(
        "avf", step, claims=["energy", "refusal", "reference", "rounding"], noise=False, batched=True
    )
    laws = "contract,identity,energy,casimir,reference,refusal,rounding,reduction,equivariance"
    verdicts = {f.law: f.verdict.text for f in sepv.verify(scheme, laws=laws).findings}
    assert set(verdicts.values()) == {"holds"}


def test_who_is_without_noise() -> None:
    def scheme(**facts: object) -> sepv.Scheme:
        return sepv.Scheme("verlet", verlet, **facts)  # type: ignore[arg-type]

    assert scheme(order=2).deterministic
    assert scheme(noise=False).deterministic
    assert not scheme().deterministic
    assert not scheme(order=2, mean_square_order=1.0).deterministic
    assert not scheme(order=2, noise=True).deterministic
    for facts in ({"mean_square_order": 1.0}, {"systems": Systems.ADDITIVE}):
        with pytest.raises(UsageError, match="without noise"):
            scheme(noise=False, **facts)
    with pytest.raises(UsageError, match="order, a number"):
        scheme(order=-1)
