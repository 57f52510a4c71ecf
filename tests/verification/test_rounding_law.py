"""The law "rounding" tells a walk from a drift, by chance alone less than once in a million."""

import numpy as np
from sepv.properties import test_rounding as rounding
from sepv.reference.faults.saboteurs import SABOTEURS

from sepv.problem import Array
from sepv.verification import Verdict, verify

W = 0.144


def walks(seed: int, drift: float = 0.0, steps: int = 256) -> Array:
    """Defects of paths at the checkpoints: independent roundings of root mean square W, and a mean."""
    rng = np.random.default_rng(seed)
    D = np.cumsum(W * rng.standard_normal((steps, rounding.PATHS)) + drift * W, axis=0)
    return D[rounding.FIRST * 2 ** np.arange(int(np.log2(steps / rounding.FIRST)) + 1) - 1]


def violated(defects: Array, tolerance: float = 0.0) -> set[str]:
    return {r.name for r in rounding.judge(defects, W, tolerance) if r.size > r.allowed}


def test_walks_of_rounding_are_never_accused() -> None:
    # 500 walks at 2e-7 each: a false alarm of this test in ten thousand.
    assert all(not violated(walks(seed, 2.0**-10)) for seed in range(500))


def test_a_mean_is_seen_in_every_sample() -> None:
    # 0.133 a step is 34 standard errors after 2048 steps of 32 paths, and 16 after 256 steps of 60; 8 are allowed.
    assert all("drift" in violated(walks(seed, 0.133)) for seed in range(100))
    assert not any("size" in violated(walks(seed, 0.133)) for seed in range(100))


def test_paths_that_drift_each_in_its_own_direction_are_seen_by_their_growth() -> None:
    rng = np.random.default_rng(0)
    n = rounding.FIRST * 2.0 ** np.arange(4)[:, None]
    slopes = rng.standard_normal(rounding.PATHS)
    slopes -= slopes.mean()
    assert violated(walks(1) + 0.5 * n * W * slopes) == {"growth"}


def test_a_stated_tolerance_is_allowed_its_drift() -> None:
    assert violated(walks(0, 2.0)) >= {"drift", "growth"}
    assert not violated(walks(0, 2.0), tolerance=2 * 2.0 * W * 2.0**-52)


def test_a_nudge_of_one_sign_is_caught() -> None:
    (finding,) = verify(SABOTEURS["one-signed-nudge"].scheme, laws=["rounding"]).findings
    assert finding.verdict is Verdict.VIOLATED


def test_paths_with_other_roundings_are_judged_by_their_own() -> None:
    """From the origin roundings grow, on each path otherwise: 60 such paths looked like a drift of each."""
    rng = np.random.default_rng(5)
    checkpoints = rounding.FIRST * 2 ** np.arange(4)
    for _ in range(100):
        sizes = W * np.exp(rng.standard_normal(rounding.PATHS)) * np.linspace(0, 2, 256)[:, None]
        walk = np.cumsum(sizes * rng.standard_normal(sizes.shape), axis=0)[checkpoints - 1]
        widths = np.sqrt(np.cumsum(sizes**2, axis=0)[checkpoints - 1] / checkpoints[:, None])
        own, common = rounding.in_own_roundings(walk, widths)
        assert not [r.name for r in rounding.judge(own, common) if r.size > r.allowed]


def test_an_explosion_is_not_excused_by_what_it_reaches() -> None:
    own, common = rounding.in_own_roundings(
        np.full((4, 2), 1e150), np.array([[0.1, 0.1]] * 3 + [[1e120, 0.1]])
    )
    assert common < 0.2
    assert np.min(own) > 1e148
