"""A threshold with a unit, as libraries of particles have, is no fault of an integrator without noise."""

from functools import partial

import numpy as np
import pytest

import sepv
from sepv.problem import mechanics


def verlet(problem, y, h, dW, *, threshold):
    """Velocity Verlet that keeps the force where positions move by less than a threshold, as ASE's calculators do."""
    system = mechanics(problem)
    q, p = system.split(y)
    force = system.force(q)
    p = p + h / 2 * force
    moved = q + h * system.velocity(p)
    if not np.allclose(moved, q, rtol=1e-15, atol=threshold):
        force = system.force(moved)
    return system.join(moved, p + h / 2 * force)


@pytest.mark.parametrize(("threshold", "verdict"), [(1e-15, "holds"), (1e-6, "violated")])
def test_a_threshold_is_found_where_usual_states_meet_it_alone(threshold, verdict):
    step = partial(verlet, threshold=threshold)
    scheme = sepv.Scheme("verlet", step, claims=["symmetry"], order=2, systems="mechanical")
    report = sepv.verify(scheme, laws="symmetry,reversibility")
    assert {finding.verdict.text for finding in report.findings} == {verdict}
