"""A violation names the part of the step that makes nearly all of it, and no part where the fault is everywhere."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from sepv.reference.faults.saboteurs import SABOTEURS
from sepv.reference.faults.saboteurs.noise import _with

from sepv import verify
from sepv.verification import Effort, Verdict

EFFORT = Effort(examples=8, corpus=False)


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
    found = verify(_with(delta)(), laws=["reference"], effort=EFFORT).finding("reference")
    assert found.verdict is Verdict.VIOLATED
    assert named in found.message


@pytest.mark.parametrize(("name", "law"), [("b-at-y0", "reference"), ("one-point-quadrature", "energy")])
def test_a_fault_of_every_part_has_no_name(name: str, law: str) -> None:
    found = verify(SABOTEURS[name].scheme, laws=[law], effort=EFFORT).finding(law)
    assert found.verdict is Verdict.VIOLATED
    assert "nearly all of it" not in found.message
