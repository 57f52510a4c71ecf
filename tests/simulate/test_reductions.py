"""Moments and quantiles, merged chunk by chunk, are those of all values at once."""

import math
from typing import Any

import numpy as np
import pytest
from engines import EP, PENDULUM, backwards, position
from hypothesis import given
from hypothesis import strategies as st

import sepv
from sepv.simulate._results.reductions import FEWEST, Summary, summary
from sepv.simulate._results.sketch import ACCURACY, Sketch, sketch

SMALL: dict[str, Any] = {"h": 1 / 16, "T": 0.5, "paths": 3000, "chunk": 256, "seed": 5}
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)


def energy(ends: Any) -> Any:
    return PENDULUM.hamiltonian(ends.y)


BOTH = {"q": position, "H": energy}


@given(st.lists(NUMBERS, min_size=1, max_size=60), st.floats(0, 1))
def test_a_quantile_is_within_its_accuracy_of_the_order_statistic(values: list[float], p: float) -> None:
    found = sketch(values).quantile(p)
    exact = sorted(values)[math.floor(p * (len(values) - 1))]
    # The logarithm is rounded, which moves an edge between buckets by some eps·ln|x| of the number.
    assert abs(found - exact) <= ACCURACY * (1 + 1e-9) * abs(exact) + np.finfo(float).tiny


@given(st.lists(NUMBERS, max_size=30), st.lists(NUMBERS, max_size=30))
def test_sketches_merge_exactly_and_in_any_order(one: list[float], other: list[float]) -> None:
    whole, left, right = sketch([*one, *other]), sketch(one), sketch(other)
    for merged in (left.merge(right), right.merge(left)):
        assert np.array_equal(merged.keys, whole.keys)
        assert np.array_equal(merged.counts, whole.counts)


def test_moments_of_a_known_sample() -> None:
    found = summary(np.array([1.0, 2.0, 3.0, 4.0]), np.zeros(4, dtype=int))
    assert (found.mean, found.variance, found.skewness) == (2.5, 5 / 3, 0.0)
    assert found.kurtosis == pytest.approx(1.64)
    assert found.standard_error == pytest.approx(math.sqrt(5 / 12))
    assert (found.quantile(0), found.quantile(1)) == (1.0, 4.0)
    assert math.isnan(Summary().standard_error)
    with pytest.raises(sepv.UsageError, match="at least one number"):
        Sketch().quantile(0.5)


def test_failed_paths_and_values_that_are_none_are_left_out_and_counted() -> None:
    found = summary(np.array([1.0, np.nan, 5.0, np.inf]), np.array([0, 0, 2, 0]))
    assert (found.count, found.failed, found.not_finite, found.mean) == (1, 1, 2, 1.0)
    with np.errstate(over="raise"):
        assert summary(np.array([1e200, -1e200]), np.zeros(2, dtype=int)).variance == math.inf


def test_an_ensemble_that_is_reduced_keeps_no_path_and_says_the_same() -> None:
    whole = sepv.ensemble(EP, PENDULUM, **SMALL)
    found = sepv.ensemble(EP, PENDULUM, reduce=BOTH, **SMALL)
    assert found.y.shape == (2, 0)
    assert found.gradient_evaluations == whole.gradient_evaluations
    q = found.reduced["q"]
    assert (q.count, q.failed) == (3000, 0)
    assert q.mean == pytest.approx(whole.y[0].mean(), rel=1e-13)
    assert q.variance == pytest.approx(whole.y[0].var(ddof=1), rel=1e-12)
    assert (q.minimum, q.maximum) == (whole.y[0].min(), whole.y[0].max())
    # The sums of twelve chunks, from the mean of all.
    off = whole.y[0] - whole.y[0].mean()
    for k, total in enumerate(q.sums, start=2):
        assert total == pytest.approx(np.sum(off**k), abs=1e-12 * np.sum(np.abs(off) ** k))
    median = np.sort(whole.y[0])[1499]
    assert abs(q.quantile(0.5) - median) <= ACCURACY * abs(median)


def test_the_bits_of_a_reduction_are_the_same_for_any_workers() -> None:
    one = sepv.ensemble(EP, PENDULUM, reduce=BOTH, **SMALL).reduced
    for workers in (2, map, backwards):
        other = sepv.ensemble(EP, PENDULUM, reduce=BOTH, workers=workers, **SMALL).reduced
        for name in BOTH:
            assert (one[name].mean, one[name].sums) == (other[name].mean, other[name].sums)
            assert np.array_equal(one[name].sketch.counts, other[name].sketch.counts)


def test_it_stops_at_the_first_chunk_that_reaches_the_error_for_any_workers() -> None:
    arguments = SMALL | {"paths": 10**6, "chunk": 512}
    found = [
        sepv.ensemble(EP, PENDULUM, reduce=BOTH, until={"q": 0.02}, workers=w, **arguments).reduced["q"]
        for w in (1, 2, map)
    ]
    assert len({(q.count, q.mean) for q in found}) == 1
    assert found[0].standard_error <= 0.02
    assert FEWEST <= found[0].count < 10**5
    before = sepv.ensemble(EP, PENDULUM, reduce=BOTH, **arguments | {"paths": found[0].count - 512}).reduced[
        "q"
    ]
    assert before.standard_error > 0.02 or before.count < FEWEST


def test_an_interrupted_reduction_has_the_first_chunks() -> None:
    def interrupt(done: int, _all: int) -> None:
        if done >= 512:
            raise KeyboardInterrupt

    with pytest.raises(sepv.Interrupted) as kept:
        sepv.ensemble(EP, PENDULUM, reduce=BOTH, progress=interrupt, **SMALL)
    assert kept.value.paths == range(512)
    assert kept.value.ensemble.reduced["q"].count == 512
