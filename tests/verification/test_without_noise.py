"""Schemes without noise: orders are told by number in any unit,
and trends of the energy over long times are seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from doors import but_deep, finding, says
from drawn import stretched
from sepv.properties._orders.consistency import limit
from sepv.properties._orders.integrable import HARMONICS_TAIL, orbits_of_class, users_orbits
from sepv.properties._orders.long_times import (
    ENERGY_MAX_SIZES,
    LEAK_FACTOR,
    MEAN_PERIODS,
    WINDOW_DISTANCES,
    EnergyPath,
    judged_power,
    leakage,
    means,
    trend,
    weights,
)
from sepv.properties._orders.without_noise import QUIET_RATIO, judge
from sepv.properties._reversal import mirrors

import sepv
from benchmarks.right_schemes import RIGHT_SCHEMES
from benchmarks.right_schemes.mechanical import MECHANICAL
from sepv import Scheme, Skipped, problems, schemes
from sepv.exact import PHASES
from sepv.faults.saboteurs import SABOTEURS
from sepv.law import quiet_problem
from sepv.problem import Array, Problem, Systems, mechanics
from sepv.record import EPS
from sepv.schemes._leapfrog import composed_leapfrogs
from sepv.schemes._one_step import Explicit
from sepv.verification import Effort, Finding, Run, Verdict, load_laws

ORDER = "deterministic-order"
LEAPFROG, YOSHIDA, BLANES_MOAN = (sepv.schemes.by_name(n) for n in ("leapfrog", "yoshida-4", "blanes-moan-4"))


def _runge_kutta(second: float) -> Callable[..., np.ndarray]:
    """The classical method of order 4, or with another weight of the second stage in the third."""

    def step(problem: Problem, y: np.ndarray, h: float, _dW: np.ndarray) -> np.ndarray:
        def field(x: np.ndarray) -> np.ndarray:
            return np.einsum("ij...,j...->i...", problem.structure(x), problem.gradient(x))

        k1 = field(y)
        k2 = field(y + h / 2 * k1)
        k3 = field(y + h * (second * k2 + (0.5 - second) * k1))
        return y + h / 6 * (k1 + 2 * k2 + 2 * k3 + field(y + h * k3))

    return step


def _one_mass_each(problem: Problem, y: np.ndarray, h: float, _dW: np.ndarray) -> np.ndarray:
    """The leapfrog of a library that knows diagonal mass matrices only:
    a symplectic map of another system.
    """
    m = mechanics(problem)
    q, p = m.split(y)
    p = p + h / 2 * m.force(q)
    q = q + h * (np.diag(m.inverse_mass) * p.T).T
    return m.join(q, p + h / 2 * m.force(q))


def _own(step: Callable[..., np.ndarray]) -> Scheme:
    return Scheme("own", step, batched=True, systems="mechanical", noise=False)


def found(scheme: Scheme, problems: Any = None, **facts: Any) -> Finding:
    return finding(replace(scheme, **facts), ORDER, problems)


@pytest.mark.parametrize("scheme", [*MECHANICAL, LEAPFROG, YOSHIDA, BLANES_MOAN], ids=lambda s: s.name)
def test_right_orders_hold_and_are_stated(scheme: Scheme) -> None:
    finding = found(scheme)
    assert finding.verdict is Verdict.HOLDS, finding.message
    assert finding.claimed
    assert {entry["order"] for entry in finding.witness["measured"]} == {scheme.order}


@pytest.mark.parametrize(
    ("name", "order"),
    [
        ("energy-preserving", 2.0),
        ("conformal", 2.0),
        ("collocation-3", 6.0),
        ("explicit-8", 8.0),
        ("euler-maruyama", 1.0),
    ],
)
def test_schemes_with_noise_have_an_order_without_it(name: str, order: float) -> None:
    assert found(sepv.schemes.by_name(name), order=float(order)).verdict is Verdict.HOLDS
    assert found(sepv.schemes.by_name(name)).verdict is Verdict.HOLDS  # unclaimed: consistent


@pytest.mark.parametrize(
    ("scheme", "claimed", "order"),
    [
        (LEAPFROG, 3, 2), (LEAPFROG, 4, 2), (YOSHIDA, 6, 4), (BLANES_MOAN, 5, 4), (MECHANICAL[2], 4, 3),
        (replace(YOSHIDA, step=Explicit(composed_leapfrogs((1.35, -1.7, 1.35)))), 4, 2),
        (_own(_runge_kutta(0.5)), 5, 4), (_own(_runge_kutta(0.25)), 4, 2), (_own(_one_mass_each), 2, 0),
        (SABOTEURS["runge-kutta-in-digits"].scheme, 4, 2), (SABOTEURS["weights-beyond-one"].scheme, 4, 0),
        (SABOTEURS["damped-at-once"].scheme, 2, 1), (sepv.schemes.by_name("conformal"), 3, 2),
        (sepv.schemes.energy_preserving, 3, 2), (sepv.schemes.collocation(2), 6, 4),
    ],
)  # fmt: skip
def test_a_wrong_order_is_told_in_one_line(scheme: Scheme, claimed: float, order: int) -> None:
    finding = found(scheme, order=float(claimed))
    assert finding.verdict is Verdict.VIOLATED
    assert finding.message.splitlines()[0] == f"order {claimed} claimed, {order} found"


def _scaled(time: float, length: float) -> Problem:
    """Hénon and Heiles with other units of time and length: H(y/length) length²/time, B = J."""
    B = sepv.problems.henon_heiles().structure
    H = lambda y: (0.5 * np.sum(y * y, axis=0) + (y[0] ** 2 * y[1] - y[1] ** 3 / 3) / length) / time  # noqa: E731
    return sepv.Problem(4, B, H, initial=length * np.array([0.1, 0.2, 0.4, -0.1]), noise=())


@cache
def usual() -> Finding:
    return found(YOSHIDA, _scaled(1.0, 1.0))


@pytest.mark.parametrize(("time", "length"), [(2.0**-20, 1.0), (2.0**20, 2.0**-10), (1.0, 2.0**20)])
def test_no_verdict_depends_on_units(time: float, length: float) -> None:
    right = found(YOSHIDA, _scaled(time, length))
    wrong = found(YOSHIDA, _scaled(time, length), order=5.0)
    assert right.defect == pytest.approx(usual().defect, abs=0.05)
    assert (right.verdict, wrong.verdict) == (Verdict.HOLDS, Verdict.VIOLATED)


def _stopped_at(tolerance: float) -> Callable[..., np.ndarray]:
    """The midpoint rule, solved to this tolerance."""

    def step(problem: Problem, y: np.ndarray, h: float, _dW: np.ndarray) -> np.ndarray:
        def field(x: np.ndarray) -> np.ndarray:
            return problem.structure(x) @ problem.gradient(x)

        z = y + h * field(y)
        for _ in range(200):
            z, before = y + h * field((y + z) / 2), z
            if np.max(np.abs(z - before)) < tolerance:
                return z
        raise ArithmeticError("no convergence")

    return step


@pytest.mark.parametrize("tolerance", [1e-6, 1e-10])
@pytest.mark.parametrize("stated", [False, True])
def test_a_tolerance_is_no_order(tolerance: float, *, stated: bool) -> None:
    scheme = Scheme("midpoint", _stopped_at(tolerance), order=2.0, solver_tolerance=tolerance * stated)
    assert found(scheme).verdict is Verdict.HOLDS


@pytest.mark.parametrize(
    ("facts", "verdict"),
    [({}, Verdict.VIOLATED), ({"solver_tolerance": 1e-6}, Verdict.HOLDS)],
    ids=["", "stated"],
)
def test_a_step_size_in_32_bits_is_told_from_one_in_64(facts: dict[str, Any], verdict: Verdict) -> None:
    rounded = replace(_own(lambda p, y, h, dW: LEAPFROG.step(p, y, float(np.float32(h)), dW)), **facts)
    finding = found(rounded, order=2.0)
    assert finding.verdict is verdict
    assert ("h or y1 is rounded to 32 bits" in finding.message) is (verdict is Verdict.VIOLATED)


@pytest.mark.parametrize("power", [1, 2, 4])
@pytest.mark.parametrize("kappa", [0.0, 1e-9, 1e-7])
def test_a_limit_of_the_error_over_h_is_told_from_powers_and_from_rounding(power: int, kappa: float) -> None:
    """Errors h(κ + h^p/(p + 1)!) with any next terms and roundings of y1 up to R."""
    h, rounding = 2.0 ** -np.arange(4.0, 16.5, 0.5), 64 * EPS
    random = np.random.default_rng(power)
    for _ in range(40):
        exact = h * (kappa + h**power / math.factorial(power + 1) * (1 + random.uniform(-1, 1) * h))
        errors = exact[:, None] + rounding * random.uniform(-1, 1, (h.size, 1))
        found = limit(h, errors, rounding)
        assert found is not None
        assert found.is_zero is (kappa == 0)
    scattered = exact[:, None] + 1e-11 * random.uniform(-1, 1, (h.size, 1))
    assert limit(h, scattered, rounding) is None


@pytest.mark.parametrize(("roundings", "fits"), [(1.5, True), (2.5, False)])
def test_errors_that_alternate_by_more_than_two_roundings_fit_no_power_of_h(
    roundings: float, fits: bool
) -> None:
    """No polynomial of degree five follows 25 signs that alternate."""
    h = 2.0 ** -np.arange(4.0, 16.5, 0.5)
    errors = h**3 + roundings * 64 * EPS * (-1.0) ** np.arange(h.size)
    assert (limit(h, errors[:, None], 64 * EPS) is not None) is fits


def test_errors_that_do_not_fall_accuse_nobody() -> None:
    h = 4 * QUIET_RATIO ** -np.arange(31.0)
    flat = judge(h, np.full(31, 1e-7), 4.5, 1e-14, 2e-11)
    assert flat.verdict is Verdict.INCONCLUSIVE
    noise = np.random.default_rng(0).uniform(0, 4e-12, 31)
    assert judge(h, noise, 8.5, 1e-14, 2e-11).verdict is Verdict.HOLDS
    law = 1e-3 * h**3
    assert judge(h, law, 2.5, 1e-14, 2e-11).order == 2
    assert judge(h, law, 4.5, 1e-14, 2e-11).verdict is Verdict.VIOLATED


@pytest.mark.parametrize("power", [0, 1])
def test_an_unstated_tolerance_that_scatters_is_no_lower_order(power: int) -> None:
    h, noise = 4 * QUIET_RATIO ** -np.arange(31.0), np.random.default_rng(1).standard_normal((200, 31))
    errors = np.abs(h**5 + 1e-12 * h**power * noise)
    verdicts = [judge(h, e, 4.5, 64 * EPS, 1e5 * EPS).verdict for e in errors]
    assert verdicts.count(Verdict.HOLDS) >= 200 - verdicts.count(Verdict.INCONCLUSIVE) >= 190


def test_several_hamiltonians_have_no_such_order() -> None:
    finding = found(sepv.schemes.by_name("stochastic-midpoint"))
    assert finding.verdict is Verdict.NOT_APPLICABLE


(LONG_TIMES,) = load_laws(["long-time-energy"])
NONE = [0.0] * ENERGY_MAX_SIZES


def verdict(scheme: Scheme, seed: int = 0, **given: Any) -> str:
    return LONG_TIMES.run(LONG_TIMES, replace(scheme, **given), Run(Effort(seed=seed))).verdict.text


CLAIMED = [name for name, scheme in RIGHT_SCHEMES.items() if "long-time-energy" in scheme.claims]
# Iterations and steps of one state: they take four to ten seconds for a seed.
SLOW = (
    "lobatto-iiia", "lobatto-iiib", "trapezoidal", "symmetric-projection", "midpoint-in-single-precision",
    "turned-about-lines", "refuses-by-arithmetic-error",
)  # fmt: skip


@pytest.mark.parametrize("name", but_deep(CLAIMED, *SLOW))
def test_right_methods_have_no_trend_and_their_power(name: str) -> None:
    assert verdict(RIGHT_SCHEMES[name]) == "holds"


@pytest.mark.deep
@pytest.mark.parametrize("batched", [True, False])
@pytest.mark.parametrize("name", CLAIMED)
def test_right_methods_hold_with_ten_seeds(name: str, batched: bool) -> None:
    scheme = replace(RIGHT_SCHEMES[name], batched=batched and RIGHT_SCHEMES[name].batched)
    assert [verdict(scheme, seed) for seed in range(10)] == ["holds"] * 10


FAULTS = [n for n, s in SABOTEURS.items() if LONG_TIMES.name in s.caught_by]
# In batches all of them are killed each time, as are these in steps of one state.
QUICKLY = ("fourth-order-sold-as-symplectic", "stored-in-single-precision", "force-of-first-kick")


@pytest.mark.parametrize("name", but_deep(FAULTS, *(name for name in FAULTS if name not in QUICKLY)))
def test_faults_are_seen_in_steps_of_one_state_too(name: str) -> None:
    assert verdict(SABOTEURS[name].scheme, batched=False) == "violated"


OF_BODIES = (Systems.RIGID_BODIES, Systems.PRINCIPAL_BODIES, Systems.LIE_POISSON, Systems.MATRIX_HAMILTONIANS)


@pytest.mark.parametrize(
    "systems", [Systems.SINGLE, Systems.CANONICAL_SEPARABLE, Systems.MECHANICAL, *OF_BODIES]
)
def test_the_orbits_of_a_class_have_one_energy_and_no_harmonics_that_look_slow(systems: Systems) -> None:
    for seed in range(4):
        for orbits in orbits_of_class(systems, seed):
            H = orbits.problem.hamiltonian(orbits.states)
            assert np.ptp(H) < 64 * EPS * np.max(np.abs(H))
            sizes = np.max(np.abs(np.fft.rfft(orbits.problem.gradient(orbits.states), axis=1)), axis=0)
            assert sizes[orbits.steps - 1 :].sum() < HARMONICS_TAIL * sizes.sum()
            assert orbits.of(4).shape == (orbits.problem.dimension, 4)


def test_a_wave_leaves_of_a_mean_no_more_than_stated() -> None:
    """From 2½ periods in the window on, for 14 steps in a period and more, and for its
    harmonics.
    """
    for many in (14, 15, 60):
        window = MEAN_PERIODS * many
        turns = 2 * np.pi * np.arange(window + 1) / window
        for periods in np.linspace(2.5, 6 * MEAN_PERIODS, 200):
            left = abs(np.sum(weights(window) * np.exp(1j * periods * turns)))
            assert left < 1.02 * leakage(periods)


def test_a_trend_of_a_four_hundredth_of_the_oscillation_in_a_period_is_seen() -> None:
    """The bound allows so much over the distance of the means, 6 periods."""
    allowed = LEAK_FACTOR * leakage(MEAN_PERIODS * 7 / 8)
    assert allowed / (WINDOW_DISTANCES[-1] * MEAN_PERIODS) < 1 / 375


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
    h = 0.4 / 2.0 ** np.arange(ENERGY_MAX_SIZES)
    return [float(v) for v in h**p * (1 + alpha * h + beta * h**2) + floor]


@pytest.mark.parametrize("p", [1.0, 2.0, 3.0, 4.0, 6.0])
@pytest.mark.parametrize(("alpha", "beta"), [(0.0, 0.0), (0.5, 0.0), (-0.5, 0.3), (0.0, -2.0), (1.0, 2.0)])
def test_a_power_of_h_holds_with_any_next_terms_and_one_more_is_refuted(
    p: float, alpha: float, beta: float
) -> None:
    seen = oscillations(p, alpha, beta)
    verdicts = [judged_power(seen[:n], NONE[:n], p - 0.5).verdict for n in range(3, ENERGY_MAX_SIZES + 1)]
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
    """H = ½p² − cos q + ⅕ sin 2q with y = (q, p), from q = 0: E. Faou, E. Hairer and T.-L. Pham,
    BIT 44 (2004).
    """
    pendulum = problems.pendulum_chain(links=1, noise=())
    return Problem(
        2, pendulum.structure, lambda y: 0.5 * y[1] ** 2 - np.cos(y[0]) + 0.2 * np.sin(2 * y[0]),
        noise=(), initial=(0.0, momentum), name="perturbed",
    )  # fmt: skip


def test_a_reversible_method_drifts_where_the_momentum_keeps_its_sign_and_is_not_accused() -> None:
    """Lobatto IIIB on their perturbed pendulum: with p = 2.5 it turns over and over,
    with p = 1 it swings.
    """
    method = RIGHT_SCHEMES["lobatto-iiib"]
    turning = rotating(2.5)
    path = EnergyPath(method, turning, np.array([[0.0], [2.5]]), 0.16)
    moved = means(path.errors(1000), 100, [0, 300, 600, 900])[:, 0]
    assert np.all(np.diff(moved) > 0) or np.all(np.diff(moved) < 0)
    with pytest.raises(Skipped):
        users_orbits(turning)
    says(method, "long-time-energy", "not applicable", problems=[turning])


# Twenty seconds: of methods of one state; `RIGHT_SCHEMES` has others of which the law is asked each
# time.
@pytest.mark.deep
def test_a_reversible_method_holds_where_the_momentum_changes_its_sign() -> None:
    says(RIGHT_SCHEMES["lobatto-iiib"], "long-time-energy", "holds", problems=[rotating(1.0)])


SPINS = ("isospectral-midpoint", "matrix-hamiltonians", "holds")


@pytest.mark.parametrize(
    ("scheme", "problem", "expected"),
    but_deep(
        [
            SPINS, ("midpoint", "rigid-body", "holds"),
            ("explicit-4", "rigid-body", "violated"), ("explicit-4", "lie-poisson", "violated"),
        ],
        SPINS,
    ),
)  # fmt: skip
def test_the_energy_of_bodies_and_spins_is_followed(scheme: str, problem: str, expected: str) -> None:
    says(scheme, "long-time-energy", expected, problems=[problem])


def test_a_mirror_of_a_body_is_a_principal_axis_in_which_its_motion_goes_back() -> None:
    (body,) = (own.problem for own in orbits_of_class(Systems.RIGID_BODIES, 0)[1:])
    y = np.array([0.7, 0.2, -0.4])
    found = mirrors(body)
    assert len(found) == 3
    assert np.count_nonzero(np.abs(found) < 1e-3) == 0  # every product of inertia differs from 0
    for v in found:
        turned = y - 2 * (v @ y) * v
        f, g = (body.structure(x) @ body.gradient(x) for x in (y, turned))
        assert np.allclose(g, -(f - 2 * (v @ f) * v), rtol=1e-12, atol=1e-14)
    assert mirrors(problems.lotka_volterra()) == []


@pytest.mark.parametrize("name", ["henon-heiles", "lennard-jones", "lotka-volterra"])
def test_problems_of_which_theory_is_silent_are_left_out(name: str) -> None:
    why = "one degree of freedom"
    with pytest.raises(Skipped, match=why):
        users_orbits(quiet_problem(problems.by_name(name)))
    says("explicit-4", "long-time-energy", "not applicable", why, problems=[name])


def test_a_users_pendulum_is_asked_and_its_unit_of_time_does_not_matter() -> None:
    assert users_orbits(quiet_problem(problems.pendulum())).states.shape == (2, PHASES)
    pendulum = quiet_problem(problems.pendulum())
    for rate in (1e-3, 1e6):
        swinging = Problem(
            2, lambda y, rate=rate: rate * pendulum.structure(y), pendulum.hamiltonian,
            noise=(), initial=pendulum.initial, name="swinging",
        )  # fmt: skip
        for scheme, expected in (("midpoint", "holds"), ("explicit-4", "violated")):
            says(scheme, "long-time-energy", expected, problems=[swinging])


def test_a_stated_tolerance_is_allowed_and_an_unstated_one_is_a_trend() -> None:
    """(2.1), with H raised by 1e-10 of the momentum in each step."""
    scheme = replace(schemes.energy_preserving, step=stretched(1e-10), solve=None)
    assert verdict(scheme) == "violated"
    assert verdict(scheme, solver_tolerance=4e-10) == "holds"


def test_a_scheme_that_takes_short_steps_alone_gets_such() -> None:
    short = replace(schemes.leapfrog, longest_step=0.2)
    assert verdict(short) == "holds"
    assert verdict(replace(short, longest_step=1e-3)) == "not applicable"


def test_a_claim_of_symplecticity_and_order_does_not_imply_this_one() -> None:
    scheme = Scheme("mine", schemes.leapfrog.step, ["poisson-map:constant"], order=2, systems="mechanical")
    assert not LONG_TIMES.claimed_by(scheme)
    assert verdict(scheme) == "holds"
