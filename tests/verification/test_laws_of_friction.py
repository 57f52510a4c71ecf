"""The laws of friction: right values of the oscillator, right schemes, and schemes broken on purpose."""

from dataclasses import replace

import numpy as np
import pytest
from sepv.properties._stationary import Stationary, exact, of_step

import sepv
from benchmarks.right_schemes import RIGHT
from sepv.faults.saboteurs import SABOTEURS
from sepv.problem import Problem, Systems, friction
from sepv.problems import harmonic_trap, langevin_oscillator
from sepv.schemes import Scheme, by_name
from sepv.verification import load_laws

LAWS = ("equilibrium", "equilibrium:positions", "poisson-map:conformal")
SIZES = (0.125, 0.5, 1.0, 1.5)


def verdicts(scheme: Scheme, *names: str, seed: int = 0) -> list[str]:
    effort = sepv.verification.Effort(seed=seed, shrink_checks=0, corpus=False)
    found = []
    for law in load_laws(names or LAWS):
        found.append(law.run(law, scheme, sepv.verification.Run(effort)).verdict.text)
    return found


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
    """100 units of time of 2048 paths; the interval is five standard errors (a false alarm in 2e6), √2/√2048 of 1."""
    ends = sepv.ensemble("baoab", langevin_oscillator(), h=0.5, T=20.0, paths=2048, seed=7).y
    np.testing.assert_allclose(np.mean(ends**2, axis=1), [1.0, 0.9375], atol=5 * np.sqrt(2 / 2048))


@pytest.mark.parametrize(
    "name", [name for name, s in SABOTEURS.items() if s.scheme.systems is Systems.FRICTION]
)
def test_each_fault_breaks_its_law(name: str) -> None:
    saboteur = SABOTEURS[name]
    due = [law for law in saboteur.caught_by if law in LAWS]
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
    assert verdicts(RIGHT[name]) == ["holds"] * 3
