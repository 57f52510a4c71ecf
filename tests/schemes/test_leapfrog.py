"""The leapfrog and its compositions: the same step for either order of y, a batch, and the compiled engine."""

from __future__ import annotations

import numpy as np
import pytest

import sepv
from sepv import problems, schemes
from sepv.errors import Skipped
from sepv.problem import Systems, mechanics
from sepv.verification._cases.classes import CLASSES

LEAPFROG = schemes.by_name("leapfrog")
ALL = tuple(schemes.by_name(name) for name in ("leapfrog", "yoshida-4", "blanes-moan-4"))


def test_it_is_kick_drift_kick_for_every_mass_and_either_order_of_y() -> None:
    cases = [case.build() for _, case in CLASSES[Systems.MECHANICAL].space.part().cases(3)[:12]]
    kepler = problems.kepler()
    for problem, y, h, dW in (*cases, (kepler, np.asarray(kepler.initial), 0.1, np.array([0.05]))):
        m, dt = mechanics(problem), problem.random_step(h, dW)
        q, p = m.split(y)
        p = p + dt / 2 * m.force(q)
        q = q + dt * m.velocity(p)
        expected = m.join(q, p + dt / 2 * m.force(q))
        np.testing.assert_allclose(
            LEAPFROG.step(problem, y, h, dW), expected, rtol=1e-13, atol=1e-13 * np.abs(y).max()
        )


@pytest.mark.parametrize("scheme", ALL, ids=lambda s: s.name)
def test_the_engine_and_numpy_agree(scheme: sepv.Scheme) -> None:
    pytest.importorskip("numba")
    run = {"h": 1 / 16, "steps": 32, "paths": 5, "seed": 3}
    ends = [sepv.ensemble(scheme, problems.henon_heiles(), engine=e, **run).y for e in ("compiled", "numpy")]
    np.testing.assert_allclose(*ends, rtol=1e-12, atol=1e-13)


def test_other_problems_are_left_out() -> None:
    with pytest.raises(Skipped, match="not mechanical"):
        LEAPFROG.step(problems.rigid_body(), np.ones(3), 0.1, np.zeros(1))
