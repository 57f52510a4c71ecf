"""Faults that real programs had: the law that states each finds it with ten seeds, and the right method has none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sepv.reference.faults import detection as fault_detection
from sepv.reference.faults.saboteurs import SABOTEURS, historical

from sepv import problems
from sepv.verification import Effort, Verdict, verify

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "teeth.md").read_text(encoding="utf-8")
NAMES = [s.name for s in historical.SABOTEURS]


@pytest.mark.parametrize("seeds", [range(3), pytest.param(range(3, 10), marks=pytest.mark.deep)], ids=str)
@pytest.mark.parametrize("name", NAMES)
def test_the_law_that_states_the_fault_finds_it_with_each_of_ten_seeds(name: str, seeds: range) -> None:
    # The first that is named: not any law which happens to see it.
    law = SABOTEURS[name].caught_by[0]
    for seed in seeds:
        (detection,) = fault_detection.detect(name, seed, [law], 12, 4096)
        assert detection.kills, (seed, detection.verdict)


@pytest.mark.parametrize("name", NAMES)
def test_each_names_its_thread(name: str) -> None:
    assert SABOTEURS[name].thread.startswith(("https://github.com/", "docs/peers/"))
    (row,) = [line for line in PAGE.splitlines() if line.startswith(f"| {name} | ")]
    assert SABOTEURS[name].broken in row
    assert f"*{SABOTEURS[name].caught_by[0]}*" in row
    assert SABOTEURS[name].thread.split()[0].rstrip(",;:") in row


@pytest.mark.parametrize(
    "scheme", {s.name: s for s in historical.RIGHT.values()}.values(), ids=lambda s: s.name
)
def test_the_method_without_the_fault_keeps_the_laws_that_the_faults_break(scheme) -> None:
    laws = {law for s in historical.SABOTEURS if historical.RIGHT[s.name] is scheme for law in s.caught_by}
    claimed = [law for law in laws if law in scheme.claims or law in ALL_ORDERS]
    report = verify(scheme, laws=claimed, effort=Effort(examples=5, paths=4096, shrink_checks=0))
    assert {f.law: f.verdict for f in report.findings if f.claimed} == {
        f.law: Verdict.HOLDS for f in report.findings if f.claimed
    }


ALL_ORDERS = (
    "local-mean",
    "local-mean-square",
    "local-weak",
    "mean-square-order",
    "weak-order",
    "right-limit",
)


def test_with_one_noise_and_one_law_the_faults_of_several_noises_do_not_show() -> None:
    """Why they lived so long: with one noise, c = 1, each is the right method."""
    problem = problems.rigid_body(noise=(1.0,))
    y, dW = np.array([0.3, 0.5, 0.7]), np.array([0.2])
    for name in (
        "friction-inverted",
        "variance-for-deviation",
        "noises-crossed",
        "cross-terms-dropped",
        "as-many-noises-as-components",
    ):
        right = historical.RIGHT[name].step(problem, y, 0.125, dW)
        np.testing.assert_allclose(
            SABOTEURS[name].scheme.step(problem, y, 0.125, dW), right, rtol=0, atol=1e-15
        )
