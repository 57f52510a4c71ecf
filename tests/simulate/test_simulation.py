"""Paths and ensembles: the same numbers however they are asked for, reduced chunk by chunk,
and no failure unmarked.
"""

import math
from dataclasses import replace
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
import pytest
from drawn import EP, PENDULUM, backwards, position
from hypothesis import given
from hypothesis import strategies as st

import sepv
from sepv import problems, schemes
from sepv.core.newton import Status
from sepv.core.step import Solution
from sepv.errors import TruncationWarning
from sepv.schemes import continued, divided
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener
from sepv.simulate._batch import Batch, run_chunk
from sepv.simulate._results.reductions import TARGET_MIN_VALUES, Summary, summary
from sepv.simulate._results.sketch import ACCURACY, Sketch, sketch
from sepv.simulate._run_arguments import checked, step_count

# These are about the NumPy batch; the compiled engine has its own file.
ensemble = partial(sepv.ensemble, engine="numpy")


def test_a_path_of_an_ensemble_is_the_single_path() -> None:
    problem = problems.pendulum()
    many = ensemble(schemes.energy_preserving, problem, h=1 / 32, T=1.0, paths=70, seed=9)
    one = sepv.integrate(schemes.energy_preserving, problem, h=1 / 32, T=1.0, seed=9)
    assert np.array_equal(one.y[:, -1], many.y[:, 0])
    assert one.t[-1] == 1.0
    assert one.y.shape == (2, 33)
    assert many.gradient_evaluations > 0
    assert many.iterations >= 70 * 32
    few = ensemble(schemes.energy_preserving, problem, h=1 / 32, T=1.0, paths=5, seed=9, chunk=2)
    assert np.array_equal(few.y, many.y[:, :5])
    assert np.array_equal(few.W, many.W[:, :5])


def test_a_path_prints_its_first_and_its_last_state() -> None:
    path = sepv.integrate(EP, PENDULUM, h=0.25, T=1.0)
    for n in (0, 4):
        assert f"({path.y[0, n]:.6g}, {path.y[1, n]:.6g})" in repr(path)


def test_a_single_path_that_fails_is_an_error() -> None:
    """Path 0 of a seed is path 0 of its ensemble: at this step size 41 % of the paths meet a step
    without solution.
    """
    run = {"h": 1 / 8, "T": 1.0}
    problem, scheme = problems.lotka_volterra(), schemes.energy_preserving
    seed = next(s for s in range(20) if ensemble(scheme, problem, paths=1, seed=s, **run).status[0])
    with pytest.raises(sepv.StepFailure, match="Remedy"):
        sepv.integrate(scheme, problem, seed=seed, **run)


def test_whether_t_is_a_multiple_of_h_does_not_depend_on_the_unit_of_time() -> None:
    """A relative rounding error is allowed, of T = N h as it is written in decimals,
    and no absolute one.
    """
    for unit in (1e-15, 1.0, 1e15):
        assert step_count(0.01 * unit, 0.57 * unit, None) == 57
        with pytest.raises(sepv.UsageError, match="multiple"):
            step_count(0.01 * unit, 0.5701 * unit, None)


def test_paths_of_explicit_schemes_are_those_of_their_ensembles() -> None:
    problem = problems.pendulum()
    one = sepv.integrate(schemes.euler_heun, problem, h=0.125, T=1.0, seed=3)
    many = ensemble(schemes.euler_heun, problem, h=0.125, T=1.0, paths=2, seed=3)
    assert np.array_equal(one.y[:, -1], many.y[:, 0])
    assert one.gradient_evaluations == one.divisions == one.continuations == 0
    assert many.gradient_evaluations == many.structure_evaluations == many.iterations == 0
    # θ(T) needs the increments as they were, not as the scheme saw them.
    raw = wiener.increments(3, T=1.0, steps=8, noises=2, refine=None)
    assert np.array_equal(one.dW, bounded.truncate(raw, 0.125, schemes.euler_heun.truncation)[:, :, 0])


@pytest.mark.parametrize("remedy", [lambda s: s, divided, continued])
def test_work_is_the_sum_of_the_work_of_the_steps(remedy) -> None:
    """Three paths of Lotka-Volterra with steps so large that some need a remedy;
    counted by hand beside it.
    """
    problem, scheme = problems.lotka_volterra(), remedy(schemes.energy_preserving)
    dW = 0.6 * np.random.default_rng(1).standard_normal((6, 1, 3))
    solved = run_chunk(scheme, problem, np.asarray(problem.initial), 1 / 8, dW, None)
    keys = ("gradient_evaluations", "structure_evaluations", "iterations", "divisions", "continuations")
    total = dict.fromkeys(keys, 0)
    for lane in range(3):
        y, counts = np.asarray(problem.initial), dict.fromkeys(keys, 0)
        for n in range(6):
            solution = scheme.solve(problem, y, 1 / 8, dW[n, :, lane])
            for key in keys:
                value = getattr(solution, key)
                counts[key] += 0 if value is None else int(value[0])
            if solution.status[0]:
                break
            y = solution.value[:, 0]
        for key in keys:
            total[key] += counts[key]
        assert np.array_equal(solved.y[:, lane], y)
        assert solved.failed_step[lane] == (n if solution.status[0] else -1)
        assert solved.status[lane] == solution.status[0]
        if not solution.status[0]:
            path = sepv.integrate(scheme, problem, h=1 / 8, steps=6, dW=dW[:, :, lane], truncation=None)
            found = (path.gradient_evaluations, path.divisions, path.continuations)
            assert found == tuple(counts[key] for key in (keys[0], *keys[3:]))
    assert {key: getattr(solved, key) for key in keys} == total

    assert {s.name for s in map(Status, solved.status)} == {"CONVERGED"} or scheme is not divided
    assert (total["divisions"] > 0) == (remedy is divided)
    assert (total["continuations"] > 0) == (remedy is continued)


def given_increments(name: str = "given", **known: Any) -> sepv.Scheme:
    """y1 = y0 + z with z = ΔW itself: sums of numbers, whose exact value is known.
    z = 77 is refused.
    """

    def solve(problem: sepv.Problem, y: np.ndarray, h: float, dW: np.ndarray) -> Solution:
        M = dW.shape[1]
        status = np.where(dW[0] == 77, Status.SINGULAR, Status.CONVERGED)
        counts = np.ones(M, dtype=np.int64)
        return Solution(y + dW, np.zeros(M), counts, 2 * counts, 3 * counts, status, change=dW)

    return sepv.Scheme(name, lambda problem, y, h, dW: y + dW, solve=solve, truncation=None, **known)


def flat(d: int, **known: Any) -> sepv.Problem:
    """One noise for each component, H = |y|²/2."""
    return sepv.Problem(
        dimension=d, structure=lambda y: np.zeros((d, d, *y.shape[1:])), check=False, noise=np.ones(d),
        hamiltonian=lambda y: 0.5 * np.sum(y * y, axis=0), gradient=lambda y: y, **known,
    )  # fmt: skip


@pytest.mark.parametrize("start", [1.0, 1e-3, -7.0])
def test_compensated_sums_lose_nothing_beyond_the_last_rounding(start: float) -> None:
    """Against rational arithmetic: half an ulp and eps/2 Σ|z|, where plain sums lose more.
    Some z exceed the sum.
    """
    z = np.random.default_rng(3).uniform(0, 0.3, 1000)
    exact = Fraction(start) + sum(map(Fraction, z.tolist()))
    errors = {}
    for compensated in (False, True):
        batch = Batch(given_increments(), flat(1), np.array([start]), 2, compensated=compensated)
        for increment in z:
            batch.step(0.1, np.array([[increment, increment]]))
        ends = batch.result(np.zeros((1, 2)))
        assert ends.y[0, 0] == ends.y[0, 1]
        errors[compensated] = abs(float(Fraction(ends.y[0, 0]) - exact)) / np.spacing(float(exact))
    assert errors[True] <= 0.5 + 2.0**-53 * z.sum() / np.spacing(float(exact))
    assert errors[False] > 1


def test_compensation_needs_an_increment() -> None:
    with pytest.raises(sepv.UsageError, match="euler-heun"):
        Batch(schemes.euler_heun, problems.pendulum(), np.zeros(2), 1, compensated=True)
    stubborn = replace(given_increments(), step=lambda problem, y, h, dW: y)
    assert Batch(stubborn, flat(1), np.zeros(1), 1, compensated=True).lost is not None
    assert Batch(stubborn, flat(1), np.zeros(1), 1).lost is None


def test_a_scheme_that_states_no_change_is_summed_plainly() -> None:
    def solve(problem: sepv.Problem, y: np.ndarray, h: float, dW: np.ndarray) -> Solution:
        return replace(given_increments().solve(problem, y, h, dW), change=None)

    batch = Batch(replace(given_increments(), solve=solve), flat(1), np.ones(1), 1, compensated=True)
    batch.step(0.1, np.array([[0.3]]))
    assert batch.y.tolist() == [[1.3]]


def test_a_path_that_fails_stays_and_says_when_and_the_others_go_on() -> None:
    dW = np.array([[[1.0, 1.0, 77.0]], [[2.0, 2.0, 4.0]], [[8.0, 77.0, 8.0]], [[16.0, 16.0, 16.0]]])
    ends = run_chunk(given_increments(), flat(1), np.array([0.5]), 0.1, dW, None)
    assert ends.y.tolist() == [[27.5, 3.5, 0.5]]
    assert ends.failed_step.tolist() == [-1, 2, 0]
    assert ends.status.tolist() == [0, Status.SINGULAR, Status.SINGULAR]
    assert ends.status.dtype.kind == ends.failed_step.dtype.kind == "i"
    assert ends.W.tolist() == dW.sum(axis=0).tolist()
    assert (ends.gradient_evaluations, ends.structure_evaluations, ends.iterations) == (2 * 8, 3 * 8, 8)
    assert {type(n) for n in (ends.gradient_evaluations, ends.iterations, ends.divisions)} == {int}
    assert ends.states.shape == (0, 0, 0)
    lost = run_chunk(given_increments(), flat(1), np.array([0.5]), 0.1, np.full((3, 1, 2), 77.0), None)
    assert (lost.failed_step.tolist(), lost.y.tolist(), lost.iterations) == ([0, 0], [[0.5, 0.5]], 2)


def test_defects_are_the_largest_on_the_way_of_either_sign() -> None:
    """H = |y|²/2, C₁ = y1² and C₂ = 2y1 − y2 along a way there and back: no conservation,
    and known numbers.
    """
    problem = flat(2, casimirs=(np.diag([1.0, 0.0]),), linear_casimirs=(np.array([2.0, -1.0]),))
    #     y1, y2:  (2, 0) -> (1, 0) -> (2, 0);   (2, 0) -> (2, 4) -> (2, 3)
    dW = np.array([[[-1.0, 0.0], [0.0, 4.0]], [[1.0, 0.0], [0.0, -1.0]]])
    ends = run_chunk(given_increments(), problem, np.array([2.0, 0.0]), 0.1, dW, None)
    assert ends.energy_defect.tolist() == [1.5, 8.0]
    assert ends.casimir_defect.tolist() == [3.0, 4.0]
    blind = Batch(given_increments(), problem, np.array([2.0, 0.0]), 2, track=False)
    blind.step(0.1, dW[0])
    assert not blind.result(dW[0]).casimir_defect.any()
    bare = run_chunk(given_increments(), flat(2), np.array([2.0, 0.0]), 0.1, dW, None)
    assert bare.energy_defect.tolist() == [1.5, 8.0]
    assert not bare.casimir_defect.any()


def test_explicit_steps_that_overflow_are_marked_lane_by_lane_and_nothing_is_warned_about() -> None:
    """y ↦ y·ΔW in the plane. The domain is asked about states that are not finite:
    ∞ − ∞ in it is no warning.
    """

    def step(problem: sepv.Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
        return y * dW

    plane = flat(2, domain=lambda y: 1.0 * (y[0] - y[1] > -1))  # a domain may answer in numbers
    dW = np.array([[2.0, 1e300, 1.0, 1e300], [2.0, 1e300, 3.0, 1.0]])
    for batched in (True, False):
        batch = Batch(sepv.Scheme("times", step, batched=batched), plane, np.array([1e10, 1e10]), 4)
        batch.step(0.1, dW)
        ends = batch.result(dW)
        assert [Status(s).name for s in ends.status] == ["CONVERGED", "OVERFLOW", "LEFT_DOMAIN", "OVERFLOW"]
        assert ends.y.tolist() == [[2e10, 1e10, 1e10, 1e10]] * 2
        assert ends.failed_step.tolist() == [-1, 0, 0, 0]


def test_a_step_that_says_it_failed_is_no_overflow() -> None:
    def step(problem: sepv.Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
        if np.any(dW > 1):
            raise sepv.StepFailure("no convergence", y=y.reshape(-1)[:1], delta=h, residual=1.0, iterations=1)
        return y + dW

    for known in ({}, {"domain": lambda y: y[0] > 0}):
        for batched in (True, False):
            scheme = sepv.Scheme("mine", step, batched=batched)
            ends = run_chunk(scheme, flat(1, **known), np.ones(1), 0.1, np.array([[[0.5, 2.0]]]), None)
            assert ends.status.tolist() == [0, Status.NO_CONVERGENCE]
            assert ends.y.tolist() == [[1.5, 1.0]]
            assert ends.failed_step.tolist() == [-1, 0]


def test_a_truncation_that_costs_the_order_is_a_warning_to_the_caller() -> None:
    """k ≥ 2p. The warning points to the line that asked,
    which is three calls up for paths and ensembles.
    """
    second = schemes.collocation(2)

    def ask(scheme: sepv.Scheme, k: Any) -> int | None:
        return checked(scheme, problems.rigid_body(), 0.25, None, 1, None, k, None).k

    assert [ask(second, k) for k in ("own", None, 4, 5)] == [8, None, 4, 5]
    assert ask(replace(second, mean_square_order=None), 1) == 1
    assert ask(replace(second, truncation=None), "own") is None
    for scheme, k in ((second, 3), (second, 1), (schemes.midpoint, 1)):
        with pytest.warns(TruncationWarning, match=f"k = {k} costs {scheme.name}") as seen:
            assert ask(scheme, k) == k
        assert seen[0].filename == __file__
        assert "seen[0]" not in str(seen[0].message)
    for run in (sepv.integrate, partial(ensemble, paths=1)):
        with pytest.warns(TruncationWarning) as seen:
            run(schemes.midpoint, problems.rigid_body(), h=0.25, steps=1, truncation=1)
        assert [w.filename for w in seen] == [__file__]


SMALL: dict[str, Any] = {"h": 1 / 16, "T": 0.5, "paths": 3000, "chunk": 256, "seed": 5}
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)


def energy(ends: Any) -> Any:
    return PENDULUM.hamiltonian(ends.y)


BOTH = {"q": position, "H": energy}


@given(st.lists(NUMBERS, min_size=1, max_size=60), st.floats(0, 1))
def test_a_quantile_is_within_its_accuracy_of_the_order_statistic(values: list[float], p: float) -> None:
    found = sketch(np.array(values)).quantile(p)
    exact = sorted(values)[math.floor(p * (len(values) - 1))]
    # The logarithm is rounded, which moves an edge between buckets by some eps·ln|x| of the number.
    assert abs(found - exact) <= ACCURACY * (1 + 1e-9) * abs(exact) + np.finfo(float).tiny


@given(st.lists(NUMBERS, max_size=30), st.lists(NUMBERS, max_size=30))
def test_sketches_merge_exactly_and_in_any_order(one: list[float], other: list[float]) -> None:
    whole, left, right = (sketch(np.array(v, dtype=float)) for v in ([*one, *other], one, other))
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
    assert TARGET_MIN_VALUES <= found[0].count < 10**5
    fewer = arguments | {"paths": found[0].count - 512}
    last = sepv.ensemble(EP, PENDULUM, reduce=BOTH, **fewer).reduced["q"]
    assert last.standard_error > 0.02 or last.count < TARGET_MIN_VALUES


def test_an_interrupted_reduction_has_the_first_chunks() -> None:
    def interrupt(done: int, _all: int) -> None:
        if done >= 512:
            raise KeyboardInterrupt

    with pytest.raises(sepv.Interrupted) as kept:
        sepv.ensemble(EP, PENDULUM, reduce=BOTH, progress=interrupt, **SMALL)
    assert kept.value.paths == range(512)
    assert kept.value.ensemble.reduced["q"].count == 512
