"""The scheme record, and schemes against their formulas and derivations,
written out again in another way.
"""

from dataclasses import replace

import numpy as np
import pytest
from doors import verdicts
from hypothesis import given
from sepv.reference.problem import exact_problem

import sepv
from sepv import Scheme, problems, schemes
from sepv.core.formula import CountedFields
from sepv.law import strategies
from sepv.law.cases.classes import CLASSES
from sepv.law.tolerance import gradient_majorant
from sepv.problem import PolynomialSystem, Systems, mechanics
from sepv.record import _polynomial as poly
from sepv.schemes import ask
from sepv.schemes._discrete_gradient import coordinate_increments
from sepv.schemes._discrete_gradient import step as discrete
from sepv.verification import Case, Cases, load_laws


@given(strategies.steps())
def test_discrete_gradient_is_the_quotient_where_that_can_be_computed(case: Case) -> None:
    """Components of ∇̄₁H are quotients (H(…ȳ_i…) − H(…y_i…))/(ȳ_i − y_i),
    with digits to spare for what cancels.
    """
    problem, y, _, _ = case.build()
    y1 = y + 0.3 * np.cos(np.arange(y.size)) * np.array([1.0, 0.0, 1e-9])[np.arange(y.size) % 3]
    start, end = y[:, None], y1[:, None]
    found = coordinate_increments(CountedFields(problem, start, end), start, end - start)[:, 0]
    exact = exact_problem(case.problem, 150)
    corner, bound = exact.state(y), gradient_majorant(problem, np.maximum(np.abs(y), np.abs(y1)))
    for i in range(y.size):
        moved = list(corner)
        moved[i] = exact.ctx.mpf(float(y1[i]))
        if y1[i] == y[i]:
            expected = exact.gradient(corner)[i]
        else:
            expected = (exact.hamiltonian(moved) - exact.hamiltonian(corner)) / (moved[i] - corner[i])
        # Quadrature with at most 3 nodes of sums of at most 11 terms of degree ≤ 5.
        assert abs(float(expected - float(found[i]))) <= 40 * 2.3e-16 * bound[i] + 1e-300
        corner = moved


def test_discrete_gradient_trusts_no_edge_that_is_rough() -> None:
    """Along one edge ∇H has a kink: where y1 moves while y2 = 0, and not while y2 = 1."""
    y0, y1 = np.zeros((2, 2)), np.array([[1.0, 0.0], [1.0, 1.0]])
    smooth = problems.harmonic_oscillator()
    assert discrete.increment(smooth, y0, y1, np.full((2, 2), 0.1)).reliable is True
    rough = replace(
        smooth, mean_gradient=None, degree=None, hessian=None, structure_derivative=None, check=False,
        gradient=lambda y: np.stack([np.sign(y[0] - 0.123) * (1 - y[1]), y[1]]),
    )  # fmt: skip
    for start, end in ((y0, y1), (y1, y0)):
        assert discrete.increment(rough, start, end, np.full((2, 2), 0.1)).reliable.tolist() == [False, True]


# Those of which no law of `properties` asks the like in every run.
BATCHED = [
    *(s for s in schemes.EXTENSIONS.values() if s.systems is not Systems.MECHANICAL),
    *(family(s) for family in (schemes.collocation, schemes.gauss) for s in (2, 3, 6)),
]


@pytest.mark.parametrize("scheme", BATCHED, ids=lambda s: s.name)
@pytest.mark.parametrize("name", ["rigid-body", "lotka-volterra"])
def test_steps_of_a_batch_are_the_steps_of_its_states(scheme: sepv.Scheme, name: str) -> None:
    problem = problems.by_name(name)
    rng = np.random.default_rng(1)
    y = np.asarray(problem.initial)[:, None] + 0.05 * rng.standard_normal((problem.dimension, 6))
    dW = 0.1 * rng.standard_normal((problem.noises, 6))
    together = scheme.step(problem, y, 0.01, dW)
    for k in range(6):
        assert np.array_equal(together[:, k], scheme.step(problem, y[:, k], 0.01, dW[:, k]))


@pytest.mark.parametrize("name", ["energy-preserving", "collocation-2", "projected-4"])
def test_a_domain_may_answer_in_numbers(name: str) -> None:
    problem, scheme = problems.lotka_volterra(), schemes.by_name(name)
    numbers = replace(problem, domain=lambda y: np.where(problem.domain(y), 1, 0), check=False)
    y = np.repeat(np.array(problem.initial)[:, None], 50, axis=1)
    dW = np.random.default_rng(0).standard_normal((1, 50))
    found, asked = (scheme.solve(p, y, 0.5, dW) for p in (numbers, problem))
    assert found.status.tolist() == asked.status.tolist()
    assert len(set(asked.status.tolist())) > 1


STAGES = range(1, 7)


@pytest.mark.parametrize(
    ("family", "members", "order", "k", "claimed", "not_claimed"),
    [
        # Order p in Δ is mean-square and weak order p/2 with k = 2p (Remark 2.1).
        (schemes.explicit, (4, 8), 0.5, 2.0, "noise-sum expansion truncation", "energy casimir symmetry"),
        (schemes.projected, (4, 8), 0.5, 2.0, "energy casimir noise-sum truncation", "equivariance symmetry"),
        (schemes.gauss, STAGES, 1, 4, "casimir midpoint symmetry truncation", "energy"),
        (schemes.collocation, STAGES, 1, 4, "energy casimir midpoint symmetry truncation", ""),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_member_of_a_family_says_what_it_is(family, members, order, k, claimed, not_claimed):
    for member in members:
        scheme = family(member)
        assert scheme.name == f"{family.__name__}-{member}"
        assert scheme.mean_square_order == scheme.weak_order == order * member
        # One stage keeps the truncation of the paper.
        assert (scheme.truncation, scheme.batched) == (2 if member == 1 else k * member, True)
        assert set(claimed.split()) <= scheme.claims
        assert not set(not_claimed.split()) & scheme.claims


# Those of the paper are measured by the files of `properties`.
KEPT = [
    ("gauss-2", "poisson-map:constant", ""), ("gauss-3", "poisson-map:constant", ""),
    ("splitting", "symmetry,invariant:casimir,poisson-map,positivity", "energy"),
    ("gonzalez", "energy,casimir", "invariant:casimir"), ("modified-weak-2", "energy,casimir", ""),
    *((f"projected-{p}", "identity,energy,casimir,noise-sum", "symmetry,midpoint") for p in (4, 8)),
    ("stochastic-midpoint", "poisson-map:constant", ""), ("area-midpoint", "poisson-map:constant", ""),
    ("stochastic-splitting", "poisson-map,positivity", ""), ("isospectral-midpoint", "casimir,poisson-map", ""),
    ("darboux-lie", "invariant:casimir,poisson-map,positivity", ""),
    ("leapfrog", "poisson-map:constant,poisson-map", "energy"),
    ("explicit-8", "equivariance", ""),
]  # fmt: skip


@pytest.mark.parametrize(("name", "kept", "lost"), KEPT)
def test_schemes_keep_what_they_claim_and_what_theory_denies_is_lost(name: str, kept: str, lost: str) -> None:
    claimed, denied = set(kept.split(",")), set(filter(None, lost.split(",")))
    assert claimed <= schemes.by_name(name).claims
    found = verdicts(name, claimed | denied, examples=1, shrink_checks=0)
    assert found == dict.fromkeys(claimed, "holds") | dict.fromkeys(denied, "violated")


def test_no_noise_is_the_deterministic_method() -> None:
    problem = problems.rigid_body(noise=())
    y = np.array([0.8, 0.6, 0.0])
    for scheme in schemes.PAPER.values():
        quiet = scheme.step(problem, y, 0.1, np.zeros(0))
        assert np.array_equal(quiet, scheme.step(problems.rigid_body(noise=(0.0,)), y, 0.1, np.array([0.7])))


def stay(problem, y, h, dW):
    return y


def test_claims_are_names_however_they_are_written() -> None:
    written = "noise_sum", ["noise-sum"], ("noise-sum ", "noise_sum"), {"noise-sum"}, iter(["noise-sum"])
    for claims in written:
        assert Scheme("mine", stay, claims=claims).claims == frozenset({"noise-sum"})
    assert Scheme("mine", stay).claims == frozenset()


def test_an_order_is_a_claim_beside_the_others() -> None:
    """With an order go its local conditions, (3.8) and (3.9), and the right limit."""
    strong = {"local-mean", "local-mean-square", "mean-square-order", "right-limit"}
    one = Scheme("mine", stay, claims=["energy"], mean_square_order=1.0)
    assert one.claims == {"energy", *strong}
    weak = {"local-weak", "weak-order"}
    assert Scheme("mine", stay, claims=["energy"], weak_order=1.0).claims == {"energy", *weak}
    assert Scheme("mine", stay, weak_order=2.0, mean_square_order=0.5).claims == strong | weak


def test_every_built_in_scheme_says_what_it_is() -> None:
    """Where it comes from, its orders, k ≥ 2p (Remark 2.1), and only laws that there are."""
    laws = {law.name for law in load_laws()}
    families = [family(s) for family in (schemes.collocation, schemes.gauss) for s in STAGES]
    families += [family(p) for family in (schemes.explicit, schemes.projected) for p in (4, 8)]
    several = map(schemes.by_name, schemes.HAMILTONIANS)
    for scheme in [*schemes.PAPER.values(), *schemes.EXTENSIONS.values(), *several, *families]:
        assert scheme.claims <= laws
        assert scheme.source
        assert scheme.mean_square_order is not None
        assert scheme.weak_order is not None
        assert scheme.truncation is None or scheme.truncation >= 2 * scheme.mean_square_order
        assert schemes.by_name(scheme.name) is schemes.by_name(scheme.name.replace("-", "_")) is scheme


LEAPFROG = schemes.by_name("leapfrog")


def test_it_is_kick_drift_kick_for_every_mass_and_either_order_of_y() -> None:
    cases = [case.build() for _, case in CLASSES[Systems.MECHANICAL].space.part().cases(3)[:12]]
    kepler = problems.kepler()
    for problem, y, h, dW in (*cases, (kepler, np.asarray(kepler.initial), 0.1, np.array([0.05]))):
        m, dt = mechanics(problem), problem.random_step(h, dW)
        q, p = m.split(y)
        p = p + dt / 2 * m.force(q)
        q = q + dt * m.velocity(p)
        expected = m.join(q, p + dt / 2 * m.force(q))
        found, size = LEAPFROG.step(problem, y, h, dW), np.abs(y).max()
        np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13 * size)


def test_gonzalez_steps_from_rest_and_by_nothing() -> None:
    pendulum = problems.pendulum()
    assert not schemes.gonzalez.step(pendulum, np.zeros(2), 0.25, np.array([0.5, 0.5])).any()
    y = np.array([0.2, 1.0])
    assert np.array_equal(schemes.gonzalez.step(pendulum, y, 0.25, np.array([-0.25, 0.0])), y)


def test_the_modified_scheme_solves_steps_of_every_stratum_of_the_cases() -> None:
    # Without the limiter 11 of these are refused: 3c²h|S₃| is then much larger than |B|.
    for _, drawn in Cases().space(Systems.SINGLE).cases(900034):
        assert np.all(np.isfinite(ask(schemes.modified_weak_two, *drawn.build())))


def test_a_difference_jacobian_from_zero_is_none_of_roundings() -> None:
    # e eᵀw turns with every direction: over a width of nothing its roundings once made a Jacobian
    # of 1e299.
    H = poly.polynomial(2, {(1, 0): 0.046875, (0, 1): -0.05078125})
    system = PolynomialSystem(2, H, ((0, 1, poly.constant(2, 1.0)),), (1.0,))
    drawn = Case(system, (0.0, 0.0), 2.0**-9, (0.0,), "bare functions")
    y1 = ask(schemes.gonzalez, *drawn.build())
    np.testing.assert_allclose(y1, 2.0**-9 * np.array([-0.05078125, -0.046875]), rtol=1e-15)
