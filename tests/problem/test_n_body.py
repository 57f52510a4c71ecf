"""Bodies that attract each other: first integrals, the closed mean of ∇H, the orbit that closes."""

import numpy as np
import pytest

from sepv import problems
from sepv.exact import exact_flow
from sepv.problem import Problem
from sepv.record._binary64 import EPS

BODIES = [problems.planets(noise=()), problems.figure_eight(noise=())]
BODIES += [problems.planets((1000.0, 1.0), (2.0,), (0.3,), noise=())]


def momenta(y: np.ndarray) -> np.ndarray:
    """Total momentum and angular momentum of states y (d, M), as (3, M)."""
    q, p = (half.reshape(-1, 2, y.shape[1]) for half in np.split(y, 2))
    turning = (q[:, 0] * p[:, 1] - q[:, 1] * p[:, 0]).sum(axis=0)
    return np.concatenate([p.sum(axis=0), turning[None]])


@pytest.mark.parametrize("problem", BODIES, ids=lambda problem: f"{problem.name}-{problem.dimension}")
def test_the_flow_keeps_momentum_and_angular_momentum(problem: Problem) -> None:
    y = np.asarray(problem.initial)
    kept = momenta(np.column_stack([y, exact_flow(problem, np.array([0.5, 3.0])).y]))
    assert np.abs(kept[:2]).max() < 1e-13
    assert np.ptp(kept[2]) < 1e-13 * max(1.0, abs(kept[2, 0]))
    field = problem.structure(y) @ problem.gradient(y)
    assert np.abs(momenta((y + 1e-30j * field)[:, None]).imag).max() < 1e-30 * 64 * EPS


WITH_MEANS = [*BODIES, problems.kepler(), problems.toda()]


@pytest.mark.parametrize("problem", WITH_MEANS, ids=lambda problem: f"{problem.name}-{problem.dimension}")
def test_the_mean_gradient_is_that_of_fine_quadrature(problem: Problem) -> None:
    rng = np.random.default_rng(3)
    y0 = np.asarray(problem.initial)[:, None] + 0.01 * rng.standard_normal((problem.dimension, 20))
    y1 = y0 + 0.02 * rng.standard_normal(y0.shape)
    nodes, weights = np.polynomial.legendre.leggauss(24)
    fine = sum(
        w / 2 * problem.gradient(y0 + (1 + x) / 2 * (y1 - y0)) for x, w in zip(nodes, weights, strict=True)
    )
    assert problem.mean_gradient is not None
    mean = problem.mean_gradient(y0, y1)
    # Some dozens of roundings of the largest terms.
    assert np.abs(mean - fine).max() < 256 * EPS * np.abs(fine).max()


def test_a_light_planet_of_axis_1_has_the_period_2_pi() -> None:
    alone = problems.planets((1e9, 1.0), (1.0,), (0.2,), noise=())
    assert exact_flow(alone, np.array([2 * np.pi])).y[2:4, 0] == pytest.approx(alone.initial[2:4], abs=1e-8)


def test_the_eight_closes() -> None:
    """Simó's initial state has eight digits, and so has the period."""
    eight = problems.figure_eight(noise=())
    assert exact_flow(eight, np.array([6.32591398])).y[:, 0] == pytest.approx(
        np.asarray(eight.initial), abs=2e-7
    )
