"""Paths that leave a compact set: the bound of `benchmarks.exits`, and what rests on it."""

import numpy as np
import pytest

from benchmarks.exits import SETS, bound, measured, moments

PATHS = 400


@pytest.fixture(scope="module")
def pendulum():
    return SETS["pendulum"][0]()


@pytest.mark.parametrize(
    ("scheme", "limit_of", "steps", "within"),
    [
        ("midpoint", "midpoint", 16, True),
        ("euler-heun", "euler-heun", 64, True),
        ("euler-maruyama", "midpoint", 16, False),
    ],
)
def test_no_more_paths_leave_than_the_bound_allows(pendulum, scheme, limit_of, steps, within) -> None:
    """The lower end of a one-sided interval of level 1e-6, the false-alarm rate of this test.

    Euler-Maruyama drifts, and leaves D more often than the midpoint rule may.
    """
    low, _ = measured(pendulum, scheme, steps, PATHS).interval(2e-6)
    allowed = bound(pendulum, limit_of, steps)
    assert allowed < 1
    assert (low <= allowed) == within


def test_the_energy_preserving_scheme_never_leaves_and_its_bound_is_rounding(pendulum) -> None:
    found = measured(pendulum, "energy-preserving", 16, PATHS)
    assert found.left == 0
    assert bound(pendulum, "energy-preserving", 16) < 1e-24


def test_errors_of_paths_that_stay_have_order_one(pendulum) -> None:
    """Halved four times with h; 400 paths on the same seeds, where the ratio's spread is some per cent."""
    coarse, fine = (measured(pendulum, "midpoint", n, PATHS).rms for n in (16, 64))
    assert 2.5 < coarse / fine < 7


def test_the_moments_of_a_step_fall_as_theory_says(pendulum) -> None:
    """The midpoint rule moves H by Δ³G + O(Δ⁴): m = O(h²), v = O(h³)."""
    (m0, v0), (m1, v1) = (moments(pendulum, "midpoint", h) for h in (2.0**-8, 2.0**-10))
    assert np.log2(m0 / m1) / 2 == pytest.approx(2, abs=0.15)
    assert np.log2(v0 / v1) / 2 == pytest.approx(3, abs=0.15)


def test_energy_and_casimir_of_lotka_volterra_bound_a_compact_set() -> None:
    """With u = ln y2, v = ln y3 and C = C(y0), H = 2 exp(C − (u + v)/2) + e^u + 2e^v + u − 2v is convex.

    Of all directions only zero has −(u + v), u, v ≤ 0: H grows in each, and far out exceeds H(y0).
    """
    D = SETS["lotka-volterra"][0]()
    y0 = np.asarray(D.problem.initial)
    C0, angles = float(D.F(y0)), np.linspace(0, 2 * np.pi, 720)
    u, v = 12 * np.array([np.cos(angles), np.sin(angles)])
    y = np.array([np.exp(C0 - 0.5 * (u + v)), np.exp(u), np.exp(v)])
    assert np.allclose(D.F(y), C0, atol=1e-10)
    formula = 2 * y[0] + y[1] + 2 * y[2] + u - 2 * v
    assert np.allclose(D.problem.hamiltonian(y), formula, rtol=1e-10)
    assert np.min(formula) > D.problem.hamiltonian(y0) + 1
