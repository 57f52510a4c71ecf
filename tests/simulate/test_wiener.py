"""Wiener increments on all step sizes, rules for expectations over them,
and what clipping them as Remark 2.1 costs.
"""

import math

import mpmath
import numpy as np
import pytest
from sepv.properties._orders.gaussian import rule
from sepv.properties._orders.tilting import tilted_errors
from sepv.reference.increments import bound, lost_variance, moment, truncated_moment

from sepv import UsageError, exact_flow, problems, schemes
from sepv.core.arrays import EPS
from sepv.exact import clipping_error
from sepv.exact._truncation_error import lost_mean_square
from sepv.schemes._scheme import truncation_for
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
    # 528 entries, each within 6 standard errors (√2/√M on the diagonal): false alarms below 1e-6
    # for a fresh seed, none for this one.
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
    """SFC64 of numpy is set to the unmixed words and asked for 18 numbers:
    it stands where the stream begins.
    """
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
    """Which of the two halves gets + z decides how steps refine, and is fixed for good:
    level 1 of two steps.
    """
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


STEPS = (2.0**-2, 2.0**-6, 2.0**-13, 2.0**-40)


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize(("k", "degree"), [(1, 4), (2, 4), (4, 6), (12, 14), (None, 6)])
def test_moments_of_one_increment_are_those_of_the_closed_forms(h: float, k: int | None, degree: int) -> None:
    """Gauss rules on panels are exact for even powers up to the degree; a few roundings are
    left.
    """
    nodes = rule(1, h, k, degree)
    assert np.all(nodes.weights > 0)
    (xi,), (zeta,) = nodes.xi, nodes.zeta[:, nodes.index]
    for p in range(0, degree + 1, 2):
        assert nodes.weights @ xi**p == pytest.approx(float(moment(p)), rel=1e-13)
        assert abs(nodes.weights @ xi ** (p + 1)) <= 1e-13 * float(moment(p + 2))
        if k is not None:
            assert nodes.weights @ zeta**p == pytest.approx(float(truncated_moment(h, k, p)), rel=1e-13)


@pytest.mark.parametrize("h", STEPS)
def test_what_clipping_loses_is_seen_to_all_digits(h: float) -> None:
    """E[ξ² − ζ²] as small as h^12 is a sum over the tails alone: no cancellation."""
    for k in (1, 2, 12):
        nodes = rule(1, h, k, 4)
        lost = nodes.weights @ (nodes.xi[0] ** 2 - nodes.zeta[0, nodes.index] ** 2)
        assert lost == pytest.approx(float(lost_variance(h, k)), rel=1e-10)
        assert np.max(np.abs(nodes.zeta)) == pytest.approx(float(bound(h, k)), rel=1e-15)


@pytest.mark.parametrize("noises", [0, 1, 2, 3, 4, 5, 6, 9])
def test_several_increments_are_independent_standard_normals(noises: int) -> None:
    nodes = rule(noises, 2.0**-10, 2, 4)
    assert nodes.xi.shape == (noises, nodes.weights.size)
    assert np.all(nodes.weights > 0)
    assert nodes.weights.sum() == pytest.approx(1, abs=1e-14)
    assert (nodes.weights * nodes.xi) @ nodes.xi.T == pytest.approx(np.eye(noises), abs=1e-13)
    assert nodes.xi @ nodes.weights == pytest.approx(np.zeros(noises), abs=1e-13)
    A = float(bound(2.0**-10, 2))
    assert np.array_equal(nodes.zeta[:, nodes.index], np.clip(nodes.xi, -A, A))


def test_the_scheme_is_asked_once_for_increments_that_it_sees_as_equal() -> None:
    nodes = rule(2, 2.0**-10, 2, 4)
    assert len(set(map(tuple, nodes.zeta.T))) == nodes.zeta.shape[1] < nodes.xi.shape[1]


@pytest.mark.parametrize("A", [0.0, 0.5, 2.0, 5.0, 12.0])
def test_the_mean_square_of_what_is_clipped_is_an_integral(A: float) -> None:
    ctx = mpmath.mp.clone()
    ctx.dps = 40
    exact = 2 * ctx.quad(lambda x: (x - A) ** 2 * ctx.npdf(x), [A, A + 4, A + 30])
    # Its two terms cancel to 2/A⁴ of their size.
    assert lost_mean_square(A) == pytest.approx(float(exact), rel=16 * EPS * (1 + A**4))


@pytest.mark.parametrize(("problem", "k"), [(problems.rigid_body(), 1), (problems.pendulum(), 2)])
def test_clipping_alone_moves_the_end_as_far_as_it_says(problem: problems.Problem, k: int) -> None:
    """The exact flow at the clipped and at the unclipped random time, 20000 paths of 8 steps."""
    raw = wiener.increments(3, T=1.0, steps=8, noises=problem.noises, paths=20_000)
    cut = bounded.truncate(raw, 1 / 8, k)
    ends = [exact_flow(problem, problem.random_step(1.0, dW.sum(axis=0))).y for dW in (raw, cut)]
    squared = np.sum((ends[0] - ends[1]) ** 2, axis=0)
    error = float(np.std(squared)) / math.sqrt(squared.size)
    # Six standard errors of the sample, 2e-9 of false alarm, and a tenth for the higher orders of
    # what is cut off.
    said = clipping_error(problem, T=1.0, steps=8, k=k) ** 2
    assert abs(said - squared.mean()) < 6 * error + 0.1 * said
    assert 6 * error < 0.6 * said


def test_what_clipping_costs_on_the_rigid_body() -> None:
    """The figures of docs/higher-order.md, by the formula at a glance:
    |f|² = 0.43 to 0.55 on the way, T = c = 1.
    """
    body = problems.rigid_body()
    for steps, k, expected in ((128, 2, 7.0e-4), (128, 4, 3.4e-6), (128, 6, 2.0e-8), (8, 8, 1.5e-5)):
        found = clipping_error(body, T=1.0, steps=steps, k=k)
        A = bounded.truncation_bound(1 / steps, k)
        assert found == pytest.approx(expected, rel=0.12)
        assert 0.6 < found / math.sqrt(lost_mean_square(A)) < 0.8
    assert clipping_error(body, T=1.0, steps=8, k=None) == 0
    assert clipping_error(problems.rigid_body(noise=()), T=1.0, steps=8, k=2) == 0
    with pytest.raises(UsageError, match="0 < h < 1"):
        clipping_error(body, T=1.0, steps=1, k=2)


@pytest.mark.parametrize("s", [2, 3, 4])
def test_clipping_costs_little_beside_the_errors_of_a_scheme(s: int) -> None:
    """With the default k = 4s a tenth of the error of 8 steps; with k = 2s as much as that error,
    and more.
    """
    body, scheme = problems.rigid_body(), schemes.collocation(s)
    assert scheme.truncation == truncation_for(s) == 4 * s
    own = tilted_errors(scheme, body, T=1.0, steps=(8,), paths=range(512), seed=1, order=s).rms()[0]
    costs = [clipping_error(body, T=1.0, steps=8, k=k) for k in (4 * s, 2 * s)]
    assert costs[0] < 0.1 * own
    assert costs[1] > 0.5 * own
