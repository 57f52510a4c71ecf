"""Classes beside (1.1): systems given by g and C, damped systems,
and additive noise outside the image of B.

Of additive noise the abstract of D. Cohen and G. Vilmart (arXiv 2005.13991) states that their
scheme has the exact drift of H and C. The problem and the numbers are our own: of the paper the
abstract and the introduction were read.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from doors import doc, verdicts
from drawn import drawn_systems
from drawn import steps as drawn_steps
from hypothesis import given, settings
from hypothesis import strategies as st
from sepv.properties import test_identity as identity
from sepv.properties import test_invariant as invariant
from sepv.properties._stated_functions import casimirs, drift_of_energy
from sepv.properties._trace_formula import mean_after
from sepv.reference.equations_by_class import BOTH_INVARIANTS
from sepv.reference.generator import moments
from sepv.reference.steps import reference_step

import sepv
from benchmarks import additive_noise
from benchmarks.additive_noise import euler_maruyama, implicit_euler
from benchmarks.right_schemes import RIGHT_SCHEMES
from sepv import Problem, Scheme, problems, schemes
from sepv.errors import ProblemError, Skipped, SystemsError
from sepv.problem import (
    DampedProblem,
    HamiltoniansProblem,
    PolynomialSystem,
    Systems,
    noise_vectors,
    vector_field,
)
from sepv.problem._checks import check_problem
from sepv.problems import from_json, to_json
from sepv.record import _polynomial as poly
from sepv.simulate import _wiener as wiener
from sepv.verification import Case, state_ulp

# States of size one: these are about formulas, and not about the ends of binary64.
ONE = {"|y|": ("1",)}


@given(drawn_steps(Systems.NAMBU, **ONE))
def test_structure_is_what_the_factor_and_the_casimir_say(case: Case) -> None:
    problem, y, _, _ = case.build()
    v, nambu = np.array([0.3, -1.1, 0.7]), problem.nambu
    assert nambu is not None
    expected = nambu.factor(y) * np.cross(v, nambu.gradient(y))
    size = 1 + np.abs(expected).max()
    assert np.allclose(problem.structure(y) @ v, expected, rtol=1e-13, atol=1e-13 * size)
    for k in range(3):  # C″ against the complex step
        z = y.astype(complex)
        z[k] += 1e-30j
        assert np.allclose(nambu.hessian(y)[:, k], nambu.gradient(z).imag / 1e-30, rtol=1e-12, atol=1e-12)
        assert np.allclose(nambu.gradient(y)[k], nambu.casimir(z).imag / 1e-30, rtol=1e-12, atol=1e-12)


@given(drawn_steps(Systems.NAMBU, degree_of_C=("2",), **ONE))
def test_for_a_quadratic_casimir_it_is_the_energy_preserving_scheme(case: Case) -> None:
    """To 40 digits as an equation, to two ulps as a step."""
    args = (case.problem, case.y, case.h, case.dW)
    both, plain = (
        reference_step(BOTH_INVARIANTS, *args, 40).y1,
        reference_step("energy-preserving", *args, 40).y1,
    )
    assert max(abs(a - b) for a, b in zip(both, plain, strict=True)) < 1e-38 * (1 + max(map(abs, plain)))
    problem, y, h, dW = case.build()
    found = schemes.both_invariants.step(problem, y, h, dW)
    plain = schemes.energy_preserving.step(problem, y, h, dW)
    assert np.max(np.abs(found - plain)) <= 2 * state_ulp(y, found)


def test_lotka_volterra_keeps_both_where_the_paper_keeps_one() -> None:
    problem, C = problems.lotka_volterra(), problems.lotka_volterra().nambu.casimir
    drifts = {}
    for scheme in (schemes.both_invariants, schemes.energy_preserving):
        path = sepv.integrate(scheme, problem, h=2.0**-8, T=2.0, seed=1)
        drifts[scheme.name] = (np.ptp(problem.hamiltonian(path.y)), np.ptp(C(path.y)))
    assert drifts["both-invariants"][0] < 1e-13
    assert drifts["both-invariants"][1] < 1e-13
    assert drifts["energy-preserving"][0] < 1e-13
    assert drifts["energy-preserving"][1] > 1e-4


PATHS = 200


def test_conformal_has_order_one_against_the_flow_at_a_time_of_the_whole_path() -> None:
    """y(T) = e^{−γT}φ_θ(y0), θ = ∫e^{−κγs}(ds + c dW), κ = 1 for the rigid body.

    θ is a sum over steps of 2⁻¹¹, whose error is h_fine/√12·κγ of the size of W: 1e-4. A scheme of
    order ½ would have a ratio of 2 and one of order 1 has 4: 200 paths measure it to some per cent.
    """
    top = problems.damped_top()
    gamma, T, fine = 0.5, 1.0, 2048
    dW = wiener.increments(0, T=T, steps=fine, noises=1, paths=range(PATHS))
    middle = (np.arange(fine) + 0.5) * T / fine
    theta = (1 - np.exp(-gamma * T)) / gamma + np.exp(-gamma * middle) @ dW[:, 0]
    undamped = problems.rigid_body()
    exact = np.exp(-gamma * T) * sepv.exact_flow(undamped, theta, np.array(top.initial)).y
    errors = []
    for steps in (16, 64):
        y = np.repeat(np.array(top.initial)[:, None], PATHS, axis=1)
        for increment in wiener.coarsen(dW, fine // steps):
            y = schemes.conformal.step(top, y, T / steps, increment)
        errors.append(np.sqrt(np.mean(np.sum((y - exact) ** 2, axis=0))))
    assert 2.8 < errors[0] / errors[1] < 5.6


def test_casimir_and_energy_decay_by_their_factors_over_many_steps() -> None:
    top = problems.damped_top(damping=0.25)
    path = sepv.integrate("conformal", top, h=0.125, T=16.0, seed=3)
    factor = np.exp(-0.5 * path.t)
    assert np.allclose(np.sum(path.y**2, axis=0), factor, rtol=1e-13)
    assert np.allclose(top.hamiltonian(path.y), factor * top.hamiltonian(path.y[:, 0]), rtol=1e-13)


def test_damping_is_data() -> None:
    top = problems.damped_top()
    assert from_json(to_json(top)) == top.data
    assert to_json(top.data)["damping"] == (0.5).hex()
    assert isinstance(problems.build(top.data), DampedProblem)
    assert type(problems.build(replace(top.data, damping=0.0))) is sepv.Problem


@pytest.mark.parametrize("name", [*schemes.PAPER, *schemes.EXTENSIONS, *schemes.HAMILTONIANS])
def test_no_other_scheme_leaves_the_damping_out_in_silence(name: str) -> None:
    scheme, top = schemes.by_name(name), problems.damped_top()
    further = {"areas": np.zeros((1, 1)), "halves": np.zeros(1), "space-time": np.zeros(1)}.get(scheme.asks)
    arguments = (top, np.array(top.initial), 0.1, np.array([0.1]), *([] if further is None else [further]))
    with pytest.raises((SystemsError, Skipped)):
        scheme.step(*arguments)


DRIFT = ["invariant:energy", "invariant:casimir"]
FEW = {"examples": 2, "shrink_checks": 0}


def body() -> Problem:
    return problems.pushed_rigid_body()


def scheme(step: Any) -> Scheme:
    return Scheme(step.__name__, step, systems=Systems.ADDITIVE, truncation=None, batched=True)


def casimir_change(tried: Scheme, problem: Problem, h: float) -> float:
    """E[C(y1)] − C(y0) − hσ of one step from the initial state, by quadrature."""
    y = np.asarray(problem.initial)
    assert problem.data is not None
    C = casimirs(Case(problem.data, tuple(y), h, (0.0,) * problem.noises))[0]
    mean = mean_after(tried, problem, y, h, invariant.quantity(C, y))[0]
    return float(mean - C.value(y) - h * C.relation.sigma)


# Additive noise.


def test_vectors_survive_json_and_are_checked() -> None:
    problem = body()
    check_problem(problem)
    again = problems.build(problems.from_json(problems.to_json(problem)))
    assert np.array_equal(noise_vectors(again), [[1.0, 0.5, 0.0], [0.0, 0.5, 1.0]])
    data = problem.data
    assert isinstance(data, PolynomialSystem)
    twice: dict[str, Any] = {"noise_hamiltonians": (data.hamiltonian,) * 2}
    short: dict[str, Any] = {"noise_vectors": ((1.0, 0.0), (1.0, 0.0))}
    one: dict[str, Any] = {"noise": (1.0,)}
    for wrong, said in (
        (one, "2 vectors, 1 coefficients"), (twice, "2 Hamiltonians, 2 vectors"), (short, "shape"),
    ):  # fmt: skip
        with pytest.raises(ProblemError, match=said):
            problems.build(replace(data, **wrong))
    given: dict[str, Any] = {"noise": (1.0,), "noise_vectors": ((0.0, 0.0, 1.0),)}
    parts = (3, problem.structure, problem.hamiltonian)
    assert isinstance(HamiltoniansProblem(*parts, **given), HamiltoniansProblem)
    with pytest.raises(ProblemError, match="both"):
        HamiltoniansProblem(*parts, **given, noise_hamiltonians=(problem.hamiltonian,))


# The trace formula, of the exact solution.


@settings(max_examples=20)
@given(drawn_systems(Systems.ADDITIVE, d=("2", "3"), m=("1", "2")), st.integers(0, 99))
def test_means_of_casimirs_grow_at_a_constant_rate(system: PolynomialSystem, seed: int) -> None:
    """By the generator's series, which is exact: σh and nothing of h²."""
    assert drift_of_energy(system) is not None
    problem, d = problems.build(system), system.dimension
    y = np.random.default_rng(seed).integers(-4, 5, d) / 4
    units = [tuple(int(k == i) for k in range(d)) for i in range(d)]
    pairs = [tuple(np.add(a, b).tolist()) for a in units for b in units]
    series = np.array(moments(system, tuple(y.tolist()), (*units, *pairs), 2), dtype=float)
    first, second = series[:d], series[d:].reshape(d, d, -1)
    stated = casimirs(Case(system, tuple(y), 1.0, (0.0,) * problem.noises))
    for A, C in zip(problem.casimirs, stated, strict=False):
        # C(y0 + x) − C(y0) = 2y0ᵀAx + xᵀAx.
        terms = np.abs(A) @ np.abs(2 * y) @ np.abs(first) + np.einsum("ij,ijk", np.abs(A), np.abs(second))
        change = (2 * y @ A) @ first + np.einsum("ij,ijk", A, second)
        rate = C.relation.sigma
        assert abs(change[1] - rate) <= 1e-13 * (terms[1] + rate)
        assert abs(change[2]) <= 1e-13 * terms[2]


@pytest.mark.parametrize(
    "right", [schemes.drift_preserving, RIGHT_SCHEMES["pushed-at-once"]], ids=lambda s: s.name
)
def test_both_means_are_kept_by_a_push_and_a_step_that_keeps_h_and_c(right: Scheme) -> None:
    held = dict.fromkeys((*DRIFT, "identity", "noise-sum"), "holds")
    assert verdicts(right, [*held, "casimir"], **FEW) == held | {"casimir": "not applicable"}


def test_they_are_measured_of_functions_too() -> None:
    problem = HamiltoniansProblem(
        3, body().structure, lambda y: (y[0] ** 2 + y[1] ** 2 / 2 + y[2] ** 2 / 3) / 2,
        noise=(0.5,), noise_vectors=((1.0, 0.0, 2.0),), casimirs=(np.eye(3),), initial=(0.8, 0.6, 0.1),
    )  # fmt: skip
    for tried, verdict in ((schemes.drift_preserving, "holds"), (scheme(implicit_euler), "violated")):
        assert verdicts(tried, "invariant:casimir", problem, **FEW) == {"invariant:casimir": verdict}


def test_euler_maruyama_misses_the_mean_of_a_casimir_by_what_theory_says() -> None:
    """C = |y|² and f ⊥ y: E[C(y1)] − C(y0) − hσ is h²|f(y0)|² of the explicit scheme,
    −h²E|f(y1)|² of the implicit.
    """
    problem, h = body(), 2.0**-6
    f = vector_field(problem, np.asarray(problem.initial))
    explicit, implicit = (casimir_change(scheme(s), problem, h) for s in (euler_maruyama, implicit_euler))
    assert explicit == pytest.approx(h**2 * float(f @ f), rel=1e-9)
    assert implicit == pytest.approx(-(h**2) * float(f @ f), rel=0.1)
    assert abs(casimir_change(schemes.drift_preserving, problem, h)) < 1e-14


def test_the_page_has_the_numbers_of_today() -> None:
    """Of the explicit scheme, which a compiler or another processor changes by roundings alone."""
    mean, error = additive_noise.rates(additive_noise.euler_maruyama, body(), 2)
    assert f"| Euler-Maruyama | {mean[0]:.3f} ± {error[0]:.3f} |" in doc("class.md")


# What the laws must not say.


def test_noise_at_a_rest_point_of_the_drift_moves_the_state_rightly() -> None:
    data = body().data
    assert isinstance(data, PolynomialSystem)
    case = identity.unmoved(Case(data, (0.0, 0.0, 0.0), 0.25, (0.5, 0.5)))
    assert case.dW == (0.0, 0.0)
    assert identity.check(schemes.drift_preserving, case).ratio == 0


def test_an_energy_that_is_harmonic_along_three_noises_is_judged_with_the_error_of_the_quadrature() -> None:
    """LH = 0 with H of degree 4 along the noise, where six halves have a rule of degree 3 alone."""
    H = poly.polynomial(3, {(4, 0, 0): 1.0, (2, 2, 0): -6.0, (0, 4, 0): 1.0})
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    data = PolynomialSystem(3, H, problems.random_inertia().data.structure, (1.0,) * 3, noise_vectors=axes)
    assert drift_of_energy(data) == 0
    case = invariant.as_data(Case(data, (0.5, 0.25, 0.75), 0.25, (0.0,) * 3))
    assert case is not None
    assert invariant.check_energy(schemes.drift_preserving, case).ratio <= 1
