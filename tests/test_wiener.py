"""Wiener increments: one path over all step sizes, the same for any batch, truncated as Remark 2.1 says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sepv import wiener
from sepv.errors import UsageError


def test_refined_paths_agree_on_the_coarse_grid() -> None:
    fine = wiener.increments(3, T=2.0, steps=96, noises=2, paths=70)
    for factor in (2, 4, 8, 16, 32):
        coarse = wiener.increments(3, T=2.0, steps=96 // factor, noises=2, paths=70)
        # Each halving rounds once; 32 summands of size ≤ 2.
        assert np.max(np.abs(coarse - wiener.coarsen(fine, factor))) < 1e-14


def test_the_same_path_comes_out_for_any_batch_size() -> None:
    whole = wiener.increments(5, T=1.0, steps=12, noises=2, paths=200)
    assert np.array_equal(wiener.increments(5, T=1.0, steps=12, noises=2, paths=3), whole[:, :, :3])
    assert np.array_equal(
        wiener.increments(5, T=1.0, steps=12, noises=2, paths=range(63, 130)), whole[:, :, 63:130]
    )
    assert np.array_equal(
        wiener.increments(5, T=1.0, steps=12, noises=2, paths=range(199, 200)), whole[:, :, 199:]
    )


def test_other_seeds_and_paths_are_other_numbers() -> None:
    a, b = (wiener.increments(seed, T=1.0, steps=4, noises=1, paths=128) for seed in (0, 1))
    assert np.unique(np.concatenate([a, b])).size == a.size + b.size


def test_increments_are_independent_normals_of_variance_h() -> None:
    steps, paths, h = 16, 20_000, 1 / 16
    z = wiener.increments(11, T=1.0, steps=steps, noises=2, paths=paths) / math.sqrt(h)
    flat = z.reshape(32, paths)
    covariance = flat @ flat.T / paths
    # 528 entries, each within 6 standard errors (√2/√M on the diagonal): false alarms below 1e-6 for
    # a fresh seed, none for this one.
    assert np.max(np.abs(covariance - np.eye(32))) < 6 * math.sqrt(2 / paths)
    assert abs(np.mean(z**4) - 3) < 6 * math.sqrt(96 / z.size)


@pytest.mark.parametrize(("h", "k"), [(0.01, 2), (0.5, 1), (2**-9, 6)])
def test_truncation_is_that_of_the_remark(h: float, k: int) -> None:
    bound = math.sqrt(2 * k * abs(math.log(h)))
    assert wiener.truncation_bound(h, k) == bound
    x = np.array([-10.0, -0.5, 0.0, 0.5, 10.0]) * math.sqrt(h)
    assert wiener.truncate(x, h, k) == pytest.approx(
        np.clip(x, -bound * math.sqrt(h), bound * math.sqrt(h)), rel=1e-15
    )
    assert np.array_equal(wiener.truncate(x, h, None), x)


@pytest.mark.parametrize("h", [1.0, 1.5, 0.0, -0.1, float("nan")])
def test_truncation_beyond_its_range_is_refused(h: float) -> None:
    with pytest.raises(UsageError, match="0 < h < 1"):
        wiener.truncate(np.zeros(3), h)


@pytest.mark.parametrize("k", [0, -1, 1.5])
def test_truncation_parameter_must_be_a_positive_integer(k: float) -> None:
    with pytest.raises(UsageError, match="integer ≥ 1"):
        wiener.truncate(np.zeros(3), 0.1, k)  # type: ignore[arg-type]  # on purpose


@pytest.mark.parametrize(
    "wrong",
    [
        {"seed": -1},
        {"seed": 1.5},
        {"T": 0.0},
        {"T": float("inf")},
        {"steps": 0},
        {"noises": -1},
        {"paths": 0},
        {"paths": range(-1, 3)},
        {"refine": 5},
    ],
)
def test_wrong_arguments_are_refused(wrong: dict[str, float]) -> None:
    arguments = {"seed": 0, "T": 1.0, "steps": 4, "noises": 1, "paths": 1, **wrong}
    with pytest.raises(UsageError, match="Expected"):
        wiener.increments(arguments.pop("seed"), **arguments)  # type: ignore[arg-type]  # on purpose


def test_no_noise_gives_no_increments() -> None:
    assert wiener.increments(0, T=1.0, steps=4, noises=0, paths=2).shape == (4, 0, 2)


def test_coarsening_by_no_divisor_is_refused() -> None:
    with pytest.raises(UsageError, match="divisible"):
        wiener.coarsen(np.zeros((5, 1)), 2)
