"""Verdicts from samples: right schemes that look wrong are not accused, faults of one per cent do not hold."""

from dataclasses import replace

import numpy as np
import pytest
from doors import finding, measured, verdicts
from sepv.properties import test_commutation as commutation
from sepv.properties import test_mean_square_order as mean_square
from sepv.properties import test_weak_order as weak
from sepv.properties._orders.convergence import (
    StrongErrors,
    mean_square_order,
    quantile_slope,
    strong_errors,
)
from sepv.properties._orders.means import decay, leading, limit_errors, moment_errors
from sepv.properties._sequential import FIRST_LOOK, sampled, setups_for
from sepv.properties._sequential import _wanted as wanted

from benchmarks.right_schemes import RIGHT
from sepv import problems, schemes, verify
from sepv.problem import Array, Problem, vector_field
from sepv.schemes import Scheme
from sepv.schemes._one_step import Solved
from sepv.solve import Status
from sepv.solve._solution import Solution
from sepv.verification import Effort, Finding, Run, Verdict

SAMPLED = ("mean-square-order", "weak-order", "right-limit")
RIGID = problems.rigid_body()


def found(scheme: Scheme, law: str, paths: int = 2048) -> Finding:
    return finding(scheme, law, paths=paths)


def noisier(scheme: Scheme, factor: float) -> Scheme:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        return scheme.step(problem, y, h, factor * dW)

    return replace(scheme, step=step, solve=None)


@pytest.mark.parametrize(
    ("orders", "seed"),
    [((1.5, 2.0), 0), *(pytest.param((1.5,), n, marks=pytest.mark.deep) for n in (1, 2, 3, 4))],
)
def test_a_scheme_of_weak_order_two_and_mean_square_order_one_is_not_accused(orders, seed):
    """Its means lie within the noise of errors of mean-square order 1, whose slope must not be taken for theirs."""
    run = Run(Effort(seed=seed, paths=256))  # keeps the errors, which hang on no claim
    for order in orders:
        scheme = replace(RIGHT["weak-two"], weak_order=order)
        finding = weak.run(weak.law, scheme, run)
        assert finding.verdict in (Verdict.HOLDS, Verdict.INCONCLUSIVE)
        assert finding.verdict is Verdict.HOLDS or "settle it" in finding.message


@pytest.mark.parametrize("name", ["energy-preserving", "euler-heun"])
def test_a_scheme_of_weak_order_one_that_claims_two_is_violated(name: str) -> None:
    finding = found(replace(schemes.by_name(name), weak_order=2.0), "weak-order")
    assert finding.verdict is Verdict.VIOLATED


@pytest.mark.parametrize("factor", [0.99, 1.02])
@pytest.mark.parametrize("name", ["energy-preserving", "milstein"])
def test_a_noise_wrong_by_one_per_cent_is_another_limit(name: str, factor: float) -> None:
    finding = found(noisier(schemes.by_name(name), factor), "right-limit")
    assert finding.verdict is Verdict.VIOLATED
    assert "noise" in finding.message


@pytest.mark.parametrize("name", ["energy-preserving", "euler-heun", "milstein"])
def test_the_first_looks_find_that_right_schemes_hold(name: str) -> None:
    assert verdicts(name, SAMPLED, paths=2048) == dict.fromkeys(SAMPLED, "holds")


@pytest.mark.parametrize("order", [0.5, *(pytest.param(p, marks=pytest.mark.deep) for p in (1.0, 2.0, 4.0))])
def test_errors_at_the_rounding_floor_accuse_nobody(order: float) -> None:
    """The exact flow is within C h^p of itself for every p, with a tiny C."""
    flow = replace(RIGHT["exact-flow"], mean_square_order=order, weak_order=order)
    assert verdicts(flow, SAMPLED, paths=64) == dict.fromkeys(SAMPLED, "holds")


def errors_of(squared: Array, steps: tuple[int, ...]) -> StrongErrors:
    errors = np.sqrt(squared)[:, None, :]
    levels, _, paths = errors.shape
    return StrongErrors(
        1.0, steps, squared, errors, (0,) * levels, 1.0, ends=np.ones_like(errors),
        W=np.zeros((levels, 1, paths)), weights=np.ones((levels, paths)),
    )  # fmt: skip


def test_partly_at_the_floor_the_coarse_steps_must_lie_as_high_as_the_order_says() -> None:
    rng = np.random.default_rng(0)
    size = rng.uniform(0.5, 1.5, 256)
    assess = mean_square.assessing(1.0, False)
    for coarse, fine, verdict in (
        (1e-4, 1e-15, "HOLDS"),
        (1e-11, 1e-15, "INCONCLUSIVE"),
        (1e-15, 1e-4, "INCONCLUSIVE"),
    ):
        errors = errors_of(np.stack([(coarse * size) ** 2, (fine * size) ** 2]), (4, 64))
        assert assess(RIGID, errors, 1e-5, 1.0).verdict is Verdict[verdict]


def test_the_interval_of_a_quantile_owes_nothing_to_the_tails() -> None:
    """Pareto's law with an infinite mean: 400 batches at 5 % miss 20 times, here at most 36 (false alarm 1e-3)."""
    rng = np.random.default_rng(1)
    misses = 0
    for _ in range(400):
        u = rng.pareto(0.7, 256) + 1
        squared = np.stack([u**2, (rng.permutation(u) / 4) ** 2])
        estimate = quantile_slope(errors_of(squared, (4, 16)), 0.05)
        misses += not estimate.low <= 1.0 <= estimate.high
    assert misses <= 36


def test_heavy_tails_alone_do_not_lower_an_order() -> None:
    """Order 1 exactly, with a mean square that most samples miss: no interval lies below, at 5 %, in 200 batches."""
    rng = np.random.default_rng(2)
    for _ in range(200):
        coarse, fine = np.exp(2 * rng.standard_normal((2, 512)))
        _, _, high = mean_square_order(errors_of(np.stack([coarse**2, (fine / 16) ** 2]), (4, 64)), 0.05)
        assert high > 0.75


def test_the_leading_coefficient_is_found_past_a_change_of_sign() -> None:
    h = np.array([1 / 4, 1 / 16, 1 / 64])
    crossing = (h - h**2 / 0.25)[:, None, None] * np.ones((1, 1, 8))  # zero at the coarsest step
    assert abs(leading(crossing, h, 0).value[0]) < 1e-14
    assert abs(leading(crossing, h, 1).value[0] - 1) < 1e-12
    constant = crossing + 0.25
    assert abs(leading(constant, h, 0).value[0] - 0.25) < 1e-13


def test_a_mean_that_vanishes_at_the_coarsest_step_does_not_accuse() -> None:
    """E e = h (1 − h/h₁), an error of weak order 1 that is zero at h₁ and falls too slowly from there."""
    rng = np.random.default_rng(3)
    h = np.array([1 / 4, 1 / 16, 1 / 64])
    mean = 0.1 * h * (1 - h / h[0])
    noise = 1e-5 * rng.standard_normal((3, 512))
    errors = errors_of((mean[:, None] + noise) ** 2, (4, 16, 64))
    errors = replace(errors, errors=(mean[:, None] + noise)[:, None, :])
    assert decay(moment_errors(errors), errors.h, 1e-5)[2] < 0.5  # by itself the fall accuses
    assert weak.assessing(1.0, False)(RIGID, errors, 1e-5, 1.0).verdict is not Verdict.VIOLATED


def test_the_shares_of_the_limit_are_what_the_fault_is() -> None:
    """A noise too large by 3 %, within 5 standard errors (false alarm 1e-6) and the second order of the share."""
    problem, scheme = problems.pendulum(), replace(noisier(schemes.explicit(8), 1.03), truncation=None)
    errors = strong_errors(scheme, problem, T=0.5, steps=(8, 16, 64), paths=range(512), seed=0)
    names, samples, _ = limit_errors(errors, problem)
    share = leading(samples, errors.h, 0)
    k = names.index("noise")
    assert abs(share.value[k] - 0.03) < 5 * share.error[k] + 2 * 0.03**2


def test_noises_that_commute_give_order_one_with_a_drift_that_does_not() -> None:
    (setup,) = [s for s in commutation.SETUPS if s.problem == "noncommuting-drift"]
    run = {"T": setup.T, "steps": setup.steps, "paths": range(192), "seed": 0}
    errors = strong_errors(schemes.several_structures, setup.build(), **run)
    value, low, _ = mean_square_order(errors, 0.01)
    assert 0.8 < value < 1.05
    assert low > 0.6
    assert errors.reference < 0.5 * errors.rms()[-1]


def test_a_scheme_for_one_state_is_asked_for_few_steps() -> None:
    """These laws and rounding ask most: 21,900 steps of 27,900, where an early look suffices. More paths lift that."""
    asked = 0

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        nonlocal asked
        asked += 1
        return schemes.euler_heun.step(problem, y, h, dW)

    alone = replace(schemes.euler_heun, batched=False, solve=None, step=step)
    report = verify(alone, laws=["truncation", "local-mean", *SAMPLED])
    assert {f.verdict for f in report.findings} == {Verdict.HOLDS}
    assert asked <= 14_000
    assert setups_for(alone, Effort(paths=16384)) == setups_for(schemes.euler_heun, Effort())


def test_few_paths_may_hold_and_accuse_nobody() -> None:
    """Of wrong schemes an early look says nothing; the first one of 512 paths calls them violated."""
    for wrong in (noisier(schemes.euler_heun, 1.05), Scheme("Itô", _unmended)):
        seen = found(replace(wrong, batched=False, solve=None), "right-limit", paths=1024)
        assert seen.verdict is Verdict.VIOLATED
        assert seen.checks >= FIRST_LOOK


def test_what_is_open_says_what_it_would_take() -> None:
    scheme = schemes.euler_maruyama
    finding = found(scheme, "weak-order", paths=512)
    assert finding.verdict is Verdict.INCONCLUSIVE
    assert "steps, would settle it (--paths" in finding.message
    # A scheme for one state is told what would be quicker: from the same errors, which it would take seconds to draw.
    (setup,) = [s for s in setups_for(scheme) if s.problem == "pendulum"]
    errors, assess = sampled(scheme, setup, 512, Run()), weak.assessing(scheme.weak_order, False)
    words = wanted(replace(scheme, batched=False), setup, assess, errors, 1e-5)
    assert words.endswith("; a step that takes batches, (d, M), gets so many by itself)")


def _one_sided(loud: float, claimed: float | None = 0.5) -> Scheme:
    """Milstein's term by a difference over 4√h: the right limit where loud = 1, and a mean error of order ½."""

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        delta, f, length = problem.random_step(h, loud * dW), vector_field(problem, y), 4 * abs(h) ** 0.5
        slope = (vector_field(problem, y + length * f) - f) / length
        return np.asarray(y + delta * f + 0.5 * delta**2 * slope)

    return Scheme(f"one-sided {loud}", step, mean_square_order=claimed, batched=True)


def test_a_mean_error_of_order_one_half_is_no_wrong_limit_and_hides_none() -> None:
    right = verdicts(_one_sided(1.0), "right-limit,mean-square-order", paths=2048)
    assert right["mean-square-order"] == "holds"
    assert right["right-limit"] in ("holds", "inconclusive")
    assert found(_one_sided(1.05), "right-limit").verdict is Verdict.VIOLATED


def test_where_no_order_is_claimed_a_limit_is_wrong_only_if_each_order_says_so() -> None:
    assert found(_one_sided(1.0, None), "right-limit").verdict is not Verdict.VIOLATED
    for wrong in (_one_sided(1.05, None), Scheme("Itô", _unmended, batched=True)):
        assert found(wrong, "right-limit").verdict is Verdict.VIOLATED


def _unmended(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Euler's method, as if (1.1) were an Itô equation."""
    return np.asarray(y + problem.random_step(h, dW) * vector_field(problem, y))


def _timid(limit: float) -> Scheme:
    """(2.1), which refuses a step with |Δ| > limit."""

    def solve(problem: Problem, y: Array, h: float, dW: Array) -> Solution:
        solution = solve_all(problem, y, h, dW)
        refused = np.abs(problem.random_step(h, dW)) > limit
        return replace(solution, status=np.where(refused, Status.NO_CONVERGENCE, solution.status))

    solve_all = schemes.energy_preserving.solve
    assert solve_all is not None
    return replace(schemes.energy_preserving, name="timid", step=Solved(solve), solve=solve)


@pytest.mark.parametrize(
    ("limit", "problem", "refused", "steps"),
    [
        (1.4, "pendulum", "1 with 4 steps", "8, 32, 128"),
        pytest.param(0.9, "rigid-body", "29 with 4 steps", "8, 32, 128", marks=pytest.mark.deep),
        (0.8, "rigid-body", "6 with 8 steps", "16, 64, 256"),
    ],
)
def test_refusals_of_large_increments_halve_the_steps_and_accuse_nobody(limit, problem, refused, steps):
    """Of 512 paths one of the pendulum has a coarse step with |Δ| > 1.4, 29 of the rigid body one with |Δ| > 0.9."""
    for seen in measured(_timid(limit), "mean-square-order,weak-order", seed=1).findings:
        assert seen.verdict is Verdict.HOLDS, seen.message
        assert f"{problem}: of 512 paths, not solved" in seen.message
        assert f"domain: {refused}; judged with {steps} steps instead" in seen.message


def test_finer_steps_are_not_run_where_coarse_ones_are_refused() -> None:
    """What a slow scheme is not asked for in vain: 63 of 67 steps a path."""
    asked: list[int] = []

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        asked.append(y.size // 3)
        return np.full_like(y, np.nan)

    run = {"T": 0.5, "steps": (1, 2, 64), "paths": range(512), "seed": 0}
    errors = strong_errors(Scheme("none", step, batched=True), RIGID, **run)
    assert errors.failures == (512, 0, 0)
    assert sum(asked) <= 2 * 512  # a batch that fails may be asked again, state by state
    assert np.isnan(errors.squared[1:]).all()


def test_frequent_refusals_are_an_error() -> None:
    seen = finding(_timid(0.5), "mean-square-order", seed=1)
    assert seen.verdict is Verdict.ERROR
    assert "of 512 paths, not solved, not finite or out of the domain: 2" in seen.message


def test_an_effort_keeps_nothing_and_a_run_keeps_what_its_laws_share() -> None:
    """An effort serves for many schemes: errors of one must not be taken for those of another."""
    effort, laws = Effort(paths=64), [mean_square.law, weak.law]
    assert len({effort, Effort(paths=64)}) == 1  # hashable: it has no part that can change
    run = Run(effort)
    findings = [law.run(law, schemes.energy_preserving, run) for law in laws]
    assert list(run.paths) == list(setups_for(schemes.energy_preserving))
    kept = dict(run.paths)
    assert [law.run(law, schemes.energy_preserving, run) for law in laws] == findings
    assert all(run.paths[setup] is kept[setup] for setup in kept)
