"""Orders of schemes for Langevin dynamics against the exact Gaussian step,
and that step against other formulas.
"""

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from sepv.properties._orders.gaussian_moments import moments_of_steps
from sepv.properties._orders.gaussian_step import affine_slope, gaussian_path, gaussian_step, is_gaussian
from sepv.properties._orders.local_moments import exponents
from sepv.properties._orders.log_ode import path
from sepv.properties._stationary import affine, rows_of
from sepv.reference.generator import moments

import sepv
from benchmarks.right_schemes import RIGHT_SCHEMES
from sepv.faults.saboteurs import SABOTEURS
from sepv.problem import Array, HamiltoniansProblem, PolynomialSystem, Problem, drift, langevin, noise_vectors
from sepv.problems import langevin_double_well, langevin_oscillator, langevin_pair
from sepv.schemes import LOCAL_LAWS, Scheme, by_name
from sepv.simulate import areas
from sepv.verification import Effort, Finding


def verdicts(scheme: Scheme, *laws: str) -> list[str]:
    report = sepv.verify(scheme, laws=laws, effort=Effort(corpus=False, shrink_checks=0))
    return [finding.verdict.text for finding in report.findings]


def van_loan(problem: Problem, h: float) -> tuple[Array, Array]:
    """E and the covariance of (ζ, ΔW, H), by the exponential of Van Loan (1978)."""
    A, G = affine_slope(problem), noise_vectors(problem).T * problem.c
    assert A is not None
    d, m = G.shape
    F = np.zeros((d + 2 * m, d + 2 * m))  # of (y, W, ∫W ds)
    F[:d, :d], F[d + m :, d : d + m] = -A, np.eye(m)
    noise = np.concatenate([G, np.eye(m), np.zeros((m, m))])
    blocks = expm(h * np.block([[-F, noise @ noise.T], [np.zeros_like(F), F.T]]))
    n = len(F)
    covariance = blocks[n:, n:].T @ blocks[:n, n:]
    to_area = np.eye(n)
    to_area[d + m :, d : d + m], to_area[d + m :, d + m :] = -0.5 * np.eye(m), np.eye(m) / h
    return np.linalg.solve(A, np.eye(d) - expm(-h * A)), to_area @ covariance @ to_area.T


@pytest.mark.parametrize("h", [2.0, 0.25])
@pytest.mark.parametrize("problem", [langevin_oscillator(2.0, 0.75, 0.5), langevin_pair()])
def test_the_gaussian_step_has_the_joint_covariance_of_van_loan(problem: Problem, h: float) -> None:
    E, joint = van_loan(problem, h)
    d, m = problem.dimension, problem.noises
    for asks, k in (("", m), ("space-time", 2 * m)):
        step = gaussian_step(problem, h, asks)
        rows = joint[d : d + k, d : d + k]
        np.testing.assert_allclose(step.E, E, rtol=0, atol=1e-14)
        np.testing.assert_allclose(step.gain @ rows, joint[:d, d : d + k], rtol=0, atol=1e-13)
        total = step.gain @ rows @ step.gain.T + step.rest @ step.rest.T
        np.testing.assert_allclose(total, joint[:d, :d], rtol=0, atol=1e-13)
    both = gaussian_step(problem, h, "halves")
    rows = h / 2 * np.kron([[2.0, 1.0], [1.0, 1.0]], np.eye(m))  # of ΔW and its first half
    total = both.gain @ rows @ both.gain.T + both.rest @ both.rest.T
    np.testing.assert_allclose(both.E, E, rtol=0, atol=1e-14)
    np.testing.assert_allclose(total, joint[:d, :d], rtol=0, atol=1e-13)


def test_what_increments_leave_open_keeps_its_digits_at_small_steps() -> None:
    """⟨ζ_q²⟩ given ΔW is σ²h³/12 (1 + O(h)): 1e-19 of Var ζ, below its roundings."""
    h = 2.0**-30
    step = gaussian_step(langevin_oscillator(rate=0.5, temperature=3.0), h, "")
    assert np.sum(step.rest[0] ** 2) == pytest.approx(2 * 0.5 * 3.0 * h**3 / 12, rel=4 * h)


def test_the_exact_path_is_the_limit_of_the_log_ode_on_the_same_increments() -> None:
    """The log-ODE with space-time areas has errors of O(δ²) on a path: a quarter at half of δ."""
    problem, paths = langevin_pair(), range(64)
    y0, rough = np.array(problem.initial), areas.drawn(3, T=1.0, steps=256, noises=2, paths=paths)
    exact = gaussian_path(problem, y0, rough, 3, paths)
    off = []
    for steps in (32, 64):
        apart = path(problem, y0, rough.coarse(steps), with_drift=True) - exact
        off.append(np.sqrt(np.mean(apart**2)))
    assert off[1] < 1e-4
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.15)


def test_affine_drifts_are_told_from_others() -> None:
    assert is_gaussian(langevin_pair())
    assert not is_gaussian(langevin_double_well())
    assert not is_gaussian(sepv.problems.harmonic_trap((1.0,)))


def test_the_generator_has_the_friction() -> None:
    problem, h = langevin_pair(), 0.0625
    assert isinstance(problem.data, PolynomialSystem)
    y0 = (0.5, -0.25, 1.0, 0.75)
    rows = moments(problem.data, y0, exponents(4, 2), 9)
    found = np.array([float(sum(v * Fraction(h) ** k for k, v in enumerate(row))) for row in rows])
    E, joint = van_loan(problem, h)
    mean = E @ drift(problem, np.array(y0))
    second = joint[:4, :4] + np.outer(mean, mean)
    np.testing.assert_allclose(found, [*mean, *second[np.triu_indices(4)]], rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["baoab", "obabo", "gronbech-jensen-farago", "friction-euler-maruyama"])
def test_one_step_has_the_orders_that_are_claimed(name: str) -> None:
    assert verdicts(by_name(name), *LOCAL_LAWS) == ["holds"] * 3


def test_higher_claims_are_violated() -> None:
    baoab, euler = by_name("baoab"), by_name("friction-euler-maruyama")
    assert verdicts(replace(baoab, mean_square_order=1.5), *LOCAL_LAWS)[1] == "violated"
    assert verdicts(replace(baoab, weak_order=3), *LOCAL_LAWS)[2] == "violated"
    assert verdicts(replace(euler, weak_order=2), *LOCAL_LAWS)[2] == "violated"


def test_a_scheme_that_uses_areas_has_order_two_against_the_exact_paths() -> None:
    right = RIGHT_SCHEMES["mean-given-areas"]
    assert verdicts(right, *LOCAL_LAWS, "mean-square-order") == ["holds"] * 4
    assert verdicts(replace(right, mean_square_order=2.5), *LOCAL_LAWS)[1] == "violated"


def test_a_noise_that_uses_the_area_with_the_wrong_sign_has_order_one() -> None:
    right = RIGHT_SCHEMES["mean-given-areas"]

    def turned(problem: Problem, y: Array, h: float, dW: Array, bridge: Array) -> Array:
        return right.step(problem, y, h, dW, -bridge)

    assert verdicts(replace(right, step=turned), "mean-square-order") == ["violated"]


def quadratic(scheme: Scheme, **changes: Any) -> Scheme:
    return replace(scheme, problems=("langevin-oscillator", "langevin-pair"), **changes)


def weak_order(scheme: Scheme, paths: int = 8192) -> Finding:
    return sepv.verify(scheme, laws=["weak-order"], effort=Effort(corpus=False, paths=paths)).findings[0]


@pytest.mark.parametrize(
    ("name", "order"),
    [("baoab", 2), ("obabo", 2), ("gronbech-jensen-farago", 2), ("friction-euler-maruyama", 1)],
)
def test_weak_orders_of_affine_steps_are_read_without_paths(name: str, order: float) -> None:
    found = weak_order(quadratic(by_name(name)))
    assert found.verdict.text == "holds"
    assert found.checks < 200
    assert found.witness is not None
    assert [m["slope"] for m in found.witness["measured"]] == pytest.approx([order, order], abs=0.01)
    higher = weak_order(quadratic(by_name(name), weak_order=order + 1))
    assert (higher.verdict.text, higher.checks) == ("violated", found.checks)


def test_the_exact_distribution_has_errors_of_rounding_alone() -> None:
    """Paths of it are not the given ones, so that sampling says nothing of its means."""
    found = weak_order(RIGHT_SCHEMES["exact-gaussian-step"])
    assert (found.verdict.text, found.checks) == ("holds", 140)
    assert "are rounding" in found.message


@pytest.mark.parametrize("name", ["baoab", "obabo"])
def test_moments_of_steps_are_those_of_the_powers_of_the_step(name: str) -> None:
    """Against a path of three steps with all its normal numbers as one vector."""
    scheme, problem, h = by_name(name), langevin_pair(), 0.25
    A, y0, sizes = affine_slope(problem), np.array(problem.initial), np.array([0.5, 1.0, 2.0, 4.0])
    assert A is not None
    step = affine(scheme, problem, h, y0, sizes, A)
    assert not isinstance(step, str)
    m, S, _ = moments_of_steps(step, 3, 1.0)

    def end(xi: Array) -> Array:
        y = y0
        for row in np.split(rows_of(scheme, problem, h) @ xi.reshape(-1, 3), 3, axis=1):
            y = scheme.step(problem, y, h, *np.split(row[:, 0], len(row) // 2))
        return y

    n = 3 * step.N.shape[1]
    mean = end(np.zeros(n))
    spread = np.stack([end(e) - mean for e in np.eye(n)], axis=1) / sizes[:, None]
    np.testing.assert_allclose(m, (mean - y0) / sizes, rtol=0, atol=1e-14)
    np.testing.assert_allclose(S, spread @ spread.T, rtol=0, atol=1e-13)


@pytest.mark.parametrize(("truncation", "verdict"), [(None, "holds"), (2, "violated"), (4, "holds")])
def test_the_variance_of_truncated_increments_counts(truncation: int | None, verdict: str) -> None:
    """The exact distribution by normal increments has weak order k by truncated ones."""
    spring = sepv.problems.harmonic_oscillator()
    problem = HamiltoniansProblem(
        2, spring.structure, spring.hamiltonian, noise=(1.0, 0.5), noise_vectors=tuple(np.eye(2)),
        damping=np.eye(2) / 2, initial=(1.0, 0.5),
    )  # fmt: skip

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        E, joint = van_loan(problem, h)
        return np.asarray(y + E @ drift(problem, y) + np.linalg.cholesky(joint[:2, :2]) @ dW / np.sqrt(h))

    scheme = Scheme(
        "exact law", step, systems="friction", problems=[problem], weak_order=3, truncation=truncation
    )
    found = weak_order(scheme)
    assert (found.verdict.text, found.checks < 200) == (verdict, True)


def test_a_step_that_is_not_affine_is_sampled() -> None:
    right = by_name("friction-euler-maruyama")

    def clips(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        return right.step(problem, y, h, np.clip(dW, -2.5 * h**0.5, 2.5 * h**0.5))

    assert "from 512 paths" in weak_order(quadratic(replace(right, step=clips)), paths=512).message


def test_faults_on_quadratic_problems_need_no_other_problem() -> None:
    found = weak_order(SABOTEURS["louder-by-a-fiftieth"].scheme)
    assert (found.verdict.text, found.checks) == ("violated", 119)


def test_exact_and_sampled_problems_are_reported_together() -> None:
    found = weak_order(by_name("friction-euler-maruyama"))
    assert found.witness is not None
    names = {m["problem"] for m in found.witness["measured"]}
    assert (found.verdict.text, names) == (
        "holds",
        {"langevin-oscillator", "langevin-pair", "langevin-double-well"},
    )
    assert found.replay == "--law weak-order --seed 0 --paths 8192"


def second_order(problem: Problem, y: Array, h: float, dW: Array, bridge: Array) -> Array:
    """Equation 23 of Vanden-Eijnden and Ciccotti (2006) as ASE writes it: the velocity between two
    kicks is a difference of rounded positions over h.
    """
    own = langevin(problem)
    system, g = own.mechanics, own.rate
    q, p = system.split(y)
    noise, area = (system.velocity(own.pushed(row)) for row in (dW, bridge))

    def kicked(v: Array, q: Array) -> Array:
        share = 0.5 * h - 0.125 * g * h * h
        return (
            v
            + share * (system.velocity(system.force(q)) - g * v)
            + (0.5 - 0.125 * g * h) * noise
            - 0.5 * g * h * area
        )

    moved = q + h * kicked(system.velocity(p), q) + h * area
    return system.join(moved, system.momentum(kicked((moved - q - h * area) / h, moved)))


def baoab_by_positions(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    own = langevin(problem)
    system = own.mechanics
    q, p = system.split(y)
    middle = q + 0.5 * h * system.velocity(p + 0.5 * h * system.force(q))
    p = own.refreshed(system.momentum((middle - q) / (0.5 * h)), h, dW)
    end = middle + 0.5 * h * system.velocity(p)
    return system.join(end, system.momentum((end - middle) / (0.5 * h)) + 0.5 * h * system.force(end))


BY_POSITIONS = {
    "ase": replace(by_name("baoab"), step=second_order, asks="space-time", order=None, claims=frozenset()),
    "baoab": replace(by_name("baoab"), step=baoab_by_positions, order=None, claims=frozenset()),
}


@pytest.mark.parametrize(
    ("name", "strong"), [("ase", 2), *((name, p) for name in BY_POSITIONS for p in (1, 0.5, None))]
)
def test_velocities_from_rounded_positions_accuse_nobody(name: str, strong: float | None) -> None:
    """At the h of these laws, down to 1e-12, they are wrong by eps|q|/h."""
    lowered = replace(BY_POSITIONS[name], mean_square_order=strong, weak_order=strong and min(2, 2 * strong))
    assert verdicts(lowered, *LOCAL_LAWS) == ["holds"] * 3


@pytest.mark.parametrize("strong", [1, 0.5])
@pytest.mark.parametrize("name", BY_POSITIONS)
def test_such_velocities_hide_no_wrong_noise(name: str, strong: float) -> None:
    right = BY_POSITIONS[name]

    def louder(problem: Problem, y: Array, h: float, dW: Array, *more: Array) -> Array:
        return right.step(problem, y, h, 1.02 * dW, *more)

    wrong = replace(right, step=louder, mean_square_order=strong)
    assert verdicts(wrong, *LOCAL_LAWS[1:]) == ["violated"] * 2
