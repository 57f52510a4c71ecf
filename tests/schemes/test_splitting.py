"""Splittings, leapfrogs, Gonzalez' scheme and the one of weak order 2: what their derivations say."""

import numpy as np

from sepv import problems, schemes
from sepv.problem import PolynomialSystem, Systems, mechanics
from sepv.record import _polynomial as poly
from sepv.schemes import ask
from sepv.verification import Case, Cases
from sepv.verification._cases.classes import CLASSES

LEAPFROG = schemes.by_name("leapfrog")


def test_it_is_kick_drift_kick_for_every_mass_and_either_order_of_y() -> None:
    cases = [case.build() for _, case in CLASSES[Systems.MECHANICAL].space.part().cases(3)[:12]]
    kepler = problems.kepler()
    for problem, y, h, dW in (*cases, (kepler, np.asarray(kepler.initial), 0.1, np.array([0.05]))):
        m, dt = mechanics(problem), problem.random_step(h, dW)
        q, p = m.split(y)
        p = p + dt / 2 * m.force(q)
        q = q + dt * m.velocity(p)
        expected = m.join(q, p + dt / 2 * m.force(q))
        found, size = LEAPFROG.step(problem, y, h, dW), np.abs(y).max()
        np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13 * size)


def test_gonzalez_steps_from_rest_and_by_nothing() -> None:
    pendulum = problems.pendulum()
    assert not schemes.gonzalez.step(pendulum, np.zeros(2), 0.25, np.array([0.5, 0.5])).any()
    y = np.array([0.2, 1.0])
    assert np.array_equal(schemes.gonzalez.step(pendulum, y, 0.25, np.array([-0.25, 0.0])), y)


def test_the_modified_scheme_solves_steps_of_every_stratum_of_the_cases() -> None:
    # Without the limiter 11 of these are refused: 3c²h|S₃| is then much larger than |B|.
    for _, drawn in Cases().space(Systems.SINGLE).cases(900034):
        assert np.all(np.isfinite(ask(schemes.modified_weak_two, *drawn.build())))


def test_a_difference_jacobian_from_zero_is_none_of_roundings() -> None:
    # e eᵀw turns with every direction: over a width of nothing its roundings once made a Jacobian of 1e299.
    H = poly.polynomial(2, {(1, 0): 0.046875, (0, 1): -0.05078125})
    system = PolynomialSystem(2, H, ((0, 1, poly.constant(2, 1.0)),), (1.0,))
    drawn = Case(system, (0.0, 0.0), 2.0**-9, (0.0,), "bare functions")
    y1 = ask(schemes.gonzalez, *drawn.build())
    np.testing.assert_allclose(y1, 2.0**-9 * np.array([-0.05078125, -0.046875]), rtol=1e-15)
