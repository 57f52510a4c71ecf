"""Symmetry, the random step, equivariance, reversed momenta and volume: each holds and is broken without the others."""

import math
from dataclasses import replace

import numpy as np
import pytest
from doors import finding, verdicts
from sepv.properties import test_equivariance as equivariance
from sepv.properties._reversal import momentum_flip
from sepv.reference.faults.saboteurs import SABOTEURS

from benchmarks.right_schemes import RIGHT
from sepv import Scheme, Skipped, problems, schemes, verify
from sepv.problem import Array, PolynomialSystem, Problem, mechanics
from sepv.record import _polynomial as poly
from sepv.verification import Case, Effort, Finding, Verdict

LAWS = ("symmetry", "random-step")


def measured(scheme: Scheme, examples: int = 8) -> list[Finding]:
    report = verify(scheme, laws=LAWS, effort=Effort(examples=examples, shrink_checks=20))
    return [report.finding(law) for law in LAWS]


@pytest.mark.parametrize(
    ("scheme", "symmetric", "of_the_random_step"),
    [
        (RIGHT["trapezoidal-drift"], "holds", "violated"), (schemes.explicit(4), "violated", "holds"),
        # Steps backward have h < 0, and such cases are among those of the random step too.
        (SABOTEURS["absolute-h"].scheme, "violated", "violated"),
    ],
    ids=lambda value: getattr(value, "name", value),
)  # fmt: skip
def test_symmetry_and_being_a_function_of_the_random_step_are_two_laws(scheme, symmetric, of_the_random_step):
    symmetry, random_step = measured(scheme)
    assert (symmetry.verdict.text, random_step.verdict.text) == (symmetric, of_the_random_step)
    if symmetric == "holds":
        # Not by a little: the two rules differ in Δ³, of the order of a thousandth at |Δ| = 0.1.
        assert (random_step.defect or 0) > 1e6


def no_root(problem, y, h, dW):
    return schemes.energy_preserving.step(problem, y, math.sqrt(h) ** 2, dW)


def not_a_number(problem, y, h, dW):
    return schemes.energy_preserving.step(problem, y, h, dW) * np.sqrt(np.copysign(1.0, h))


def refused(problem, y, h, dW):
    if h < 0:
        raise ArithmeticError("no steps backward in time")
    return schemes.energy_preserving.step(problem, y, h, dW)


@pytest.mark.parametrize("step", [no_root, not_a_number, refused])
def test_a_scheme_without_negative_h_is_not_measured_and_the_table_says_so(step) -> None:
    symmetry, random_step = measured(Scheme("forward", step, LAWS), examples=5)
    assert symmetry.verdict is Verdict.NOT_APPLICABLE
    assert "makes no step with h < 0" in symmetry.message
    assert random_step.verdict is Verdict.HOLDS, random_step.message


@pytest.mark.parametrize("at_rest", [True, False])
def test_a_step_with_h_zero_has_the_noise_or_is_refused(at_rest: bool) -> None:
    def step(problem, y, h, dW):
        if h == 0 and at_rest:
            return y.copy()
        return schemes.energy_preserving.step(problem, y, h * (h / h), dW)  # divides by h, as some do

    found = finding(step, "random-step", examples=2, shrink_checks=0)
    assert found.verdict.text == ("violated" if at_rest else "holds")


def test_a_step_back_that_fails_where_others_do_not_is_an_error() -> None:
    def step(problem, y, h, dW):
        if h < -1e-4:
            raise ArithmeticError("too far back")
        return schemes.energy_preserving.step(problem, y, h, dW)

    symmetry, _ = measured(Scheme("short of breath", step, LAWS), examples=20)
    assert symmetry.verdict is Verdict.ERROR
    assert "not solved" in symmetry.message


H = poly.polynomial(2, [((2, 0), 0.5), ((0, 2), 0.5), ((1, 2), 0.25)])
SYSTEM = PolynomialSystem(2, H, ((0, 1, poly.polynomial(2, [((0, 0), -1.0), ((1, 0), 0.5)])),), (1.0,))


def test_a_term_in_y_is_seen_by_the_translation(monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case(SYSTEM, (0.5, -0.25), 0.03125, (0.0625,))
    scheme = SABOTEURS["term-in-y"].scheme
    assert equivariance.check(scheme, case).violates
    linear = [t for t in equivariance.transformations(np.array(case.y)) if not t[3].any()]
    assert len(linear) == 3
    monkeypatch.setattr(equivariance, "transformations", lambda y: linear)
    assert not equivariance.check(scheme, case).violates


def test_the_transformed_system_is_the_same_system_in_other_variables() -> None:
    problem, y = problems.build(SYSTEM), np.array([0.5, -0.25])
    for name, P, inverse, b in equivariance.transformations(y):
        other = problems.build(equivariance.transformed(SYSTEM, P, inverse, b))
        z = P @ y + b
        assert other.hamiltonian(z) == problem.hamiltonian(y), name
        assert np.array_equal(P @ problem.structure(y) @ P.T, other.structure(z)), name
        assert np.array_equal(inverse.T @ problem.gradient(y), other.gradient(z)), name


def test_a_method_of_the_field_alone_is_affine() -> None:
    """As those of the paper are, which the files of `properties` measure."""
    assert verdicts("explicit-8", "equivariance", examples=15) == {"equivariance": "holds"}


def test_the_rounding_of_itos_correction_accuses_nobody() -> None:
    """ΔW far below √h: ½c²hf′f moves y by 1 and Δf by 0.01, and H has terms that cancel in moved coordinates."""
    H = poly.polynomial(4, [((0, 0, 0, 2), -98304.0), ((1, 1, 1, 0), 262144.0)])
    system = PolynomialSystem(4, H, ((1, 3, poly.constant(4, 1.0)),), (2.0,))
    y = (1.0, -0.7017122627277087, 0.00034158379798636206, 0.9723055064388266)
    case = Case(system, y, 2.976779282863654e-08, (2.0656965763279653e-08,))
    measured = equivariance.check(schemes.euler_maruyama, case)
    assert not measured.violates
    assert measured.defect > 1000  # ulp of y


@pytest.mark.parametrize(
    ("name", "momenta"),
    [
        ("pendulum", [0]),
        ("harmonic-oscillator", [0]),
        ("henon-heiles", [2, 3]),
        ("lennard-jones", range(6, 12)),
        ("rigid-body", None),
        ("lotka-volterra", None),
    ],
)
def test_momenta_are_the_half_of_y_that_b_names(name: str, momenta: list[int] | None) -> None:
    rho = momentum_flip(problems.by_name(name))
    assert (None if rho is None else np.flatnonzero(rho < 0).tolist()) == (momenta and list(momenta))


def test_a_hamiltonian_odd_in_the_momenta_has_no_reversal() -> None:
    pendulum = problems.pendulum()
    drifting = Problem(2, pendulum.structure, lambda y: pendulum.hamiltonian(y) + y[0] * 1e-9, check=False)
    assert momentum_flip(drifting) is None


def verlet(problem: Problem, y: Array, h: float, dW: Array, friction: float = 0.0, halves: int = 2) -> Array:
    """Verlet's method, with friction for a factor of the momenta; with one half it is symplectic Euler."""
    if h < 0:
        raise ArithmeticError("no step backward in time")
    system, dt = mechanics(problem), problem.random_step(h, dW)
    q, p = system.split(y)
    p = (1 - friction * dt) * p + (dt / 2 if halves == 2 else dt) * system.force(q)
    q = q + dt * system.velocity(p)
    return system.join(q, p + dt / 2 * system.force(q) if halves == 2 else p)


@pytest.mark.parametrize(
    ("changes", "reversible", "volume"),
    [
        ({}, "holds", "holds"),
        ({"halves": 1}, "violated", "holds"),
        ({"friction": 1e-7}, "violated", "violated"),
    ],
)
def test_verlet_is_reversible_though_it_makes_no_step_backward(changes, reversible, volume):
    scheme = Scheme("verlet", lambda *step: verlet(*step, **changes), systems="mechanical")
    found = verdicts(scheme, "reversibility,volume,symmetry", examples=2)
    assert found == {"reversibility": reversible, "volume": volume, "symmetry": "not applicable"}


def test_a_charge_in_a_magnetic_field_keeps_volume_with_boris_and_not_with_another_turn() -> None:
    boris = RIGHT["boris"]
    assert verdicts(boris, "volume", examples=2) == {"volume": "holds"}

    def stretched(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        """The turn by I + ΔW instead of Cayley's transform."""
        v = y[3:] + problem.random_step(h, dW) * (problem.structure(y) @ problem.gradient(y))[3:]
        return np.concatenate([y[:3] + problem.random_step(h, dW) * v, v])

    assert verdicts(replace(boris, step=stretched), "volume", examples=2) == {"volume": "violated"}


def test_a_flow_that_changes_volume_is_not_asked() -> None:
    """Lotka and Volterra's system stretches volumes."""

    def refused(*_: object) -> Array:
        raise Skipped("never asked")

    found = finding(Scheme("none", refused), "volume", "lotka-volterra")
    assert found.verdict.text == "not applicable"
    assert "changes volume" in found.message
