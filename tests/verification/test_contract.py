"""What the contract sees beyond one question asked twice and what it leaves alone;
steps that have no solution.
"""

import platform
from contextlib import nullcontext
from dataclasses import replace
from random import Random
from typing import Any

import numpy as np
import pytest
from doors import finding, says
from drawn import refusing
from sepv.properties import _without_memory
from sepv.properties._without_solution import legendre_sum, made, proof

import sepv
from benchmarks.right_schemes import RIGHT_SCHEMES
from sepv import SchemeFault, StepFailure, schemes
from sepv._arithmetic import is_default
from sepv.faults.saboteurs import SABOTEURS
from sepv.problem import Array, Problem, Systems
from sepv.schemes import Scheme, collocation, energy_preserving, midpoint
from sepv.verification import Case, Effort, Verdict, replay, verify

FEW: dict[str, Any] = {"examples": 1, "shrink_checks": 0}
X86 = pytest.mark.skipif(
    platform.machine() != "x86_64" or platform.libc_ver()[0] != "glibc", reason="the bits are those of x86"
)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("remembers-digits", "another answer for another state"),
        ("remembers-degrees-by-id", "whichever record holds the problem"),
        ("seeds-python", "a change of Python's global random numbers"),
        ("refuses-once", "a refusal and then"),
        pytest.param("rounds-towards-zero", "a change of the rounding mode", marks=X86),
        pytest.param("flushes-to-zero", "a change of subnormal numbers", marks=X86),
        ("reads-memory", "however they lie in memory"),
    ],
)
def test_a_step_that_is_not_pure_is_found(name: str, said: str) -> None:
    with np.printoptions():
        says(SABOTEURS[name].scheme, "contract", "violated", said, **FEW)


@pytest.mark.parametrize("name", ["rounds-towards-zero", "flushes-to-zero"])
def test_laws_after_a_step_that_changes_the_arithmetic_compute_as_before(name: str) -> None:
    found = verify(SABOTEURS[name].scheme, laws="identity,energy,noise-sum", effort=Effort(**FEW))
    assert {f.verdict for f in found.findings} == {Verdict.HOLDS}
    assert is_default()


PROCESSES = """
import random
from dataclasses import replace
from sepv.schemes import energy_preserving as right
DRAWN = random.random()
def scheme(spoiled):
    def step(problem, y, h, dW):
        return right.step(problem, y, h, dW) * (1 + 2.0 ** -40 * spoiled())
    return replace(right, step=step, solve=None, batched=False)
by_hash = scheme(lambda: hash("drift") % 1024)
by_draw = scheme(lambda: DRAWN)
by_set = scheme(lambda: "".join({"alpha", "beta", "gamma", "delta", "epsilon", "zeta"}) < "gamma")
by_length = scheme(lambda: len("drift"))
"""


@pytest.mark.parametrize(
    ("name", "expected"), [("by_hash", "violated"), ("by_draw", "violated"), ("by_length", "holds")]
)
def test_a_step_has_the_same_bits_in_a_second_process(name, expected, tmp_path, monkeypatch) -> None:
    (tmp_path / "processes.py").write_text(PROCESSES)
    monkeypatch.syspath_prepend(str(tmp_path))
    said = "in a second process" if expected == "violated" else ""
    found = finding(f"processes:{name}", "contract", **FEW)
    assert found.verdict_text == expected
    assert said in found.message
    assert "did not answer" not in found.message


def test_a_scheme_gets_the_derivatives_that_it_needs_or_the_case_is_left_out() -> None:
    taylor = RIGHT_SCHEMES["taylor-by-derivatives"]
    for law in ("contract", "noise-sum"):
        says(taylor, law, "holds", **FEW)
        says(replace(taylor, needs=()), law, "error", "The scheme raised", **FEW)
    bare = Problem(2, lambda y: np.array([[0.0, -1.0], [1.0, 0.0]]), lambda y: y @ y, lambda y: 2 * y, (1.0,),
                   initial=(1.0, 0.0))  # fmt: skip
    lacking = replace(bare, hessian=None, check=False)
    assert lacking.hessian is None
    says(taylor, "noise-sum", "not applicable", "no hessian", problems=[lacking], **FEW)
    with pytest.raises(sepv.UsageError, match="needs"):
        replace(taylor, needs=("curvature",))


def test_a_change_of_an_argument_is_an_error_of_every_law() -> None:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y1 = midpoint.step(problem, y, h, dW)
        y *= 1.0 + (len(y) == 3)  # in three dimensions alone
        return y1

    says(step, "identity", "error", "y unchanged by the step", **FEW)


def test_a_step_for_contiguous_arrays_alone_is_left_alone() -> None:
    odd = lambda problem, y, h, dW: not (y.flags.c_contiguous and y.flags.writeable)  # noqa: E731
    step = refusing(ValueError("buffer source array is read-only, or not contiguous"), odd, midpoint.step)
    says(Scheme("typed", step), "contract", "holds", **FEW)


def test_a_step_that_returns_nan_where_nothing_solves_it_is_none_of_the_contract() -> None:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        try:
            return midpoint.step(problem, y, h, dW)
        except ArithmeticError:
            return np.full_like(y, np.nan)

    says(step, "contract", "holds", **FEW)


def test_a_batch_comes_in_the_precision_of_the_scheme() -> None:
    says(RIGHT_SCHEMES["leapfrog-in-single-precision"], "contract", "holds", **FEW)


MODULE = """
import sepv
from sepv.schemes import energy_preserving

calls = 0

def moved(problem, y, h, dW):
    global calls
    calls += 1
    y1 = energy_preserving.step(problem, y, h, dW)
    return y1 * (1 + 1e-6) if calls > {most} else y1

scheme = sepv.Scheme("counting", moved, claims=["energy"])
"""


@pytest.mark.parametrize(("most", "said"), [(40, "depends on earlier calls"), (0, "violated")])
def test_a_counterexample_is_replayed_in_a_fresh_process(most, said, tmp_path, monkeypatch):
    (tmp_path / f"counts_from_{most}.py").write_text(MODULE.format(most=most))
    monkeypatch.syspath_prepend(str(tmp_path))
    report = verify(f"counts_from_{most}:scheme", laws="energy", effort=Effort(**FEW))
    (found,) = report.findings
    assert (found.verdict, found.verdict_text) == (Verdict.VIOLATED, said)
    assert f"energy {said}" in str(report)
    assert report.exit_code == 1


def counting(period: int, spoil) -> Scheme:
    """(2.1) with each so-manieth answer spoilt."""
    calls = [0]

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        calls[0] += 1
        y1 = schemes.energy_preserving.step(problem, y, h, dW)
        return spoil(y, y1) if calls[0] % period == 0 else y1

    return Scheme("seldom wrong", step)


def refuse(y: Array, _: Array) -> Array:
    raise StepFailure(problem="any", y=y, delta=1.0, residual=1.0, status="tired", iterations=1)


@pytest.mark.parametrize(
    ("period", "spoil"),
    [
        *((n, lambda _, y1: np.nextafter(y1, 0.0)) for n in (200, 1024)),
        (1000, lambda y, _: y.copy()),
        (1000, refuse),
    ],
    ids=["an ulp", "an ulp, seldom", "left out", "refused"],
)
def test_what_is_wrong_in_one_of_a_thousand_calls_is_found(period: int, spoil) -> None:
    words = ["asked 1024 times in a row"] * (period >= 1000)
    says(counting(period, spoil), "contract", "violated", *words, **FEW)


def test_the_witness_of_a_seldom_fault_is_found_again() -> None:
    saboteur = SABOTEURS["thousandth-call"]
    witness = finding(saboteur.scheme, "contract", **FEW).witness
    assert witness is not None
    assert witness["times"] == 1024
    assert replay(saboteur.scheme, "contract", witness).verdict is Verdict.VIOLATED
    assert replay(schemes.energy_preserving, "contract", witness).verdict is Verdict.HOLDS


def test_a_scheme_too_slow_to_be_asked_so_often_is_asked_as_often_as_time_allows(
    monkeypatch,
):
    monkeypatch.setattr(_without_memory, "REPEAT_MAX_SECONDS", 0.0)
    asked = [0]

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        asked[0] += 1
        return schemes.energy_preserving.step(problem, y, h, dW)

    says(Scheme("slow", step), "contract", "holds", **FEW)
    assert asked[0] < 1500  # 1,060 without the repeats, a thousand more with them


@pytest.mark.parametrize("noises", [2, 3, 4])
def test_increments_at_each_others_place_are_seen_whatever_their_number(noises: int) -> None:
    """Reversing two noises, or turning four by two, leaves an exchange alone that the other
    questions change.
    """

    def turned(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        m = problem.noises
        order = np.roll(np.arange(m), m // 2) if m == noises else np.arange(m)
        moved = replace(problem, noise=problem.c[order], check=False)
        return schemes.several_structures.step(moved, y, h, dW[order])

    scheme = replace(schemes.several_structures, name="turned", step=turned, solve=None)
    says(scheme, "noise-sum", "violated", **FEW)


def test_several_structures_summed_in_any_order_keep_noise_sum() -> None:
    def backward(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        order = np.arange(problem.noises)[::-1]
        structures = tuple(problem.noise_structures[j] for j in order)
        moved = replace(problem, noise=problem.c[order], noise_structures=structures, check=False)
        return schemes.several_structures.step(moved, y, h, dW[order])

    scheme = replace(schemes.several_structures, name="backward", step=backward, solve=None)
    says(scheme, "noise-sum", "holds", **FEW)


@pytest.mark.parametrize(("size", "accused"), [(1e-20, False), (1e-3, True)])
def test_a_state_that_is_lost_in_the_rounding_of_the_answer_is_no_second_question(size, accused):
    y, answer = np.array([size, 0.0]), np.array([0.5, 0.25])
    with pytest.raises(SchemeFault) if accused else nullcontext() as caught:
        _without_memory.tells_apart(y, 0.75 * y, answer, answer.copy(), _without_memory.LEAST_DISTANCE)
    assert (caught is not None) is accused


SEEDED = Effort(examples=2, seed=5)


def shortened(case: Case, share: float) -> Case:
    return replace(case, h=share * case.h, dW=tuple(share * w for w in case.dW))


@pytest.mark.parametrize("systems", [Systems.SINGLE, Systems.NAMBU])
def test_the_quadratic_equation_is_that_component_of_the_step(systems: Systems) -> None:
    """Against y1 − y0 − Δ B(ȳ)∇̄H from the problem's own functions, Gauss nodes for the average,
    at any y1.
    """
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
    """A case is at most nine times as long as to its fold:
    the first of these shares that is inside is solved.
    """
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
    assert says(scheme, "refusal", "holds", examples=2, seed=5).claimed


@pytest.mark.parametrize("name", [n for n in SABOTEURS if n.endswith("where-unsolved")])
def test_a_state_that_is_returned_is_a_violation(name: str) -> None:
    report = verify(SABOTEURS[name].scheme, laws="refusal", effort=SEEDED)
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
    says(wrong, "refusal", "violated", "of which the status says that it is solved")


def test_of_another_equation_the_report_says_what_comes() -> None:
    words = ("does not claim reference", "the explicit step (")
    assert not says("euler-heun", "refusal", "not applicable", *words).claimed


def test_whoever_claims_reference_claims_refusal() -> None:
    step = refusing(StepFailure("no step"))
    assert "refusal" in Scheme("mine", step, claims=["reference"]).claims
    assert "refusal" not in Scheme("mine", step, claims=["energy"]).claims
