"""The laws of friction: right values of the oscillator, right schemes,
and schemes broken on purpose.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sepv.properties._stationary import Stationary, does_not_decay, exact, of_step

import sepv
from benchmarks.right_schemes import RIGHT_SCHEMES
from sepv.faults.saboteurs import SABOTEURS
from sepv.problem import PolynomialSystem, Problem, Systems, friction
from sepv.problems import canonical, harmonic_trap, langevin_oscillator, langevin_pair, started
from sepv.record import poly
from sepv.schemes import Scheme, by_name
from sepv.verification import load_laws

LOCAL = ("local-mean", "local-mean-square", "local-weak", "weak-order")
LAWS = ("equilibrium", "equilibrium:positions", "poisson-map:conformal")
SIZES = (0.125, 0.5, 1.0, 1.5)


def verdicts(scheme: Scheme, *names: str, seed: int = 0) -> list[str]:
    effort = sepv.verification.Effort(seed=seed, shrink_checks=0, corpus=False)
    found = []
    for law in load_laws(names or LAWS):
        found.append(law.run(law, scheme, sepv.verification.Run(effort)).verdict.text)
    return found


def chain(n: int, stiffness: float) -> Problem:
    """n bodies on springs, each to its neighbours, with y = (q, p)."""
    H = poly.squares([1.0] * (2 * n))
    for k in range(n - 1):
        stretched = poly.linear([float(i == k + 1) - float(i == k) for i in range(2 * n)])
        H = poly.add(H, poly.scale(stiffness / 2, poly.multiply(stretched, stretched)))
    return started(PolynomialSystem(2 * n, H, canonical(2 * n, 1.0), ()), "chain", (0.0,) * 2 * n)


def variances(scheme: Scheme, h: float, problem: Problem | None = None) -> tuple[float, float]:
    problem = problem or langevin_oscillator()
    wanted = exact(problem)
    assert isinstance(wanted, Stationary)
    found = of_step(scheme, problem, h, wanted)
    assert isinstance(found, Stationary), found
    q, p = np.diag(found.covariance)
    return float(q), float(p)


@pytest.mark.parametrize("h", SIZES)
@pytest.mark.parametrize("name", ["baoab", "gronbech-jensen-farago"])
def test_baoab_and_gjf_have_the_exact_variance_of_q_and_that_of_p_times_1_minus_a_quarter_of_h2(
    name: str, h: float
) -> None:
    assert variances(by_name(name), h) == pytest.approx((1.0, 1 - h * h / 4), rel=1e-12)


@pytest.mark.parametrize("h", SIZES)
def test_obabo_has_the_exact_variance_of_p_and_that_of_q_over_1_minus_a_quarter_of_h2(h: float) -> None:
    assert variances(by_name("obabo"), h) == pytest.approx((1 / (1 - h * h / 4), 1.0), rel=1e-12)


def test_frequency_and_temperature_enter_the_right_values() -> None:
    w, kT, h = 2.0, 0.5, 0.25
    problem = langevin_oscillator(frequency=w, rate=0.75, temperature=kT)
    assert variances(by_name("baoab"), h, problem) == pytest.approx(
        (kT / w**2, kT * (1 - (h * w) ** 2 / 4)), rel=1e-12
    )
    assert variances(by_name("obabo"), h, problem) == pytest.approx(
        (kT / w**2 / (1 - (h * w) ** 2 / 4), kT), rel=1e-12
    )


def test_the_step_of_gjf_has_the_determinant_600_for_607() -> None:
    problem, step = langevin_oscillator(rate=0.5), by_name("gronbech-jensen-farago").step
    slope = np.stack([step(problem, e, 1.0, np.zeros(1)) for e in np.eye(2)], axis=1)
    assert np.linalg.det(slope) == pytest.approx(0.6, rel=1e-14)
    exactly = np.stack([by_name("baoab").step(problem, e, 1.0, np.zeros(1)) for e in np.eye(2)], axis=1)
    assert np.linalg.det(exactly) == pytest.approx(np.exp(-0.5), rel=1e-14)


def test_a_long_path_has_the_variances_that_the_law_computes() -> None:
    """100 units of time of 2048 paths; the interval is five standard errors (a false alarm in 2e6),
    √2/√2048 of 1.
    """
    ends = sepv.ensemble("baoab", langevin_oscillator(), h=0.5, T=20.0, paths=2048, seed=7).y
    np.testing.assert_allclose(np.mean(ends**2, axis=1), [1.0, 0.9375], atol=5 * np.sqrt(2 / 2048))


@pytest.mark.parametrize(
    "name", [name for name, s in SABOTEURS.items() if s.scheme.systems is Systems.FRICTION]
)
def test_each_fault_breaks_its_law(name: str) -> None:
    saboteur = SABOTEURS[name]
    due = [law for law in saboteur.caught_by if law in (*LAWS, *LOCAL)]
    for seed in range(2):
        assert verdicts(saboteur.scheme, *due, seed=seed) == ["violated"] * len(due) != []


def test_the_wrong_noise_of_the_o_step_gives_960_for_the_variance_of_q() -> None:
    assert variances(SABOTEURS["noise-damped-half"].scheme, 0.5)[0] == pytest.approx(0.960, abs=5e-4)


def test_built_in_schemes_hold_what_they_claim_and_no_more() -> None:
    assert verdicts(by_name("baoab")) == ["holds"] * 3
    assert verdicts(by_name("obabo")) == ["holds", "violated", "holds"]
    assert verdicts(by_name("gronbech-jensen-farago")) == ["holds", "holds", "violated"]
    assert verdicts(by_name("friction-euler-maruyama")) == ["holds", "violated", "violated"]


@pytest.mark.parametrize("name", LAWS[:2])
def test_a_counterexample_is_replayed_on_the_bodies_that_its_seed_drew(name: str) -> None:
    cold = SABOTEURS["half-the-temperature"].scheme
    law = load_laws([name])[0]
    first, other = (
        law.run(law, cold, sepv.verification.Run(sepv.verification.Effort(seed=n))) for n in (3, 0)
    )
    assert first.verdict.text == "violated"
    assert first.replay == f"--law {name} --seed 3"
    assert first.witness is not None
    assert law.replay is not None
    assert law.replay(law, cold, first.witness) == first
    if name == "equilibrium":  # the worst of positions may be that of a problem with a name
        assert other.witness is not None
        assert first.witness["measured"] != other.witness["measured"]


def test_a_potential_that_is_not_quadratic_has_no_equilibrium_here() -> None:
    scheme = replace(by_name("baoab"), problems=["langevin-double-well"])
    assert verdicts(scheme, *LAWS[:2]) == ["not applicable"] * 2


def test_an_unstable_or_clipped_step_is_not_judged() -> None:
    problem = langevin_oscillator()
    wanted = exact(problem)
    assert isinstance(wanted, Stationary)
    assert "spectral radius" in str(of_step(by_name("baoab"), problem, 2.5, wanted))
    right = by_name("baoab").step
    clips = replace(by_name("baoab"), step=lambda p, y, h, dW: right(p, y, h, np.clip(dW, -0.5, 0.5)))
    assert "not affine" in str(of_step(clips, problem, 0.5, wanted))


@pytest.mark.parametrize(
    "name", ["energy-preserving", "stochastic-midpoint", "drift-preserving", "conformal"]
)
def test_schemes_for_other_systems_are_not_judged_by_the_stationary_laws(name: str) -> None:
    assert verdicts(by_name(name), *LAWS[:2]) == ["not applicable"] * 2


def test_friction_of_different_rates_has_no_conformal_law() -> None:
    problem = friction(harmonic_trap((1.0, 2.0)), (0.5, 0.25), 1.0)
    scheme = replace(by_name("friction-euler-maruyama"), problems=[problem])
    assert verdicts(scheme, "poisson-map:conformal", "equilibrium") == ["holds", "not applicable"]


@pytest.mark.parametrize("name", ["aboba-by-velocities", "exact-gaussian-step"])
def test_right_schemes_written_otherwise_hold_what_they_claim(name: str) -> None:
    assert verdicts(RIGHT_SCHEMES[name]) == ["holds"] * 3


def stepping(change: Callable[..., np.ndarray], **parts: Any) -> Scheme:
    """BAOAB with another step: change(problem, y, h, dW)."""
    return replace(by_name("baoab"), step=change, **parts)


def loud(problem: Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
    return by_name("baoab").step(problem, y, h, 1.1 * dW)


def test_a_problem_that_a_scheme_refuses_hides_no_fault_on_another() -> None:
    refused = friction(harmonic_trap((1.0, 2.0, 3.0)), (0.3, 0.5, 0.2), 1.0)
    assert verdicts(stepping(loud, problems=[langevin_oscillator(), refused]), *LAWS[:2]) == ["violated"] * 2


def short(problem: Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
    if h > 0.3:
        raise sepv.StepFailure(f"a step of {h} is longer than 0.3")
    return by_name("baoab").step(problem, y, h, dW)


@pytest.mark.parametrize("longest", [None, 0.3])
def test_a_right_scheme_that_refuses_long_steps_holds(longest: float | None) -> None:
    assert verdicts(stepping(short, longest_step=longest), *LAWS[:2]) == ["holds"] * 2


def test_friction_of_the_wrong_sign_is_seen_where_it_is_in_short_steps_alone() -> None:
    def grows(problem: Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
        return by_name("baoab").step(problem, y, h, dW) * (1 + h if h < 0.006 else 1)

    assert verdicts(stepping(grows), "equilibrium") == ["violated"]


def test_a_mode_without_friction_or_noise_has_no_stationary_distribution() -> None:
    middle = friction(chain(3, 0.3), (0.0, 0.5, 0.0), 1.0)
    assert "without friction" in str(exact(middle))
    pair = langevin_pair(coupling=0.0)
    G = [[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 0.0]]
    quiet = replace(pair, noise_vectors=G, noise=(1.0, 0.0), data=None)
    assert "does not reach every component" in str(exact(quiet))


@pytest.mark.parametrize("rate", [1e5, 1e6])
def test_a_covariance_that_roundings_hide_is_not_judged(rate: float) -> None:
    problem = friction(harmonic_trap((1.0,)), rate, 1.0)
    scheme = replace(SABOTEURS["half-the-temperature"].scheme, problems=[problem])
    assert verdicts(scheme, *LAWS[:2]) == ["not applicable"] * 2


@pytest.mark.parametrize("name", ["baoab", "obabo", "gronbech-jensen-farago", "friction-euler-maruyama"])
@pytest.mark.parametrize("rate", [1e-6, 1e-3, 2.0, 2.0001, 1e2, 1e4])
def test_right_schemes_forget_their_start_at_any_friction(name: str, rate: float) -> None:
    problem = friction(harmonic_trap((1.0,)), rate, 1.0)
    wanted = exact(problem)
    assert isinstance(wanted, Stationary)
    assert does_not_decay(by_name(name), problem, wanted, wanted.time * 2.0 ** -np.arange(9.0)) == ""
