"""Several Hamiltonians: the record, its brackets and Itô form, data, areas, references,
and the orders of schemes.
"""

import pickle
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pytest
from doors import measured, says
from drawn import drawn_systems
from drawn import steps as steps_of
from hypothesis import given, settings
from hypothesis import strategies as st
from sepv.properties._orders.local_errors import local_errors
from sepv.properties._orders.local_moments import exponents
from sepv.properties._orders.log_ode import log_flow
from sepv.properties._orders.several_fields import ends, refined
from sepv.properties._stated_functions import drift_of_energy
from sepv.reference.generator import moments

from sepv import problems, schemes
from sepv.core.arrays import matvec
from sepv.law.cases import case as cases
from sepv.law.cases.case import from_token, to_token
from sepv.law.cases.shrink import shrunk
from sepv.law.contraction import contraction_ball
from sepv.problem import (
    Array,
    HamiltoniansProblem,
    PolynomialSystem,
    Problem,
    StructuresProblem,
    Systems,
    column,
    commutes,
    each_noise,
    ito_drift,
)
from sepv.problem._channels import bracket, combined_field, noise_field, slope
from sepv.schemes import Orders, Scheme, as_lanes, order_of
from sepv.simulate import _areas as areas
from sepv.verification import Case, Run, Verdict

QUICK = {"examples": 4, "shrink_checks": 0}


@pytest.mark.parametrize("name", [*problems.HAMILTONIANS, "kubo-oscillator"])
def test_flows_of_problems_are_those_of_their_fields(name: str) -> None:
    problem = problems.by_name(name)
    y, t = np.asarray(problem.initial), 1e-5
    for j, flow in enumerate(getattr(problem, "noise_flows", ())):
        slope = (flow(y, np.array(t)) - flow(y, np.array(-t))) / (2 * t)
        assert np.allclose(slope, noise_field(problem, j, y), atol=1e-9)
    if problem.flows:
        total = sum((flow(y, np.array(t)) - flow(y, np.array(-t))) / (2 * t) for flow in problem.flows)
        assert np.allclose(total, problem.structure(y) @ problem.gradient(y), atol=1e-9)


def test_the_kind_of_noise_is_told_by_brackets() -> None:
    expected = {
        "random-inertia": "general", "two-spins": "commutative", "noisy-henon-heiles": "additive",
        "pushed-henon-heiles": "additive", "commuting-twists": "commutative", "twisted-top": "one",
        "random-maxwell-bloch": "one", "point-vortices": "general", "random-lotka-volterra": "general",
        "kubo-oscillator": "one", "rigid-body": "one", "pendulum": "one", "commuting-rotations": "commutative",
        "noncommuting-drift": "commutative", "noncommuting-tops": "general",
    }  # fmt: skip
    assert {name: column(problems.by_name(name)) for name in expected} == expected
    assert commutes(problems.kubo_oscillator())
    assert commutes(problems.commuting_oscillators())
    assert not commutes(problems.noncommuting_drift())
    assert not commutes(problems.two_spins())


def test_what_is_derived_is_what_was_given() -> None:
    given_ = problems.random_inertia()
    assert isinstance(given_, HamiltoniansProblem)
    H = lambda y: (y[0] ** 2 / 0.345 + y[1] ** 2 / 0.653 + y[2] ** 2) / 2  # noqa: E731
    parts = (lambda y: y[0] ** 2 / 2, lambda y: y[1] ** 2)
    derived = HamiltoniansProblem(
        3, given_.structure, H, noise=given_.c, noise_hamiltonians=parts, initial=given_.initial
    )
    y = np.array([0.3, -0.7, 1.1])
    assert np.allclose(ito_drift(derived, y), ito_drift(given_, y), rtol=1e-14)
    assert np.allclose(bracket(derived, 1, 2, y), bracket(given_, 1, 2, y), rtol=1e-14)
    bare = replace(given_, noise_hessians=(), hessian=None, structure_derivative=None, check=False)
    assert np.allclose(slope(bare, 2, y), slope(given_, 2, y), atol=1e-6)


@settings(max_examples=15)
@given(drawn_systems(Systems.HAMILTONIANS, degree_of_H=("1–2", "3–4"), d=("2", "3")), st.integers(0, 99))
def test_the_ito_form_is_the_drift_of_the_generator(system: PolynomialSystem, seed: int) -> None:
    # E[y − y0] = h L y + O(h²), by exact arithmetic.
    problem = problems.build(system)
    y = np.random.default_rng(seed).uniform(-1, 1, system.dimension).round(3)
    first = moments(system, tuple(y.tolist()), exponents(system.dimension, 1), 1)
    rate = np.array([float(row[1]) for row in first])
    assert np.allclose(ito_drift(problem, y), rate, rtol=1e-10, atol=1e-10 * (1 + np.abs(rate).max()))


def test_systems_travel_as_json_and_tokens_and_shrink() -> None:
    data = problems.random_inertia().data
    assert isinstance(data, PolynomialSystem)
    assert problems.from_json(problems.to_json(data)) == data
    steps: list[Case] = []

    @settings(max_examples=20)
    @given(steps_of(Systems.HAMILTONIANS))
    def draw(case: Case) -> None:
        assert from_token(to_token(case)) == case
        steps.append(case)

    draw()
    case = max(steps, key=lambda c: len(c.describe()))
    assert "H1(y) = " in case.describe()
    simple = shrunk(case, lambda c: isinstance(c.build()[0], HamiltoniansProblem))
    assert len(simple.describe()) < len(case.describe())
    assert isinstance(simple.build()[0], HamiltoniansProblem)


def test_orders_are_floats_that_know_more() -> None:
    order = Orders(0.5, commutative=1.0, additive=2.0)
    assert order == 0.5
    assert [order.of(k) for k in ("general", "commutative", "one", "additive")] == [0.5, 1.0, 1.0, 2.0]
    assert pickle.loads(pickle.dumps(order)).additive == 2.0
    assert order_of(1.5, "general") == 1.5
    assert order_of(None, "general", 0.5) == 0.5


# References.


def test_the_log_flow_is_exact_where_fields_commute() -> None:
    problem = problems.kubo_oscillator()
    assert isinstance(problem, StructuresProblem)
    assert problem.closed_form is not None
    y0, W = np.asarray(problem.initial), np.array([[0.7, -1.3]])
    exact = problem.closed_form(y0, 0.5, W)
    free = replace(problem, closed_form=None, check=False)
    derived = ends(free, y0, 0.5, W)
    assert derived is not None
    assert np.max(np.abs(derived - exact)) <= 1e-13
    parts = np.concatenate([np.full((1, 2), 0.5), problem.c[:, None] * W])
    found, error = log_flow(problem, np.repeat(y0[:, None], 2, axis=1), parts, np.zeros((0, 2)))
    assert np.max(np.abs(found - exact)) <= 1e-13
    assert error < 1e-12


def test_the_reference_agrees_with_another_one_to_what_it_says() -> None:
    """Twice as fine: both are off by what they say at most,
    three times for the root mean square of 64 paths.
    """
    problem = problems.random_inertia()
    y0 = np.asarray(problem.initial)
    rough, y, apart = refined(problem, y0, 0.5, 32, range(64), 7, order=1.0)
    fine = areas.drawn(7, T=0.5, steps=1024, noises=2, paths=range(64))
    # The increments are the same path's; its areas over 256 steps are drawn again, so that of this
    # one only a coarse reference is made.
    assert np.allclose(fine.coarse(256).dW, rough.dW, atol=1e-15)
    from sepv.properties._orders.log_ode import path

    half = path(problem, y0, rough.coarse(64), with_drift=False)
    distance = float(np.sqrt(np.mean(np.sum((half - y) ** 2, axis=0))))
    assert apart < 2e-3
    assert distance < 3 * 3 * apart


# Orders of the schemes, by quadrature.


@pytest.mark.parametrize(
    ("name", "problem", "slopes"),
    [
        ("stochastic-midpoint", "random-inertia", (2.0, 1.0, 2.0)),
        ("stochastic-midpoint", "two-spins", (2.0, 1.5, 2.0)),
        ("stochastic-midpoint", "random-maxwell-bloch", (2.0, 1.5, 2.0)),
        ("area-midpoint", "random-inertia", (2.0, 1.5, 2.0)),
        ("stochastic-splitting", "random-inertia", (2.0, 1.0, 2.0)),
        ("isospectral-midpoint", "random-inertia", (2.0, 1.0, 2.0)),
        ("isospectral-midpoint", "two-spins", (2.0, 1.5, 2.0)),
        ("darboux-lie", "lotka-volterra", (2.0, 1.5, 2.0)),
        ("drift-preserving", "noisy-henon-heiles", (3.0, 1.5, 3.0)),
    ],
)
def test_local_errors_have_the_slopes_of_the_theory(name, problem, slopes):
    found = local_errors(schemes.by_name(name), problems.by_name(problem), Run())
    # Above rounding, at fine steps: a slope within 0.1.
    for errors, expected in zip((found.mean, found.rms, found.weak), slopes, strict=True):
        real = np.flatnonzero(errors > 1e-11)[-3:]
        slope = np.polyfit(np.log(found.h[real]), np.log(errors[real]), 1)[0]
        assert slope == pytest.approx(expected, abs=0.1)


def test_laws_about_h_say_that_it_is_not_kept() -> None:
    laws = "energy,rounding,midpoint,reference,random-step"
    report = measured("stochastic-midpoint", laws, **QUICK)
    assert {f.verdict for f in report.findings} == {Verdict.NOT_APPLICABLE}
    assert "does not keep H_0" in report.finding("energy").message


def test_random_species_stay_positive_or_not() -> None:
    """Exact flows and logarithms keep the octant of every Lotka-Volterra system,
    an explicit step does not.
    """
    for scheme in (schemes.stochastic_splitting, schemes.darboux_lie):
        whole = replace(scheme, name="for the class", problems=(), systems=Systems.HAMILTONIANS)
        assert says(whole, "positivity", "holds", **QUICK).checks >= QUICK["examples"]

    def euler(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        parts = np.concatenate([[h], problem.c * dW])[:, None]
        return y + combined_field(problem, y[:, None], parts)[:, 0]

    own = Scheme("euler", euler, systems=Systems.HAMILTONIANS)
    finding = says(own, "positivity", "violated", "random-lotka-volterra: beta", **QUICK)
    case = cases.from_json(finding.witness)
    assert from_token(to_token(case)) == case
    assert not np.all(euler(case.build()[0], *case.build()[1:]) > 0)


def _explicit(problem: Problem, y: Array, h: float, dW: Array, share: float) -> Array:
    """A Runge-Kutta method of two stages: the explicit midpoint rule for a share of ½,
    Heun's for 1.
    """
    state, noise = as_lanes(problem, y, h, dW)
    parts = each_noise(problem, h, noise)
    first = combined_field(problem, state, parts)
    second = combined_field(problem, state + share * first, parts)
    return np.asarray(state + (1 - 0.5 / share) * first + 0.5 / share * second).reshape(y.shape)


def _one_sided(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Milstein's terms ½ΔW_iΔW_j g_j′g_i by differences over √h, which leave ½√h g_j″(g_i, g_i)
    in them.
    """
    state, noise = as_lanes(problem, y, h, dW)
    value = state + combined_field(problem, state, each_noise(problem, h, noise))
    for i, j in product(range(problem.noises), repeat=2):
        ahead = state + np.sqrt(h) * problem.c[i] * noise_field(problem, i, state)
        change = noise_field(problem, j, ahead) - noise_field(problem, j, state)
        value = value + 0.5 * noise[i] * noise[j] * problem.c[j] * change / np.sqrt(h)
    return np.asarray(value).reshape(y.shape)


def _without_cross_terms(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Milstein's terms of each noise with itself alone."""
    state, noise = as_lanes(problem, y, h, dW)
    value = state + combined_field(problem, state, each_noise(problem, h, noise))
    for j, c in enumerate(problem.c):
        turned = matvec(slope(problem, 1 + j, state), noise_field(problem, j, state))
        value = value + 0.5 * (c * noise[j]) ** 2 * turned
    return np.asarray(value).reshape(y.shape)


STRONG, WEAK = Orders(0.5, commutative=1.0), Orders(1.0, additive=2.0)


@pytest.mark.parametrize(
    ("step", "orders", "law", "verdict", "hiding"),
    [
        (partial(_explicit, share=0.5), {"weak_order": WEAK}, "local-weak", "violated", ("noisy-henon-heiles",)),
        (partial(_explicit, share=1.0), {"weak_order": WEAK}, "local-weak", "holds", ("noisy-henon-heiles",)),
        (_one_sided, {"mean_square_order": STRONG}, "local-mean", "violated", ("two-spins", "random-maxwell-bloch")),
        (_without_cross_terms, {"mean_square_order": STRONG}, "local-mean-square", "violated", ("two-spins",)),
    ],
    ids=["explicit-midpoint", "heun", "one-sided", "without cross terms"],
)  # fmt: skip
def test_default_problems_show_errors_that_symmetric_ones_hide(step, orders, law, verdict, hiding):
    """Of pushed momenta, of linear noise fields, and of noises apart,
    the wrong claims would seem right.
    """
    scheme = Scheme("own", step, systems=Systems.HAMILTONIANS, truncation=None, batched=True, **orders)
    says(scheme, law, verdict)
    says(replace(scheme, problems=hiding), law, "holds")


# The trace formula.


def test_a_drift_that_is_not_constant_is_not_taken_for_one() -> None:
    data = problems.random_inertia().data
    assert isinstance(data, PolynomialSystem)
    assert drift_of_energy(data) is None


@given(drawn_systems(Systems.MATRIX_HAMILTONIANS))
def test_balls_bound_all_hamiltonians(system: PolynomialSystem) -> None:
    problem = problems.build(system)
    y = np.resize([0.5, -0.25, 1.0], system.dimension)
    radius, r = contraction_ball(problem, y)
    for j in range(problem.noises):
        assert radius * np.max(np.abs(noise_field(problem, j, y))) <= r
