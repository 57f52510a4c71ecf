"""Orders from errors of one step, at every decade of h: right schemes hold their claims,
wrong ones show by slopes.
"""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from doors import but_deep, says
from drawn import clipping, euler, refusing, right
from sepv.properties import test_truncation as truncation
from sepv.properties._orders import any_step
from sepv.properties._orders.local_errors import cases, local_states, two_noises
from sepv.properties._orders.local_moments import moments_at
from sepv.properties._orders.local_orders import judge_slope

from sepv import Effort, Report, Skipped, StepFailure, Verdict, exact_flow, problems, schemes, verify
from sepv.problem import Array, HamiltoniansProblem, Problem, vector_field
from sepv.schemes import Scheme, Step, as_lanes, energy_preserving

LOCAL = ("local-mean", "local-mean-square", "local-weak")
H = 2.0 ** -np.arange(6.0, 27.0, 2.0)
# Their slopes are those of theory to two digits.
OF_ORDER_ONE = {"energy-preserving", "milstein", "several-structures"}
# The other schemes of the paper are measured by the files of `properties`.
BUILT_IN = (
    *OF_ORDER_ONE, *schemes.EXTENSIONS, *(f"collocation-{s}" for s in (2, 3, 4)), "gauss-2",
)  # fmt: skip


def measured(scheme: Scheme) -> Report:
    return verify(scheme, laws=LOCAL)


def verdicts(scheme: Scheme) -> list[str]:
    return [f.verdict.value for f in measured(scheme).findings]


def around(step: Step, **changes: object) -> Scheme:
    return replace(energy_preserving, step=step, solve=None, **changes)


def factors(drift: float, noise: float) -> Scheme:
    """(2.1) with the drift and the noise multiplied."""
    return around(lambda p, y, h, dW: energy_preserving.step(p, y, drift * h, noise * dW))


def flow(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """The exact flow as a scheme; the states of a batch come in runs of the same."""
    y0, noise = as_lanes(problem, y, h, dW)
    theta, found = problem.random_step(h, noise), np.empty_like(y0)
    for state in np.unique(y0, axis=1).T:
        lanes = np.all(y0 == state[:, None], axis=0)
        found[:, lanes] = exact_flow(problem, theta[lanes], state).y
    return found.reshape(np.shape(y))


def hermite(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """φ_Δ(y0) + ½ f(y0)(S³ − 3c²hS): a local rms error of order 3/2 whose mean is zero,
    as is its mean with S.
    """
    y0, noise = as_lanes(problem, y, h, dW)
    S, c2 = problem.random_step(0.0, noise), float(np.sum(problem.c**2))
    bump = 0.5 * vector_field(problem, y0) * (S**3 - 3 * c2 * h * S)
    return (flow(problem, y0, h, noise) + bump).reshape(np.shape(y))


# Of the projected schemes another one runs each time.
@pytest.mark.parametrize("name", but_deep(sorted({*BUILT_IN}), "projected-8"))
def test_every_scheme_has_the_local_orders_that_it_claims(name: str) -> None:
    report = measured(schemes.by_name(name))
    assert [f.verdict for f in report.findings] == [Verdict.HOLDS] * 3
    assert all(f.claimed for f in report.findings)
    if name in OF_ORDER_ONE:
        assert [f.defect for f in report.findings] == pytest.approx([2.0, 1.5, 2.0], abs=0.02)


def test_two_half_steps_and_the_exact_flow_are_right() -> None:
    def halves(p: Problem, y: Array, h: float, dW: Array) -> Array:
        return energy_preserving.step(p, energy_preserving.step(p, y, h / 2, dW / 2), h / 2, dW / 2)

    assert verdicts(around(halves)) == ["holds"] * 3
    exact = Scheme("flow", flow, mean_square_order=3.0, weak_order=3.0, truncation=None, batched=True)
    report = measured(exact)
    assert [f.verdict.value for f in report.findings] == ["holds"] * 3
    assert all("rounding" in f.message and f.defect is None for f in report.findings)


@pytest.mark.parametrize("truncation", [None, pytest.param(4, marks=pytest.mark.deep)])
def test_a_scheme_of_weak_order_two_and_mean_square_order_one_is_seen_as_both(truncation: int | None) -> None:
    """E[S³ − 3c²hS] = 0 and E[S(S³ − 3c²hS)] = 0, so that the moments of the step are right to
    O(h³).
    """
    orders = {"mean_square_order": 1.0, "weak_order": 2.0}
    scheme = Scheme("hermite", hermite, truncation=truncation, batched=True, **orders)
    report = measured(scheme)
    assert [f.verdict.value for f in report.findings] == ["holds"] * 3
    assert report.finding("local-mean-square").defect == pytest.approx(1.5, abs=0.02)
    assert report.finding("local-weak").defect == pytest.approx(3.0, abs=0.1)
    assert verdicts(replace(scheme, mean_square_order=1.5))[1] == "violated"
    assert verdicts(replace(scheme, weak_order=3.0))[2] == "violated"


@pytest.mark.parametrize("excess", [1e-2, 1e-4])
def test_a_noise_too_large_shows_in_all_three_and_a_wrong_drift_in_the_means(excess: float) -> None:
    report = measured(factors(1.0, 1 + excess))
    assert [f.verdict.value for f in report.findings] == ["violated"] * 3
    assert report.finding("local-mean-square").defect == pytest.approx(0.5, abs=0.02)
    assert verdicts(factors(1 + excess, 1.0))[::2] == ["violated"] * 2


@pytest.mark.parametrize(
    ("base", "changes"),
    [
        ("energy-preserving", {"mean_square_order": 1.5}),
        ("energy-preserving", {"mean_square_order": 2.0}),
        ("energy-preserving", {"truncation": 1}),
        ("euler-maruyama", {"mean_square_order": 1.0}),
        ("collocation-2", {"mean_square_order": 4.0}),
        ("collocation-2", {"truncation": 2}),
    ],
)
def test_a_claim_above_the_true_order_is_violated(base: str, changes: dict[str, float]) -> None:
    assert verdicts(replace(schemes.by_name(base), **changes))[1] == "violated"


@pytest.mark.parametrize(
    ("k", "verdict"), [(0.5, "violated"), (1, "violated"), (1.8, "violated"), (2, "holds")]
)
def test_a_scheme_that_clips_more_than_it_says_does_not_take_its_increments(k: float, verdict: str) -> None:
    words = ["does not respond to ΔW_"] * (verdict == "violated")
    says(around(clipping(k)), "truncation", verdict, *words)


def test_order_five_does_not_pass_for_six() -> None:
    """So few errors of these orders are above rounding that their slopes still rise there:
    no accusation, no pass.
    """
    claims = replace(schemes.collocation(5), mean_square_order=6.0, weak_order=None, truncation=12)
    assert verdicts(claims)[:2] == ["inconclusive"] * 2


def test_steps_that_fail_where_they_are_large_accuse_nobody() -> None:
    def fails(least: float) -> Scheme:
        large = lambda p, y, h, dW: abs(float(p.random_step(h, dW))) > least  # noqa: E731
        return around(refusing(StepFailure("too large"), large, schemes.milstein.step), batched=False)

    assert verdicts(fails(0.1)) == ["holds"] * 3
    report = measured(fails(1e-4))
    assert [f.verdict.value for f in report.findings] == ["error"] * 3
    assert "were not solved" in report.findings[0].message


@pytest.mark.parametrize("law", [*LOCAL, "mean-square-order", "weak-order", "rounding"])
def test_problems_that_a_scheme_skips_are_named_and_the_others_judged(law: str) -> None:
    step = refusing(Skipped("three dimensions only"), lambda p, *_: p.dimension == 2)
    found = says(around(step), law, "holds", "rigid-body")
    assert re.search("pendulum.*: skipped.* three dimensions only", found.message)


def test_a_run_asks_the_scheme_for_few_steps_and_once_for_all_three_laws() -> None:
    """40 000 steps of 200 µs are 8 s."""
    asked = []

    def step(p: Problem, y: Array, h: float, dW: Array) -> Array:
        asked.append(y.size // p.dimension)
        return energy_preserving.step(p, y, h, dW)

    verify(around(step), laws=LOCAL)
    assert 5_000 < sum(asked) <= 12_000


def test_a_stated_tolerance_of_the_solver_moves_the_floor() -> None:
    """Errors of 1e-8 that the scheme owns up to are no order; those that it does not are."""

    def step(p: Problem, y: Array, h: float, dW: Array) -> Array:
        return energy_preserving.step(p, y, h, dW) + 1e-8 * np.sin(1e6 * y)

    assert verdicts(around(step, solver_tolerance=2e-8)) == ["holds"] * 3
    assert verdicts(around(step)) == ["violated"] * 3


@pytest.mark.parametrize(
    ("errors", "verdict"),
    [
        (H**2, "holds"),
        (H**1.5, "violated"),
        (H**2 + 1e-4 * H, "violated"),
        # An error that changes its sign between two step sizes, either way.
        (np.abs(H**2 - 1e-3 * H), "violated"),
        (np.abs(H**2 - 30 * H**3), "holds"),
        # What is wrong by less than rounding cannot be seen.
        (np.maximum(1e-7 * H, H**2), "holds"),
        (np.full_like(H, 1e-14), "holds"),
        (1e-9 * H**2 + 1e-16, "holds"),
        (np.where(H < 1e-5, 1e-6, 1e-17), "violated"),
        (np.where(H < 1e-5, np.nan, H**2), "violated"),
    ],
)
def test_slopes_are_judged_where_steps_are_small_and_errors_are_not_rounding(errors, verdict):
    assert judge_slope(H, errors, 1.75, 1.4e-14, 2.2e-11).verdict.value == verdict


def test_slopes_that_still_rise_or_are_too_few_decide_nothing() -> None:
    short = H[:4]
    rising = np.exp(np.cumsum([0.0, -0.5, -1.5, -2.5]) * np.log(4.0))
    assert judge_slope(short, rising, 2.75, 1e-14, 2e-11).verdict is Verdict.INCONCLUSIVE
    assert judge_slope(short[:2], short[:2], 1.75, 1e-14, 2e-11).verdict is Verdict.INCONCLUSIVE


# Problems that a user names.
WITH_CLIP = ("truncation", *LOCAL)
GIVEN = {
    "without noise": problems.rigid_body(noise=()),
    "seven noises": problems.rigid_body(noise=(0.3,) * 7),
    "loud": problems.rigid_body(noise=30.0),
    "nearly silent": problems.pendulum(noise=0.01),
    "attracting": problems.kepler(),
}


@pytest.mark.parametrize("name", GIVEN)
def test_the_midpoint_rule_is_of_order_one_on_every_problem(name: str) -> None:
    report = verify("midpoint", laws=WITH_CLIP, problems=[GIVEN[name]])
    # Without noise no increment acts, so that none can be seen to be clipped.
    clipped = "holds" if GIVEN[name].noises else "not_applicable"
    assert [f.verdict.value for f in report.findings] == [clipped, *["holds"] * 3]
    assert all(GIVEN[name].name in f.message for f in report.findings[1:])


def test_moments_serve_where_noises_do_not_commute_and_fields_are_linear() -> None:
    """No solution for each ΔW is known there: (3.9) is not measured, the means are."""
    report = verify("several-structures", laws=WITH_CLIP, problems=["noncommuting-tops"])
    assert [f.verdict.value for f in report.findings] == ["holds", "holds", "not_applicable", "holds"]
    assert report.finding("local-weak").defect == pytest.approx(2.0, abs=0.02)
    assert "only moments are known" in report.finding("local-mean-square").message


def test_problems_without_an_exact_solution_are_not_applicable() -> None:
    report = verify("several-structures", laws=WITH_CLIP, problems=["noncommuting-drift"])
    assert [f.verdict.value for f in report.findings] == ["holds"] + ["not_applicable"] * 3
    assert "not linear" in report.findings[1].message


def as_functions(name: str) -> HamiltoniansProblem:
    """The problem without its data: what is known of it is its functions."""
    problem = problems.by_name(name)
    assert isinstance(problem, HamiltoniansProblem)
    return replace(problem, data=None, name=f"{name} as functions", check=False)


@pytest.mark.parametrize("name", ["random-inertia", "noisy-henon-heiles", "random-maxwell-bloch"])
def test_the_splitting_has_the_moments_of_the_generator_up_to_the_fourth_power_of_h(name: str) -> None:
    problem, functions = problems.by_name(name), as_functions(name)
    states = local_states(energy_preserving, problem)
    sizes = [2.0**-k for k in (5, 6, 7)]
    exact, _ = moments_at(problem, states, sizes, 5)
    found, error = moments_at(functions, states, sizes, 5)
    apart = np.array([np.max(np.abs(a - b)) for a, b in zip(exact, found, strict=True)])
    assert error < 1e-14
    assert apart[0] < 1e-5
    assert np.all(np.diff(np.log2(apart)) < -3.7), apart


def test_steps_at_which_a_flow_is_not_finite_are_left_out() -> None:
    functions = as_functions("random-inertia")
    states = local_states(energy_preserving, functions)
    blow_up = replace(functions, gradient=lambda y: y**9, check=False)
    found, _ = moments_at(blow_up, 3 * states, [2.0, 2.0**-20], 3)
    assert len(found) == 1
    assert np.all(np.isfinite(found[0]))


def test_orders_of_functions_are_judged_as_those_of_the_same_data() -> None:
    """The midpoint rule, and over a step that is a thousandth too long."""
    midpoint = schemes.by_name("stochastic-midpoint")
    step = lambda p, y, h, dW: midpoint.step(p, y, 1.001 * h, dW)  # noqa: E731
    for scheme, mean in (
        (midpoint, "holds"),
        (replace(midpoint, step=step, solve=None, claims=()), "violated"),
    ):
        seen = []
        for problem in ("random-inertia", as_functions("random-inertia")):
            found = verify(scheme, laws=LOCAL, problems=problem).findings
            seen.append([(f.verdict.text, round(f.witness["measured"][0]["slope"], 1)) for f in found])
        assert seen[0] == seen[1]
        assert seen[0][0][0] == mean


def verdict(step: Step, law: str, seed: int = 0, **changes: object) -> Verdict:
    scheme = replace(energy_preserving, step=step, solve=None, **changes)
    return verify(scheme, laws=[law], effort=Effort(seed=seed)).findings[0].verdict


def in_window(low: float, high: float, wrong: Step) -> Step:
    return lambda p, y, h, dW: (wrong if low < h < high else right)(p, y, h, dW)


@pytest.mark.parametrize("decade", range(-10, -1))
def test_no_decade_is_left_out(decade: int) -> None:
    low, high = 10.0**decade, 10.0 ** (decade + 1)
    assert verdict(in_window(low, high, clipping(1)), "truncation") is Verdict.VIOLATED
    if -9 <= decade < -1:  # below, the error of a step of order one is no more than 1e-9
        assert verdict(in_window(low, high, euler), "local-mean-square") is Verdict.VIOLATED


def test_a_step_that_explodes_in_a_window_is_seen() -> None:
    far = in_window(1e-4, 1e-3, lambda p, y, h, dW: right(p, y, h, dW) + 1e60)
    assert verdict(far, "local-mean-square") is Verdict.VIOLATED


def divided(length: float) -> Step:
    """(2.1) in equal parts that are no longer than a length in seconds:
    errors fall with a slope of ½ above it.
    """

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        parts = min(64, math.ceil(h / length))
        for _ in range(parts):
            y = right(problem, y, h / parts, dW / parts)
        return y

    return step


def hybrid(short: Step, length: float, long: Step = right) -> Step:
    return lambda p, y, h, dW: (short if h < length else long)(p, y, h, dW)


RIGHT: dict[str, Step] = {
    "parts of 0.01": divided(0.01),
    "parts of 1e-5": divided(1e-5),
    "Euler-Heun below 0.001": hybrid(schemes.euler_heun.step, 1e-3),
    "Euler-Heun above 1e-5": hybrid(right, 1e-5, schemes.euler_heun.step),
    "order 8 below 0.001": hybrid(schemes.explicit(8).step, 1e-3),
    "order 8": schemes.explicit(8).step,
}


@pytest.mark.parametrize("name", but_deep(RIGHT, "parts of 1e-5"))
@pytest.mark.parametrize("seed", but_deep(range(3), 1, 2))
def test_right_schemes_with_lengths_of_their_own_hold(name: str, seed: int) -> None:
    """Their errors have other constants below and above some h,
    or a low slope where they are small.
    """
    for law in ("truncation", "local-mean-square"):
        assert verdict(RIGHT[name], law, seed) is Verdict.HOLDS


def test_one_scheme_has_one_constant_in_every_unit_of_time() -> None:
    """With the same u = νh and noise the numbers are the same, whatever h is; so are the errors."""
    found = list(any_step._pairs(energy_preserving, two_noises(), 0))
    for louder in any_step.NOISE_FACTORS:
        long = [pair for pair in found if pair.louder == louder and pair.unit < 1]
        errors = np.array([pair.errors for pair in long])
        assert len(long) >= 2
        assert np.ptp(np.log(errors), axis=0) == pytest.approx(0, abs=1e-3)


def test_a_larger_noise_allows_each_term_its_growth() -> None:
    one, loud = (any_step.Pair(two_noises(), 2.0**-12, 1.0, c, np.ones(2), 0.0) for c in (1.0, 16.0))
    assert loud.growth(one, 1.0) == 16**3
    assert one.growth(loud, 1.0) == 1
    assert replace(one, h=2.0**-8).growth(one, 1.0) == 4**3


def test_steps_of_the_response_are_small_beside_the_slope() -> None:
    rng = np.random.default_rng(0)
    for problem in cases(energy_preserving.systems):
        for posed, h, A in truncation._steps(energy_preserving, problem, 0, 2, rng.random(40)):
            slope = truncation.rates_at(posed, np.array(posed.initial))[1]
            assert slope * (h + posed.c[0] * math.sqrt(h) * A) <= truncation.INCREMENT_REACH * (1 + 1e-9)
