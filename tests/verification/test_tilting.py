"""Importance sampling of errors: the Wiener measure's means, to the accuracy that their intervals say."""

from dataclasses import replace

import numpy as np
import pytest
from sepv.properties._orders.convergence import slope, strong_errors
from sepv.properties._orders.tilting import tilted_errors, tilted_increments

from sepv import problems, schemes


@pytest.mark.parametrize("c", [(1.0,), (1.0, 0.5, 0.0)])
def test_weighted_moments_are_those_of_normal_increments(c: tuple[float, ...]) -> None:
    """E 1, E ξ², E ξ⁴ and E ξ¹⁰ along c, and E ξ² across, each within 5 standard errors: false alarms below 1e-5."""
    paths, steps = 40_000, 8
    rng, how = np.random.default_rng(1), {"T": 2.0, "steps": steps, "paths": paths, "powers": (10, 6)}
    dW, w = tilted_increments(rng, np.array(c), **how)
    xi = dW / np.sqrt(2.0 / steps)
    along = np.einsum("j,njm->nm", np.array(c) / np.linalg.norm(c), xi)
    assert w.max() <= 3
    for power, moment in ((0, 1.0), (2, 1.0), (4, 3.0), (10, 945.0)):
        found = w * np.mean(along**power, axis=0)
        assert abs(found.mean() - moment) <= 5 * found.std() / np.sqrt(paths)
    across = w * np.mean(xi[:, -1] ** 2, axis=0)
    assert abs(across.mean() - 1) <= 5 * across.std() / np.sqrt(paths)
    for n in range(steps):  # no step is treated differently
        found = w * along[n] ** 4
        assert abs(found.mean() - 3) <= 5 * found.std() / np.sqrt(paths)


def test_tilted_and_plain_means_agree_where_both_can_be_had() -> None:
    """Order 1 without truncation, where plain sampling has no difficulty: within 10 %, some 5 standard errors."""
    problem, paths = problems.rigid_body(), range(1024)
    scheme = replace(schemes.energy_preserving, truncation=None)
    plain = strong_errors(scheme, problem, T=1.0, steps=(16, 64), paths=paths, seed=2).rms()
    tilted = tilted_errors(scheme, problem, T=1.0, steps=(16, 64), paths=paths, seed=2, order=1.0).rms()
    assert np.all(np.abs(tilted / plain - 1) < 0.1)


def test_slopes_of_order_four_need_few_paths() -> None:
    scheme, problem = schemes.collocation(4), problems.rigid_body()
    errors = tilted_errors(scheme, problem, T=1.0, steps=(32, 64), paths=range(512), seed=0, order=4.0)
    found = slope(errors, 0.01)
    assert found.half < 0.3
    assert abs(found.value - 4) < found.half


def test_chunks_are_the_same_whatever_is_asked_for_with_them() -> None:
    problem, options = problems.pendulum(), {"T": 1.0, "steps": (16,), "seed": 0, "order": 2.0}
    both = tilted_errors(schemes.collocation(2), problem, paths=range(512), **options)
    second = tilted_errors(schemes.collocation(2), problem, paths=range(256, 512), **options)
    assert np.array_equal(both.squared[:, 256:], second.squared)
