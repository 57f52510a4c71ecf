"""Energy over long times without noise: the bound of a trend, the power of h, and the orbits on which theory speaks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sepv.properties._orders.integrable import TAIL, orbits_of_class, users_orbits
from sepv.properties._orders.long_times import (
    APART,
    LEAKS,
    PERIODS,
    SIZES,
    EnergyPath,
    judged_power,
    leakage,
    means,
    trend,
    weights,
)
from sepv.reference.faults.saboteurs import SABOTEURS

from benchmarks.right_schemes import RIGHT
from sepv import Scheme, Skipped, problems, schemes, verify
from sepv.exact import PHASES
from sepv.problem import Array, Problem, Systems
from sepv.record import EPS
from sepv.verification import Effort, Run, Verdict, load_laws, quiet_problem

(LAW,) = load_laws(["long-time-energy"])
NONE = [0.0] * SIZES


def verdict(scheme: Scheme, seed: int = 0, **given: Any) -> str:
    return LAW.run(LAW, replace(scheme, **given), Run(Effort(seed=seed))).verdict.text


CLAIMED = [name for name, scheme in RIGHT.items() if "long-time-energy" in scheme.claims]
# Fixed-point iterations: they take ten seconds for a seed.
SLOW = ("lobatto-iiia", "trapezoidal", "symmetric-projection", "midpoint-in-single-precision")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.deep] * (name in SLOW)) for name in CLAIMED]
)
def test_right_methods_have_no_trend_and_their_power(name: str) -> None:
    assert verdict(RIGHT[name]) == "holds"


@pytest.mark.deep
@pytest.mark.parametrize("batched", [True, False])
@pytest.mark.parametrize("name", CLAIMED)
def test_right_methods_hold_with_ten_seeds(name: str, batched: bool) -> None:
    scheme = replace(RIGHT[name], batched=batched and RIGHT[name].batched)
    assert [verdict(scheme, seed) for seed in range(10)] == ["holds"] * 10


@pytest.mark.parametrize("name", [n for n, s in SABOTEURS.items() if LAW.name in s.caught_by])
def test_faults_are_seen_in_steps_of_one_state_too(name: str) -> None:
    assert verdict(SABOTEURS[name].scheme, batched=False) == "violated"


@pytest.mark.parametrize("systems", [Systems.SINGLE, Systems.CANONICAL_SEPARABLE, Systems.MECHANICAL])
def test_the_orbits_of_a_class_have_one_energy_and_no_harmonics_that_look_slow(systems: Systems) -> None:
    for seed in range(4):
        for orbits in orbits_of_class(systems, seed):
            H = orbits.problem.hamiltonian(orbits.states)
            assert np.ptp(H) < 64 * EPS * np.max(np.abs(H))
            sizes = np.max(np.abs(np.fft.rfft(orbits.problem.gradient(orbits.states), axis=1)), axis=0)
            assert sizes[orbits.steps - 1 :].sum() < TAIL * sizes.sum()
            assert orbits.of(4).shape == (orbits.problem.dimension, 4)


def test_a_wave_leaves_of_a_mean_no_more_than_stated() -> None:
    """From 2½ periods in the window on, for 14 steps in a period and more, and for its harmonics."""
    for many in (14, 15, 60):
        window = PERIODS * many
        turns = 2 * np.pi * np.arange(window + 1) / window
        for periods in np.linspace(2.5, 6 * PERIODS, 200):
            left = abs(np.sum(weights(window) * np.exp(1j * periods * turns)))
            assert left < 1.02 * leakage(periods)


def test_a_trend_of_a_four_hundredth_of_the_oscillation_in_a_period_is_seen() -> None:
    """The bound allows so much over the distance of the means, 6 periods."""
    allowed = LEAKS * leakage(PERIODS * 7 / 8)
    assert allowed / (APART[-1] * PERIODS) < 1 / 375


@pytest.mark.parametrize("size", [1e-3, 1e-12])
def test_a_steady_trend_is_called_linear_and_a_slow_oscillation_is_not(size: float) -> None:
    """Leapfrog with a friction that takes `size` of the oscillation in each step."""
    orbits = orbits_of_class(Systems.MECHANICAL, 0)[0]

    def rubbed(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y1 = schemes.leapfrog.step(problem, y, h, dW)
        return np.stack([y1[0], (1 - size) * y1[1]])

    found = trend(replace(schemes.leapfrog, step=rubbed, solve=None), orbits, 4)
    assert (found.verdict is Verdict.VIOLATED) == (size > 1e-6)
    assert ("linear" in found.text) == (size > 1e-6)


def oscillations(p: float, alpha: float = 0.0, beta: float = 0.0, floor: float = 0.0) -> list[float]:
    h = 0.4 / 2.0 ** np.arange(SIZES)
    return [float(v) for v in h**p * (1 + alpha * h + beta * h**2) + floor]


@pytest.mark.parametrize("p", [1.0, 2.0, 3.0, 4.0, 6.0])
@pytest.mark.parametrize(("alpha", "beta"), [(0.0, 0.0), (0.5, 0.0), (-0.5, 0.3), (0.0, -2.0), (1.0, 2.0)])
def test_a_power_of_h_holds_with_any_next_terms_and_one_more_is_refuted(
    p: float, alpha: float, beta: float
) -> None:
    seen = oscillations(p, alpha, beta)
    verdicts = [judged_power(seen[:n], NONE[:n], p - 0.5).verdict for n in range(3, SIZES + 1)]
    assert Verdict.VIOLATED not in verdicts
    assert verdicts[-1] is Verdict.HOLDS
    assert judged_power(seen, NONE, p + 0.5).verdict is Verdict.VIOLATED


def test_an_oscillation_that_does_not_fall_is_refuted_and_one_at_rounding_is_not() -> None:
    assert judged_power([1e-3] * 4, NONE[:4], 1.5).verdict is Verdict.VIOLATED
    irregular = [4.5e-3, 1.2e-3, 3.8e-4, 1.8e-4, 1.5e-3]
    assert judged_power(irregular, NONE, 1.5).verdict is Verdict.VIOLATED
    assert judged_power(irregular[:4], NONE[:4], 1.5).verdict is not Verdict.VIOLATED
    assert judged_power([1e-9, 1e-15], [1e-14] * 2, 7.5).verdict is Verdict.HOLDS
    assert judged_power([1e-2, 1e-3], NONE[:2], 1.5).verdict is Verdict.INCONCLUSIVE


def rotating(momentum: float) -> Problem:
    """H = ½p² − cos q + ⅕ sin 2q with y = (q, p), from q = 0: E. Faou, E. Hairer and T.-L. Pham, BIT 44 (2004)."""
    pendulum = problems.pendulum_chain(links=1, noise=())
    return Problem(
        2, pendulum.structure, lambda y: 0.5 * y[1] ** 2 - np.cos(y[0]) + 0.2 * np.sin(2 * y[0]),
        noise=(), initial=(0.0, momentum), name="perturbed",
    )  # fmt: skip


def test_a_reversible_method_drifts_where_the_momentum_keeps_its_sign_and_is_not_accused() -> None:
    """Lobatto IIIB on their perturbed pendulum: with p = 2.5 it turns over and over, with p = 1 it swings."""
    method = RIGHT["lobatto-iiib"]
    turning = rotating(2.5)
    path = EnergyPath(method, turning, np.array([[0.0], [2.5]]), 0.16)
    moved = means(path.errors(2000), 200, [0, 600, 1200, 1800])[:, 0]
    assert np.all(np.diff(moved) > 0) or np.all(np.diff(moved) < 0)
    with pytest.raises(Skipped):
        users_orbits(turning)
    finding = verify(method, laws="long-time-energy", problems=[turning]).finding("long-time-energy")
    assert finding.verdict.text == "not applicable"
    assert (
        verify(method, laws="long-time-energy", problems=[rotating(1.0)]).findings[0].verdict.text == "holds"
    )


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("henon-heiles", "one degree of freedom"),
        ("lennard-jones", "one degree of freedom"),
        ("lotka-volterra", "one degree of freedom"),
    ],
)
def test_problems_of_which_theory_is_silent_are_left_out(name: str, why: str) -> None:
    with pytest.raises(Skipped, match=why):
        users_orbits(quiet_problem(problems.by_name(name)))
    finding = verify("explicit-4", laws="long-time-energy", problems=[name]).finding("long-time-energy")
    assert finding.verdict.text == "not applicable"
    assert why in finding.message


def test_a_users_pendulum_is_asked_and_its_unit_of_time_does_not_matter() -> None:
    assert users_orbits(quiet_problem(problems.pendulum())).states.shape == (2, PHASES)
    pendulum = quiet_problem(problems.pendulum())
    for rate in (1e-3, 1e6):
        swinging = Problem(
            2, lambda y, rate=rate: rate * pendulum.structure(y), pendulum.hamiltonian,
            noise=(), initial=pendulum.initial, name="swinging",
        )  # fmt: skip
        for scheme, expected in (("midpoint", "holds"), ("explicit-4", "violated")):
            finding = verify(scheme, laws="long-time-energy", problems=[swinging]).findings[0]
            assert finding.verdict.text == expected, finding.message


def test_a_stated_tolerance_is_allowed_and_an_unstated_one_is_a_trend() -> None:
    """(2.1), with H raised by 1e-10 of the momentum in each step."""

    def raised(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y1 = schemes.energy_preserving.step(problem, y, h, dW)
        return y1 * (1 + 1e-10)

    scheme = replace(schemes.energy_preserving, step=raised, solve=None)
    assert verdict(scheme) == "violated"
    assert verdict(scheme, solver_tolerance=4e-10) == "holds"


def test_a_scheme_that_takes_short_steps_alone_gets_such() -> None:
    short = replace(schemes.leapfrog, longest_step=0.2)
    assert verdict(short) == "holds"
    assert verdict(replace(short, longest_step=1e-3)) == "not applicable"


def test_a_claim_of_symplecticity_and_order_does_not_imply_this_one() -> None:
    scheme = Scheme("mine", schemes.leapfrog.step, ["symplecticity"], order=2, systems="mechanical")
    assert not LAW.claimed_by(scheme)
    assert verdict(scheme) == "holds"
