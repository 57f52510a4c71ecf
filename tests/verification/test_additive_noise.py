"""Additive noise outside the image of B: the problem as data, E[H] and E[C], and which schemes keep them.

The abstract of D. Cohen and G. Vilmart (arXiv 2005.13991) states that their scheme has the exact drift of both. The
problem and the numbers here are our own: of the paper the abstract and the introduction were read.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from doors import doc, verdicts
from drawn import drawn_systems
from hypothesis import given, settings
from hypothesis import strategies as st
from sepv.properties import test_casimir_drift as casimir_drift
from sepv.properties import test_energy_drift as energy_drift
from sepv.properties import test_identity as identity
from sepv.properties._trace_formula import mean_after
from sepv.reference.generator import moments

from benchmarks import additive_noise
from benchmarks.additive_noise import euler_maruyama, implicit_euler
from benchmarks.right_schemes import RIGHT
from sepv import Problem, Scheme, problems, schemes
from sepv.errors import ProblemError
from sepv.problem import HamiltoniansProblem, PolynomialSystem, Systems, vector_field
from sepv.problem._checks import check_problem
from sepv.problem._hamiltonians import noise_vectors
from sepv.problems._polynomial_system import drift_of_energy
from sepv.record import _polynomial as poly
from sepv.verification import Case

DRIFT = ["energy-drift", "casimir-drift"]
FEW = {"examples": 2, "shrink_checks": 0}


def body() -> Problem:
    return problems.pushed_rigid_body()


def scheme(step: Any) -> Scheme:
    return Scheme(step.__name__, step, systems=Systems.ADDITIVE, truncation=None, batched=True)


def casimir_change(tried: Scheme, problem: Problem, h: float) -> float:
    """E[C(y1)] − C(y0) − hσ of one step from the initial state, by quadrature."""
    y = np.asarray(problem.initial)
    C = casimir_drift.quantity(problem, problem.casimirs[0], y, h)
    return float(mean_after(tried, problem, y, h, C)[0] - C.value(y) - h * C.rate)


# The problem.


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
    for A in problem.casimirs:
        # C(y0 + x) − C(y0) = 2y0ᵀAx + xᵀAx.
        terms = np.abs(A) @ np.abs(2 * y) @ np.abs(first) + np.einsum("ij,ijk", np.abs(A), np.abs(second))
        change = (2 * y @ A) @ first + np.einsum("ij,ijk", A, second)
        rate = casimir_drift.quantity(problem, A, y, 1.0).rate
        assert abs(change[1] - rate) <= 1e-13 * (terms[1] + rate)
        assert abs(change[2]) <= 1e-13 * terms[2]


# Schemes.


@pytest.mark.parametrize("right", [schemes.drift_preserving, RIGHT["pushed-at-once"]], ids=lambda s: s.name)
def test_both_means_are_kept_by_a_push_and_a_step_that_keeps_h_and_c(right: Scheme) -> None:
    held = dict.fromkeys((*DRIFT, "identity", "noise-sum"), "holds")
    assert verdicts(right, [*held, "casimir"], **FEW) == held | {"casimir": "not applicable"}


def test_they_are_measured_of_functions_too() -> None:
    problem = HamiltoniansProblem(
        3, body().structure, lambda y: (y[0] ** 2 + y[1] ** 2 / 2 + y[2] ** 2 / 3) / 2,
        noise=(0.5,), noise_vectors=((1.0, 0.0, 2.0),), casimirs=(np.eye(3),), initial=(0.8, 0.6, 0.1),
    )  # fmt: skip
    for tried, verdict in ((schemes.drift_preserving, "holds"), (scheme(implicit_euler), "violated")):
        assert verdicts(tried, "casimir-drift", problem, **FEW) == {"casimir-drift": verdict}


def test_euler_maruyama_misses_the_mean_of_a_casimir_by_what_theory_says() -> None:
    """C = |y|² and f ⊥ y: E[C(y1)] − C(y0) − hσ is h²|f(y0)|² of the explicit scheme, −h²E|f(y1)|² of the implicit."""
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
    case = energy_drift.steady(Case(data, (0.5, 0.25, 0.75), 0.25, (0.0,) * 3))
    assert case is not None
    assert energy_drift.check(schemes.drift_preserving, case).ratio <= 1
