"""Friction with noise: the record, its facts, and which schemes take it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import sepv
from sepv import problems
from sepv.errors import ProblemError, SepvError, UsageError
from sepv.problem import (
    DampedProblem,
    HamiltoniansProblem,
    PolynomialSystem,
    Problem,
    bracket,
    conformal_rate,
    damping_matrix,
    drift,
    friction,
    ito_drift,
    langevin,
    noise_field,
    noise_vectors,
    temperature,
)
from sepv.problems import canonical, started
from sepv.record import poly
from sepv.schemes import Scheme, built_in
from sepv.verification import Effort

NAMES = ("langevin-oscillator", "langevin-double-well", "langevin-pair")
OTHER_SCHEMES = [*sepv.schemes.PAPER, *sepv.schemes.EXTENSIONS, *sepv.schemes.HAMILTONIANS, "conformal"]


@pytest.mark.parametrize("name", NAMES)
def test_noise_and_friction_are_in_balance_at_one_temperature(name: str) -> None:
    kT = {"langevin-double-well": 0.5}.get(name, 1.0)
    assert temperature(problems.by_name(name)) == pytest.approx(kT, rel=1e-15)


def test_the_noise_of_a_full_mass_matrix_has_the_covariance_of_the_temperature() -> None:
    def energy(y: np.ndarray) -> np.ndarray:
        return (y[2] ** 2 + y[2] * y[3] + y[3] ** 2 + y[0] ** 2 + y[1] ** 2) / 2

    bare = sepv.Problem(4, np.kron([[0.0, 1.0], [-1.0, 0.0]], np.eye(2)), energy, noise=())
    problem = friction(bare, 0.25, 2.0)
    M = np.linalg.inv([[1.0, 0.5], [0.5, 1.0]])
    P = langevin(problem).pushes
    np.testing.assert_allclose(P @ P.T, 2 * 0.25 * 2.0 * M, rtol=1e-14)
    assert temperature(problem) == pytest.approx(2.0, rel=1e-14)


def kappa(problem: Problem) -> float | None:
    return conformal_rate(problem, np.ones(problem.dimension))


def test_rates_of_each_degree_of_freedom_are_a_matrix_without_one_kappa() -> None:
    problem = friction(problems.harmonic_trap((1.0, 2.0)), (0.5, 0.25), 1.0)
    assert np.diag(damping_matrix(problem)).tolist() == [0, 0, 0.5, 0.25]
    np.testing.assert_allclose(problem.c**2, [1.0, 0.5], rtol=1e-15)
    assert kappa(problem) is None
    with pytest.raises(UsageError, match="friction −γp on all momenta"):
        langevin(problem)


def test_kappa_is_gamma_for_friction_and_two_gamma_for_damping() -> None:
    assert kappa(problems.langevin_oscillator(rate=0.375)) == 0.375
    spring = sepv.problems.harmonic_oscillator()
    damped = DampedProblem(2, spring.structure, spring.hamiltonian, noise=(0.5,), damping=0.375)
    assert kappa(damped) == 0.75


def test_the_drift_and_its_bracket_have_the_friction() -> None:
    problem, y = problems.langevin_oscillator(frequency=2.0, rate=0.5), np.array([0.75, -1.5])
    assert drift(problem, y).tolist() == [-1.5, -4 * 0.75 + 0.5 * 1.5]
    assert np.array_equal(ito_drift(problem, y), drift(problem, y))  # constant fields
    # [f_0, g] = −f_0′g for a constant g = e_p, with f_0′ = ((0, 1), (−4, −½)).
    assert bracket(problem, 0, 1, y).tolist() == [-1.0, 0.5]


@pytest.mark.parametrize("name", NAMES)
def test_a_problem_keeps_its_friction_as_json(name: str) -> None:
    problem = problems.by_name(name)
    again = problems.build(problems.from_json(problems.to_json(problem)))
    assert isinstance(again, HamiltoniansProblem)
    assert again.damping == problem.damping
    assert np.array_equal(again.noise_vectors, problem.noise_vectors)
    assert np.array_equal(again.c, problem.c)


@pytest.mark.parametrize("scheme", OTHER_SCHEMES)
def test_no_scheme_for_other_systems_leaves_out_the_friction(scheme: str) -> None:
    with pytest.raises(SepvError):
        sepv.integrate(scheme, "langevin-pair", h=0.125, T=0.25, seed=1)


def test_the_compiled_engine_refuses_friction() -> None:
    with pytest.raises(UsageError):
        sepv.ensemble("baoab", "langevin-pair", h=0.125, T=0.25, paths=8, seed=1, engine="compiled")


@pytest.mark.parametrize(("rate", "kT"), [(-0.5, 1.0), (0.5, -1.0), (0.5, float("nan")), ((0.5, 1.0), 1.0)])
def test_a_wrong_rate_or_temperature_is_refused(rate: object, kT: float) -> None:
    with pytest.raises((ProblemError, ValueError)):
        friction(problems.harmonic_trap((1.0,)), rate, kT)  # type: ignore[arg-type]


SHAKEN = PolynomialSystem(
    2, poly.add(poly.squares((1.0, 1.0)), poly.polynomial(2, {(4, 0): 0.25})), canonical(2, 1.0), (0.5,),
    noise_hamiltonians=(poly.squares((1.0, 0.0)),), damping=((0.0, 0.0), (0.0, 0.5)),
)  # fmt: skip


def shaken(**changes: Any) -> Problem:
    """An oscillator with friction whose stiffness is noisy, from functions."""
    facts: dict[str, Any] = {
        "noise_hamiltonians": (lambda y: y[0] ** 2 / 2,),
        "damping": SHAKEN.damping,
    } | changes
    return HamiltoniansProblem(
        2, np.array([[0.0, 1.0], [-1.0, 0.0]]), lambda y: (y[0] ** 2 + y[1] ** 2) / 2 + y[0] ** 4 / 4,
        noise=(0.5,), initial=(1.0, 0.5), name="shaken", **facts,
    )  # fmt: skip


def heun(problem: Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
    def field(z: np.ndarray) -> np.ndarray:
        noises = enumerate(zip(problem.c, dW, strict=True))
        return np.asarray(
            h * drift(problem, z) + sum(c * w * noise_field(problem, j, z) for j, (c, w) in noises)
        )

    k = field(y)
    return y + 0.5 * (k + field(y + k))


def test_friction_goes_with_noises_that_have_hamiltonians() -> None:
    data, y = started(SHAKEN, "shaken", (1.0, 0.5)), np.array([0.75, -1.5])
    assert drift(data, y).tolist() == [-1.5, -(0.75 + 0.75**3) + 0.5 * 1.5] == drift(shaken(), y).tolist()
    assert noise_field(data, 0, y).tolist() == [0.0, -0.75]
    assert problems.build(problems.from_json(problems.to_json(data))).channels[0].damping == SHAKEN.damping
    assert kappa(data) == 0.5


@pytest.mark.parametrize("problem", [started(SHAKEN, "shaken", (1.0, 0.5)), shaken()])
def test_laws_judge_friction_beside_hamiltonians(problem: Problem) -> None:
    right = Scheme(
        "Heun", heun, systems="friction", problems=[problem], mean_square_order=1, weak_order=1, truncation=None,
        batched=True,
    )  # fmt: skip

    def frictionless(problem: Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
        """The step of a problem without the friction, to first order."""
        return heun(problem, y, h, dW) + h * damping_matrix(problem) @ y

    laws = ["deterministic-order", "local-mean", "local-weak", "right-limit"]
    effort = Effort(corpus=False, paths=512)
    for scheme, verdict in ((right, "holds"), (replace(right, step=frictionless), "violated")):
        found = sepv.verify(scheme, laws=laws, effort=effort).findings
        assert [f.verdict.text for f in found] == [verdict] * len(laws)
    rest = sepv.verify(right, laws=["equilibrium", "energy"], effort=effort).findings
    assert [f.verdict.text for f in rest] == ["not applicable"] * 2


@pytest.mark.parametrize("scheme", [*OTHER_SCHEMES, "baoab", "obabo", "friction-euler-maruyama"])
def test_no_built_in_scheme_leaves_out_a_part_of_such_a_system(scheme: str) -> None:
    def flow(y: np.ndarray, t: np.ndarray) -> np.ndarray:
        return y

    with pytest.raises(SepvError):
        sepv.integrate(scheme, shaken(flows=(flow,), noise_flows=(flow,)), h=0.125, T=0.25, seed=1)


def test_damping_that_no_system_has_is_refused_with_a_remedy() -> None:
    with pytest.raises(ProblemError, match="the matrix γI for a rate γ"):
        problems.build(replace(SHAKEN, damping=0.5))


def test_the_rows_of_an_array_are_noise_vectors() -> None:
    structure = problems.harmonic_oscillator().structure
    problem = HamiltoniansProblem(
        2, structure, lambda y: y[0] ** 2 + y[1] ** 2, noise=(1.0, 2.0), noise_vectors=np.eye(2)
    )
    assert noise_vectors(problem).tolist() == np.eye(2).tolist()


def test_the_mean_square_of_p_under_friction_is_a_stated_invariant() -> None:
    """Without a potential L|p|² = −2γ|p|² + 2γkT m n."""
    free = sepv.Problem(2, np.array([[0.0, 1.0], [-1.0, 0.0]]), lambda y: y[1] ** 2 / 2, noise=(), initial=(0.0, 1.0),
                        invariants={"square": lambda y: y[1] ** 2})  # fmt: skip
    found = sepv.problem.relation(friction(free, 0.5, 2.0), "square")
    assert (found.sigma, found.decay) == pytest.approx((2.0, 1.0), rel=1e-14)


def test_steps_take_batches_bit_by_bit() -> None:
    problem, rng = problems.langevin_pair(), np.random.default_rng(2)
    y, dW = rng.standard_normal((4, 5)), rng.standard_normal((2, 5))
    for name in ("baoab", "obabo", "gronbech-jensen-farago", "friction-euler-maruyama"):
        scheme = built_in(name)
        assert scheme is not None
        more = (0.5 * dW,) if scheme.asks else ()
        together = scheme.step(problem, y, 0.25, dW, *more)
        alone = [scheme.step(problem, y[:, k], 0.25, dW[:, k], *(v[:, k] for v in more)) for k in range(5)]
        assert np.array_equal(together, np.stack(alone, axis=1))
