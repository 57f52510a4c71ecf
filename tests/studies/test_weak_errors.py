"""Tests of the study of weak errors by paths that no exact path accompanies."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from benchmarks import weak_errors as study
from sepv import problems, schemes
from sepv.simulate import truncate


def _by_quadrature(scheme: str, nodes: int = 400) -> dict[str, float]:
    """E φ(y_2) of two steps of the oscillator with one noise,
    by the rectangle rule over both clipped increments.
    """
    problem = problems.harmonic_oscillator()
    h, x = study.WEAK_T / 2, np.linspace(-8, 8, nodes)
    weights = np.exp(-0.5 * x * x) / np.exp(-0.5 * x * x).sum()
    dW = truncate(np.sqrt(h) * x, h, 2)
    pairs = np.array(list(product(range(nodes), repeat=2))).T
    y = np.repeat(np.asarray(problem.initial)[:, None], pairs.shape[1], axis=1)
    for which in pairs:
        y = schemes.by_name(scheme).step(problem, y, h, dW[which][None])
    both = weights[pairs[0]] * weights[pairs[1]]
    return {name: float(f(y) @ both) for name, f in study.WEAK_FUNCTIONS.items()}


@pytest.mark.parametrize("scheme", ["energy-preserving", "euler-heun"])
def test_weak_errors_of_two_steps_are_those_by_quadrature(scheme: str) -> None:
    """Five standard errors: a false alarm has the probability 2e-6 for all three functions,
    over seeds.
    """
    problem = problems.harmonic_oscillator()
    assert problem.noises == 1
    exact, quadrature = study.expectations(problem), _by_quadrature(scheme)
    for found in study.weak_errors(problem, scheme, 2, paths=20_000, seed=3):
        true = quadrature[found.function] - exact[found.function]
        assert abs(found.error - true) < 5 * found.standard_error


def test_an_expectation_over_the_random_time_of_the_oscillator() -> None:
    """A rotation by θ ~ N(T, |c|²T): E e^{iθ} = e^{iT − |c|²T/2}."""
    problem = problems.harmonic_oscillator()
    p, q = map(float, problem.initial)
    z = (p + 1j * q) * np.exp(1j * study.WEAK_T - 0.5 * study.WEAK_T * float(np.sum(problem.c**2)))
    found = study.expectations(problem)
    assert (found["y1"], found["y2"]) == pytest.approx((z.real, z.imag), abs=1e-14)


def test_the_order_is_fitted_where_an_error_is_seen() -> None:
    points = [study.WeakError("s", "f", n, 0.3 * n**-2.0, 1e-5) for n in (4, 8, 16)]
    order, half = study.order([*points, study.WeakError("s", "f", 1024, 1e-6, 1e-5)])
    assert order == pytest.approx(2.0)
    assert 0 < half < 0.01
    assert np.isnan(study.order(points[:1])[0])
