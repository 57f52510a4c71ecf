"""Wiener increments: one path over all step sizes, the same for any batch, truncated as Remark 2.1 says."""

import math

import numpy as np
import pytest

from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener


def test_refined_paths_agree_on_the_coarse_grid() -> None:
    fine = wiener.increments(3, T=2.0, steps=96, noises=2, paths=70)
    for factor in (2, 4, 8, 16, 32):
        coarse = wiener.increments(3, T=2.0, steps=96 // factor, noises=2, paths=70)
        # Each halving rounds once; 32 summands of size ≤ 2.
        assert np.max(np.abs(coarse - wiener.coarsen(fine, factor))) < 1e-14


def test_the_same_path_comes_out_for_any_batch_size() -> None:
    whole = wiener.increments(5, T=1.0, steps=12, noises=2, paths=200)
    for paths in (range(3), range(63, 130), range(199, 200)):
        part = wiener.increments(5, T=1.0, steps=12, noises=2, paths=paths)
        assert np.array_equal(part, whole[:, :, paths.start : paths.stop])


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
    assert bounded.truncation_bound(h, k) == bound
    x = np.array([-10.0, -0.5, 0.0, 0.5, 10.0]) * math.sqrt(h)
    assert bounded.truncate(x, h, k) == pytest.approx(
        np.clip(x, -bound * math.sqrt(h), bound * math.sqrt(h)), rel=1e-15
    )
    assert np.array_equal(bounded.truncate(x, h, None), x)


def test_streams_are_those_of_numpy_after_its_mixing() -> None:
    """SFC64 of numpy is set to the unmixed words and asked for 18 numbers: it stands where the stream begins."""
    plan = wiener.grid(1 << 9)
    assert (plan.top, plan.halvings) == (6, 9)
    found = wiener.stream_states(7, range(5, 8), plan)
    a, b = np.random.SeedSequence(7).generate_state(2, np.uint64)
    bits = np.random.SFC64(0)
    for stream, level in enumerate((0, 7, 8, 9)):
        for k, path in enumerate(range(5, 8)):
            record = bits.state
            record["state"]["state"] = np.array([a, b, 64 * path + level, 1], dtype=np.uint64)
            bits.state = record
            bits.random_raw(18)
            assert bits.state["state"]["state"].tolist() == found[stream, :, k].tolist()


@pytest.mark.parametrize(("steps", "refine"), [(64, None), (768, None), (130, None), (300, 0), (1, None)])
def test_a_path_drawn_piece_by_piece_is_the_path(steps: int, refine: int | None) -> None:
    whole = wiener.increments(2, T=2.0, steps=steps, noises=2, paths=3, refine=refine)
    assert whole.shape == (steps, 2, 3)
    for size in (1, 5, 64, 10_000):
        pieces = list(wiener.walk(2, T=2.0, steps=steps, noises=2, paths=range(3), refine=refine, size=size))
        assert np.array_equal(np.concatenate(pieces), whole)
        assert max(map(len, pieces)) <= max(size, 64)  # what is held at once


def test_a_bridge_halves_with_the_deviation_at_its_first_half() -> None:
    """Which of the two halves gets + z decides how steps refine, and is fixed for good: level 1 of two steps."""
    plan, seed = wiener.grid(2), 9
    states = wiener.stream_states(seed, [0], plan)[0, :, 0]
    bits = np.random.SFC64(0)
    record = bits.state
    record["state"]["state"] = states
    bits.state = record
    coarse, z = np.random.Generator(bits).standard_normal(2)
    found = wiener.increments(seed, T=1.0, steps=2, noises=1)[:, 0, 0]
    assert found == pytest.approx([coarse / 2 + z / 2, coarse / 2 - z / 2], rel=1e-15)
    assert wiener.increments(seed, T=1.0, steps=1, noises=1)[0, 0, 0] == coarse


def test_defaults_are_one_path_and_the_truncation_of_the_paper() -> None:
    assert wiener.increments(0, T=1.0, steps=4, noises=1).shape == (4, 1, 1)
    assert wiener.increments(0, T=1.0, steps=4, noises=0, paths=2).shape == (4, 0, 2)
    far = np.array([-100.0, 100.0])
    assert np.array_equal(bounded.truncate(far, 0.1), bounded.truncate(far, 0.1, 2))
    assert bounded.truncate(far, 0.1, 3)[1] > bounded.truncate(far, 0.1, 2)[1]
    assert bounded.truncate([1, 2], 0.1, None).dtype == np.float64
    assert wiener.increments(0, T=1.0, steps=1, noises=1).shape == (1, 1, 1)
