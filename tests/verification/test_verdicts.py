"""The verdict matrix of the six schemes is what the paper proves and shows."""

from __future__ import annotations

import numpy as np
import pytest

from sepv import schemes
from sepv.verification import Effort, Verdict, load_laws, verify

ALWAYS = {"contract", "reproducibility", "truncation"}
KEPT = {
    "energy-preserving": {
        "identity", "energy", "casimir", "midpoint", "reduction", "noise-sum", "random-step", "expansion", "symmetry",
        "equivariance", "reference", "rounding",
    },
    "midpoint": {
        "identity", "casimir", "midpoint", "noise-sum", "random-step", "expansion", "symmetry", "equivariance",
    },
    "discrete-gradient": {"identity", "energy", "noise-sum", "rounding"},
    "euler-heun": {"noise-sum", "equivariance"},
    "milstein": {"noise-sum", "equivariance"},
    "euler-maruyama": {"equivariance"},
}  # fmt: skip
ABOUT_STEPS = KEPT["energy-preserving"] | ALWAYS


@pytest.mark.parametrize("name", schemes.PAPER)
def test_laws_about_steps_hold_exactly_where_theory_says(name: str) -> None:
    """Those that hold are claimed, and measured by the files of `properties`; all others are violated."""
    scheme, held = schemes.PAPER[name], KEPT[name] | ALWAYS
    assert scheme.claims & ABOUT_STEPS == held & ABOUT_STEPS
    others = ABOUT_STEPS - held
    if others:
        report = verify(name, laws=others, effort=Effort(shrink_checks=0))
        assert {f.law: f.verdict for f in report.findings} == dict.fromkeys(others, Verdict.VIOLATED)
        assert report.exit_code == 0


def test_every_law_has_a_source() -> None:
    assert all(law.source and law.statement and law.unit for law in load_laws())


@pytest.mark.parametrize(("scheme", "seed"), [("euler-heun", 2067189882), ("milstein", 743061144)])
def test_an_exploding_scheme_has_a_verdict_on_rounding(scheme: str, seed: int) -> None:
    """Explicit schemes with long steps of the rigid body: an energy of 1e300 ends in a verdict, not in a warning."""
    finding = verify(scheme, laws=["rounding"], effort=Effort(seed=seed)).findings[0]
    assert finding.verdict in (Verdict.VIOLATED, Verdict.ERROR)
    assert finding.defect is not None
    assert np.isfinite(finding.defect)
