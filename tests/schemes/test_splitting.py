"""Splittings, leapfrogs, Gonzalez' scheme and the one of weak order 2: what their derivations say."""

import numpy as np

import sepv
from sepv import problems, schemes
from sepv.problem import PolynomialSystem, Systems, mechanics
from sepv.record import _polynomial as poly
from sepv.schemes import ask
from sepv.verification import Case, Cases
from sepv.verification._cases.classes import CLASSES


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


def test_the_modified_scheme_keeps_energy_and_casimir_for_a_structure_of_degree_three() -> None:
    """B = (y1² + y2y3) hat(Ay), whose second derivative along f is not constant."""
    x = [poly.variable(3, k) for k in range(3)]
    g = poly.add(poly.multiply(x[0], x[0]), poly.multiply(x[1], x[2]))
    A = np.array([[1.0, 0.5, 0.0], [0.5, 2.0, 0.0], [0.0, 0.0, -1.0]])
    v = [poly.add(*(poly.scale(float(A[i, k]), x[k]) for k in range(3))) for i in range(3)]
    B = tuple(
        (i, j, poly.multiply(g, poly.scale(s, v[k])))
        for i, j, k, s in ((0, 1, 2, -1.0), (0, 2, 1, 1.0), (1, 2, 0, -1.0))
    )
    H = poly.polynomial(3, {(2, 0, 0): 0.5, (0, 4, 0): 0.25, (1, 0, 3): 0.5, (0, 1, 1): 1.0})
    problem = problems.build(PolynomialSystem(3, H, B, (1.0, 0.5), (tuple(map(tuple, A.tolist())),)))
    y0 = np.array([0.6, -0.4, 0.5])
    y1 = schemes.modified_weak_two.step(problem, y0, 0.0625, np.array([0.25, -0.125]))
    assert np.max(np.abs(y1 - y0)) > 1e-3
    assert abs(problem.hamiltonian(y1) - problem.hamiltonian(y0)) < 4e-16
    assert abs(y1 @ A @ y1 - y0 @ A @ y0) < 1e-15


def test_gonzalez_keeps_energy_and_quadratic_casimirs_and_no_others() -> None:
    rigid, volterra = problems.rigid_body(), problems.lotka_volterra()
    y = np.array(rigid.initial)
    y1 = schemes.gonzalez.step(rigid, y, 0.125, np.array([0.25]))
    assert abs(y1 @ y1 - y @ y) < 1e-15
    y = np.array(volterra.initial)
    y1 = schemes.gonzalez.step(volterra, y, 0.03125, np.array([0.0625]))
    assert abs(volterra.hamiltonian(y1) - volterra.hamiltonian(y)) < 4e-15
    assert volterra.nambu is not None
    assert abs(volterra.nambu.casimir(y1) - volterra.nambu.casimir(y)) > 1e-8


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
