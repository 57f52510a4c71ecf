"""Steps without a solution: the proof agrees with the equation, ends at the fold, and who returns a state is found."""

from dataclasses import replace
from random import Random

import numpy as np
import pytest
from sepv.properties._without_solution import legendre_sum, made, proof
from sepv.reference.faults.saboteurs import SABOTEURS

import sepv
from sepv.errors import StepFailure
from sepv.problem import Array, Problem, Systems
from sepv.schemes import Scheme, collocation, energy_preserving
from sepv.verification import Case, Effort, Verdict, verify

FEW = Effort(examples=2, seed=5)


def shortened(case: Case, share: float) -> Case:
    return replace(case, h=share * case.h, dW=tuple(share * w for w in case.dW))


@pytest.mark.parametrize("systems", [Systems.SINGLE, Systems.NAMBU])
def test_the_quadratic_equation_is_that_component_of_the_step(systems: Systems) -> None:
    """Against y1 − y0 − Δ B(ȳ)∇̄H from the problem's own functions, Gauss nodes for the average, at any y1."""
    nodes, weights = np.polynomial.legendre.leggauss(5)
    rng = np.random.default_rng(2)
    for n in range(40):
        case = made(Random(n), systems)
        why, (problem, y, h, dW) = proof(case), case.build()
        assert why is not None
        size = np.max(np.abs(y)) + 1.0
        y1 = y + size * rng.standard_normal(len(y))
        along = y[:, None] + 0.5 * (1 + nodes) * (y1 - y)[:, None]
        mean = problem.gradient(along) @ weights / 2
        flow = problem.random_step(h, dW) * (problem.structure(0.5 * (y + y1)) @ mean)
        terms = np.abs(y1 - y) + np.abs(flow)
        left = abs((y1 - y - flow)[why.place])
        residual = float(why.residual(y[why.place], y1[why.place]))
        assert residual == pytest.approx(left, abs=1e-12 * terms.max())
        assert 0 < float(why.least) <= left * (1 + 1e-9)


def test_where_the_proof_ends_the_step_is_solved() -> None:
    """A case is at most nine times as long as to its fold: the first of these shares that is inside is solved."""
    for n in range(12):
        case = made(Random(n), Systems.SINGLE)
        shares = 2.0 ** -np.arange(0, 5, 1 / 16)
        share = next(s for s in shares if proof(shortened(case, s)) is None)
        inside = shortened(case, 0.98 * share)
        assert np.all(np.isfinite(energy_preserving.step(*inside.build())))


def test_the_legendre_sum_bounds_what_a_polynomial_gains() -> None:
    """|u(1) − u(0)|² ≤ K_s ∫u², with equality for Σ over odd n of (2n + 1) P_n."""
    rng = np.random.default_rng(3)
    for s in range(1, 8):
        extremal = [(2 * n + 1) * (n % 2) for n in range(s + 1)]
        for coefficients, ratio in ((rng.standard_normal(s + 1), None), (extremal, 1.0)):
            u = np.polynomial.Legendre(coefficients, domain=[0, 1])
            gain = (u(1.0) - u(0.0)) ** 2
            integral = (u * u).integ()(1.0) - (u * u).integ()(0.0)
            assert gain <= legendre_sum(s) * integral * (1 + 1e-12)
            if ratio:
                assert gain == pytest.approx(legendre_sum(s) * integral)


def test_systems_with_a_rest_point_are_not_claimed_to_have_no_solution() -> None:
    data = sepv.problems.harmonic_oscillator().data
    assert data is not None
    assert proof(Case(data, (1.0, 0.5), 100.0, (0.0,))) is None


@pytest.mark.parametrize("scheme", ["collocation-3", "both-invariants", "several-structures"])
def test_what_refuses_holds(scheme: str) -> None:
    (found,) = verify(scheme, laws="refusal", effort=FEW).findings
    assert (found.verdict, found.claimed) == (Verdict.HOLDS, True), found.message


@pytest.mark.parametrize("name", [n for n in SABOTEURS if n.endswith("where-unsolved")])
def test_a_state_that_is_returned_is_a_violation(name: str) -> None:
    report = verify(SABOTEURS[name].scheme, laws="refusal", effort=FEW)
    (found,) = report.findings
    assert found.verdict is Verdict.VIOLATED
    assert "(2.1) has no solution" in found.message
    assert report.replay("refusal").verdict is Verdict.VIOLATED


def test_a_lane_that_is_not_solved_and_says_that_it_is_violates() -> None:
    solve = collocation(2).solve
    assert solve is not None

    def all_solved(problem: Problem, y: Array, h: float, dW: Array) -> object:
        solution = solve(problem, y, h, dW)
        return replace(solution, status=np.zeros_like(solution.status))

    wrong = replace(collocation(2), solve=all_solved)
    (found,) = verify(wrong, laws="refusal").findings
    assert found.verdict is Verdict.VIOLATED
    assert "of which the status says that it is solved" in found.message


def test_of_another_equation_the_report_says_what_comes() -> None:
    (found,) = verify("euler-heun", laws="refusal").findings
    assert (found.verdict, found.claimed) == (Verdict.NOT_APPLICABLE, False)
    assert "does not claim reference" in found.message
    assert "the explicit step (" in found.message


def test_whoever_claims_reference_claims_refusal() -> None:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        raise StepFailure("no step")

    assert "refusal" in Scheme("mine", step, claims=["reference"]).claims
    assert "refusal" not in Scheme("mine", step, claims=["energy"]).claims
