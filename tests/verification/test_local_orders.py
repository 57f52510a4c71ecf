"""Orders from errors of one step: right schemes hold with their own claims, wrong ones show by their slopes.

And on the problems that a user names: fast, slow, without noise, with seven; as data, and as functions alone.
"""

import re
from dataclasses import replace

import numpy as np
import pytest
from sepv.properties._orders.local_errors import local_states
from sepv.properties._orders.local_moments import moments_at
from sepv.properties._orders.local_orders import judge_slope

from sepv import problems, schemes
from sepv.errors import Skipped, StepFailure
from sepv.exact import exact_flow
from sepv.problem import Array, HamiltoniansProblem, Problem, vector_field
from sepv.schemes import Scheme, energy_preserving
from sepv.schemes._scheme import Step, as_lanes
from sepv.verification import Report, Verdict, verify

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
    """φ_Δ(y0) + ½ f(y0)(S³ − 3c²hS): a local rms error of order 3/2 whose mean is zero, as is its mean with S."""
    y0, noise = as_lanes(problem, y, h, dW)
    S, c2 = problem.random_step(0.0, noise), float(np.sum(problem.c**2))
    bump = 0.5 * vector_field(problem, y0) * (S**3 - 3 * c2 * h * S)
    return (flow(problem, y0, h, noise) + bump).reshape(np.shape(y))


@pytest.mark.parametrize("name", sorted({*BUILT_IN}))
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
    """E[S³ − 3c²hS] = 0 and E[S(S³ − 3c²hS)] = 0, so that the moments of the step are right to O(h³)."""
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


def clipped(k: float) -> Scheme:
    """(2.1) that clips its increments at A_h(k) inside the step, and says k = 2."""

    def step(p: Problem, y: Array, h: float, dW: Array) -> Array:
        bound = np.sqrt(2 * k * abs(np.log(h)) * h)
        return energy_preserving.step(p, y, h, np.clip(dW, -bound, bound))

    return around(step)


@pytest.mark.parametrize(
    ("k", "verdict"), [(0.5, "violated"), (1, "violated"), (1.8, "violated"), (2, "holds")]
)
def test_a_scheme_that_clips_more_than_it_says_does_not_take_its_increments(k: float, verdict: str) -> None:
    (finding,) = verify(clipped(k), laws=["truncation"]).findings
    assert finding.verdict.value == verdict
    if verdict == "violated":
        assert "does not respond to ΔW_" in finding.message


def test_order_five_does_not_pass_for_six() -> None:
    """So few errors of these orders are above rounding that their slopes still rise there: no accusation, no pass."""
    claims = replace(schemes.collocation(5), mean_square_order=6.0, weak_order=None, truncation=12)
    assert verdicts(claims)[:2] == ["inconclusive"] * 2


def test_steps_that_fail_where_they_are_large_accuse_nobody() -> None:
    def fails(least: float) -> Scheme:
        def step(p: Problem, y: Array, h: float, dW: Array) -> Array:
            if abs(float(p.random_step(h, dW))) > least:
                raise StepFailure("too large")
            return schemes.milstein.step(p, y, h, dW)

        return around(step, batched=False)

    assert verdicts(fails(0.1)) == ["holds"] * 3
    report = measured(fails(1e-4))
    assert [f.verdict.value for f in report.findings] == ["error"] * 3
    assert "were not solved" in report.findings[0].message


@pytest.mark.parametrize("law", [*LOCAL, "mean-square-order", "weak-order", "rounding"])
def test_problems_that_a_scheme_skips_are_named_and_the_others_judged(law: str) -> None:
    def step(p: Problem, y: Array, h: float, dW: Array) -> Array:
        if p.dimension == 2:
            raise Skipped("three dimensions only")
        return energy_preserving.step(p, y, h, dW)

    (found,) = verify(around(step), laws=[law]).findings
    assert found.verdict is Verdict.HOLDS
    assert re.search("pendulum.*: skipped.* three dimensions only", found.message)
    assert "rigid-body" in found.message


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
        # Right at coarse steps and wrong at small ones.
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
    assert [f.verdict.value for f in report.findings] == ["holds"] * 4
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
            seen.append(
                [(f.verdict.text, round((f.witness or {})["measured"][0]["slope"], 1)) for f in found]
            )
        assert seen[0] == seen[1]
        assert seen[0][0][0] == mean
