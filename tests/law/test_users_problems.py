"""What a user hands over: names, functions, records, families, strategies and files;
and words for all else.
"""

import dataclasses
import html
import json
import math
import re
from typing import Any

import doors
import numpy as np
import pytest
from doors import Reader
from drawn import J, drawn_systems
from hypothesis import given, settings
from hypothesis import strategies as st

import sepv
from sepv import problems
from sepv.law.cases import case
from sepv.law.cases.classes import NARROW_CLASSES
from sepv.law.cases.from_problem import measured_radius
from sepv.law.cases.of_law import Question
from sepv.law.cases.users_problems import items
from sepv.law.contraction import contraction_radius
from sepv.problem import Systems, vector_field
from sepv.record import Polynomial
from sepv.record import _polynomial as poly
from sepv.verification import Effort, Verdict, load_laws, replay

FEW = Effort(examples=2, paths=256, shrink_checks=30)
SEARCHED = "contract,identity,energy,casimir,noise-sum,symmetry,reduction,reference,midpoint"


def verlet(problem: Any, y: Any, h: float, dW: Any) -> Any:
    """Störmer-Verlet with the random step, for H = T(p) + V(q) and y = (p, q) alone."""
    n = problem.dimension // 2
    expected = np.zeros((2 * n, 2 * n))
    expected[:n, n:] = -np.eye(n)
    if problem.dimension % 2 or not np.array_equal(np.triu(problem.structure(y)), expected):
        raise sepv.Skipped("only H = T(p) + V(q) with y = (p, q)")
    delta = problem.random_step(h, dW)
    p = y[:n] - 0.5 * delta * problem.gradient(y)[n:]
    q = y[n:] + delta * problem.gradient(np.concatenate([p, y[n:]]))[:n]
    return np.concatenate([p - 0.5 * delta * problem.gradient(np.concatenate([p, q]))[n:], q])


def sphere_only(problem: Any, y: Any, h: float, dW: Any) -> Any:
    """(2.1) for a rigid body alone: quadratic H without mixed terms, B = hat(y)."""
    w = np.array([problem.gradient(np.eye(3)[k])[k] for k in range(3)])
    if problem.dimension != 3 or not np.allclose(problem.gradient(y), w * y):
        raise sepv.Skipped("only rigid bodies")
    return sepv.schemes.midpoint.step(problem, y, h, dW)


def own_pendulum() -> sepv.Problem:
    """Functions alone: nothing is known of it but B, H and ∇H."""
    return sepv.Problem(
        2, J, lambda y: 0.5 * y[0] ** 2 - np.cos(y[1]), lambda y: np.stack([y[0], np.sin(y[1])]),
        noise=(1.0, 0.5), initial=(0.2, 1.0), name="own-pendulum",
    )  # fmt: skip


def positive() -> sepv.Problem:
    """H = y1 + y2 − ln y1 − ln y2 with B12 = y1 y2, for y > 0 alone."""
    return sepv.Problem(
        2, lambda y: -y[0] * y[1] * J(y), lambda y: y[0] + y[1] - np.log(y[0]) - np.log(y[1]),
        lambda y: np.stack([1 - 1 / y[0], 1 - 1 / y[1]]),
        domain=lambda y: (y[0] > 0) & (y[1] > 0), initial=(0.75, 1.5), name="positive",
    )  # fmt: skip


@st.composite
def planar(draw: st.DrawFn) -> sepv.PolynomialSystem:
    """d = 2 and B = J."""
    H: Polynomial = poly.polynomial(2, {(2, 0): 0.5, (0, 2): 0.5, (0, 4): draw(st.sampled_from([0.25, 0.5]))})
    return sepv.PolynomialSystem(2, H, ((0, 1, poly.constant(2, -1.0)),))


def verdicts(scheme: Any, asked: Any, laws: str = SEARCHED) -> dict[str, str]:
    return doors.verdicts(scheme, laws, asked, examples=2, paths=256, shrink_checks=30)


def test_a_scheme_for_separable_systems_is_judged_on_those() -> None:
    everywhere = sepv.verify(verlet, laws="symmetry", effort=FEW).findings[0]
    found = verdicts(verlet, "canonical-separable", "contract,symmetry,energy,noise-sum")
    assert found == {"contract": "holds", "symmetry": "holds", "energy": "violated", "noise-sum": "holds"}
    named = sepv.Scheme("verlet", verlet, systems=Systems.CANONICAL_SEPARABLE)
    assert sepv.verify(named, laws="symmetry", effort=FEW).findings[0].verdict is Verdict.HOLDS
    # On systems that are not separable the scheme is another method, and is accused of what it
    # never said.
    assert everywhere.verdict is Verdict.VIOLATED


def test_a_scheme_for_the_rigid_body_alone_holds_what_it_holds_there() -> None:
    found = verdicts(sphere_only, ["rigid-bodies", "rigid-body"])
    assert set(found.values()) == {"holds"}


@pytest.mark.parametrize("problem", [own_pendulum, positive])
def test_a_problem_of_functions_alone_is_judged(problem: Any) -> None:
    held = ["identity", "energy", "noise-sum", "symmetry"]
    if problem is positive:
        held.append("contract")  # takes longer than the others, and is asked where there is a domain
    away = ["casimir", "reference", "midpoint", "reduction"]
    found = verdicts("energy-preserving", problem, ",".join([*held, *away]))
    assert found == dict.fromkeys(held, "holds") | dict.fromkeys(away, "not applicable")
    assert verdicts("midpoint", problem, "energy") == {"energy": "violated"}


def test_many_steps_are_judged_on_the_problems_own_initial_state() -> None:
    known = problems.pendulum()
    fast = dataclasses.replace(own_pendulum(), mean_gradient=known.mean_gradient, hessian=known.hessian)
    assert verdicts("energy-preserving", fast, "right-limit") == {"right-limit": "holds"}
    assert verdicts("midpoint", fast, "rounding") == {"rounding": "violated"}


def test_a_strategy_of_systems_and_one_of_problems_are_taken() -> None:
    for asked in (planar(), planar, "tests.law.test_users_problems:planar", st.just(own_pendulum())):
        assert set(verdicts("energy-preserving", asked, "energy,symmetry").values()) == {"holds"}
    found = doors.measured("energy-preserving", "rounding,right-limit", planar(), examples=2).findings
    assert {f.verdict for f in found} == {Verdict.NOT_APPLICABLE}
    assert all("no initial state" in f.message for f in found)


@st.composite
def anharmonic(draw: st.DrawFn) -> sepv.PolynomialSystem:
    """H = ½|y|² + k y₁³ with k = 0, …, 1000."""
    cubic = {(3, 0): float(draw(st.integers(0, 1000)))}
    H = poly.polynomial(2, {(2, 0): 0.5, (0, 2): 0.5} | cubic)
    return sepv.PolynomialSystem(2, H, ((0, 1, poly.constant(2, -1.0)),))


def test_hypothesis_shrinks_what_a_users_strategy_draws() -> None:
    """The midpoint rule keeps H for k = 0 alone: the simplest k that shows it is 1."""
    few = {"examples": 8, "shrink_checks": 200}
    finding = doors.says("midpoint", "energy", "violated", "", problems=anharmonic(), **few)
    problem = case.from_token(finding.replay.split()[-1]).problem
    assert dict(problem.hamiltonian.terms)[3, 0] == 1.0


def test_laws_that_lead_out_of_the_problems_say_so() -> None:
    report = sepv.verify("energy-preserving", laws="equivariance,expansion", problems="pendulum", effort=FEW)
    assert {f.verdict for f in report.findings} == {Verdict.NOT_APPLICABLE}
    assert "leads out of the problems" in report.finding("equivariance").message


def test_a_violation_on_a_users_problem_is_replayed_from_its_token(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(doors.ROOT)
    own = "tests.law.test_users_problems:own_pendulum"
    few = {"examples": 2, "shrink_checks": 30}
    finding = doors.says("midpoint", "energy", "violated", f"problem {own}", problems=own, **few)
    witness = case.witness_of(finding.replay.split()[-1])
    with pytest.raises(sepv.UsageError, match="to import a module is to run it"):
        replay("midpoint", "energy", witness)
    again = replay("midpoint", "energy", witness, own)
    assert (again.verdict, again.defect) == (finding.verdict, finding.defect)


def test_a_file_and_a_name_on_the_command_line(reader: Reader) -> None:
    H, B = [[[2, 0], 0.5], [[0, 4], 0.25]], [[0, 1, [[[0, 0], -1.0]]]]
    system = {"dimension": 2, "hamiltonian": H, "structure": B, "initial": [0.5, 1.0]}
    (reader.folder / "quartic.json").write_text(json.dumps(system))
    few = "--law energy --law rounding --examples 4 --paths 256"
    shown = reader.sepv(f"sepv verify midpoint -p quartic.json -p pendulum {few}")
    assert "energy" in shown
    assert "quartic, h = " in shown
    assert "pendulum, h = " in shown


def test_a_strategy_of_something_else_is_an_error_that_says_so() -> None:
    doors.says("midpoint", "energy", "error", "one that gave int", problems=st.integers(), examples=2)


def test_a_record_that_no_longer_is_its_data_is_not_taken_for_it() -> None:
    body = problems.rigid_body()
    changed = dataclasses.replace(
        body, hamiltonian=lambda y: 2 * body.hamiltonian(y), gradient=lambda y: 2 * body.gradient(y),
        mean_gradient=None, hessian=None,
    )  # fmt: skip
    found = verdicts("energy-preserving", changed, "energy,reference")
    assert found == {"energy": "holds", "reference": "not applicable"}


@settings(derandomize=True, database=None, max_examples=8, deadline=None)
@given(system=drawn_systems(Systems.LIE_POISSON))
def test_the_measured_radius_is_of_the_size_of_the_derived_one(system: sepv.PolynomialSystem) -> None:
    problem = problems.build(system)
    y = np.linspace(0.5, 1.0, problem.dimension)
    derived, measured = contraction_radius(problem, y), measured_radius(problem, y)
    # Majorants are bounds and maxima are not: the measured one is larger, but for its half and its
    # fewer balls.
    assert 0.25 * derived <= measured


@pytest.fixture(scope="module")
def cases_of_families() -> list[Question | str]:
    """Whether a law speaks of a family is found by a search of its own,
    which no other search may hold.
    """
    return [
        law.cases.of_problems(items(str(name)))
        for name in NARROW_CLASSES
        for law in load_laws(["energy", "identity", "noise-sum", "reduction"])
        # Several Hamiltonians and additive noise keep no H, and have no equation of (2.1); damping
        # has own laws, and so has friction.
        if name not in ("damped", "friction")
        and not (name.endswith(("-hamiltonians", "additive")) and law.name in ("energy", "reduction"))
    ]


@settings(derandomize=True, database=None, max_examples=8, deadline=None)
@given(drawn=st.data())
def test_every_law_draws_steps_of_every_family(cases_of_families, drawn):
    for asked in cases_of_families:
        assert isinstance(asked, Question), asked
        assert drawn.draw(asked.strategy).build()[0].dimension >= 2


def test_a_law_that_speaks_of_no_member_of_a_family_is_not_applicable() -> None:
    # H = T(p) + V(q) has no Casimirs: no crash, and no word about the scheme.
    scheme = sepv.Scheme("verlet", verlet, claims=["casimir"], systems=Systems.CANONICAL_SEPARABLE)
    report = sepv.verify(scheme, laws=["casimir", "invariant:casimir"], effort=FEW)
    assert {f.verdict for f in report.findings} == {Verdict.NOT_APPLICABLE}
    assert "name no quadratic or linear Casimir" in report.finding("casimir").message


def test_laws_stay_where_a_narrow_scheme_lives() -> None:
    """On the unit circle, of which no multiple is one:
    contract and reproducibility ask about nothing else.
    """
    seen: list[float] = []

    def step(problem: sepv.Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
        radius = np.hypot(y[0], y[1])
        seen.append(float(np.max(np.abs(radius - 1))))
        if seen[-1] > 1e-9:
            raise ValueError("not on the circle")
        angle = h + np.tensordot(problem.c, dW, 1)
        c, s = np.cos(angle), np.sin(angle)
        return np.stack([c * y[0] - s * y[1], s * y[0] + c * y[1]])

    data = sepv.problems.harmonic_oscillator().data
    cases = st.floats(0, 6).map(lambda a: case.Case(data, (math.cos(a), math.sin(a)), 0.125, (0.25,)))
    for batched in (False, True):
        scheme = sepv.Scheme("turn", step, batched=batched, problems=(cases,))
        found = doors.verdicts(scheme, "contract,reproducibility", examples=5)
        assert found == {"contract": "holds", "reproducibility": "holds" if batched else "not applicable"}
    assert max(seen) < 1e-9


CALLS: dict[str, Any] = {
    "integrate": lambda s, p: sepv.integrate(s, p, h=0.125, T=0.5).y[:, -1],
    "ensemble": lambda s, p: sepv.ensemble(s, p, h=0.125, T=0.5, paths=1).y[:, 0],
    "long_path": lambda s, p: sepv.long_path(s, p, h=0.125, T=0.5).y,
}


def heun(problem: Any, y: Any, h: float, dW: Any) -> Any:
    delta = problem.random_step(h, dW)
    f = vector_field(problem, y)
    return y + 0.5 * delta * (f + vector_field(problem, y + delta * f))


@pytest.mark.parametrize("call", CALLS)
def test_names_functions_and_records_are_the_same_scheme(call: str) -> None:
    run, own, body = CALLS[call], sepv.Scheme("mine", heun, truncation=2), sepv.problems.rigid_body
    assert np.array_equal(run("midpoint", "rigid-body"), run(sepv.schemes.midpoint, body()))
    assert np.array_equal(run(heun, "rigid_body"), run(own, body))
    assert np.array_equal(run("tests.law.test_users_problems:heun", "rigid-body"), run(own, "rigid-body"))


REFUSED: dict[str, tuple[Any, str]] = {
    "a problem for a scheme": (lambda call: call(sepv.problems.pendulum(), "pendulum"), "which is Problem"),
    "a scheme for a problem": (lambda call: call("midpoint", sepv.schemes.midpoint), "which is Scheme"),
    "a number for a scheme": (lambda call: call(3, "pendulum"), "which is int: 3"),
    "a misspelt scheme": (lambda call: call("midpiont", "pendulum"), "did you mean 'midpoint'"),
    "a misspelt problem": (lambda call: call("midpoint", "pendulem"), "did you mean 'pendulum'"),
    "two arguments": (lambda call: call(lambda p, y: y, "pendulum"), "takes (problem, y, h, dW)"),
    "no array": (lambda call: call(lambda p, y, h, dW: "y", "pendulum"), "a NumPy array of shape (2,)"),
    "wrong shape": (lambda call: call(lambda p, y, h, dW: y[:1], "pendulum"), "y_next of the shape of y"),
}


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("what", REFUSED)
def test_anything_else_is_refused_in_words(call: str, what: str) -> None:
    attempt, words = REFUSED[what]
    with pytest.raises(sepv.SepvError, match=re.escape(words)):
        attempt(CALLS[call])


class Client:
    """As a cluster's: it submits, and what it gives are no futures of Python's."""

    def submit(self, function: Any, task: Any) -> str:
        return "a future of its own"

    def map(self, function: Any, *tasks: Any) -> list[str]:
        return ["a future of its own" for _ in tasks]

    def shutdown(self) -> None:
        pass


@pytest.mark.parametrize("workers", [Client(), Client().map, "two", None, 1.5, True, object()])
def test_what_cannot_work_is_refused_with_what_can(workers: Any) -> None:
    with pytest.raises(sepv.UsageError, match="an executor"):
        sepv.ensemble("midpoint", "pendulum", h=0.125, T=0.5, paths=8, workers=workers)


@pytest.fixture(scope="module")
def report() -> sepv.Report:
    return sepv.verify("midpoint", laws="identity,truncation", effort=Effort(examples=5))


def test_laws_are_a_list_or_words_with_commas(report: sepv.Report) -> None:
    assert [f.law for f in report.findings] == ["identity", "truncation"]
    with pytest.raises(sepv.UsageError, match="did you mean 'energy'"):
        sepv.verify("midpoint", laws="enrgy")
    (found,) = sepv.verify(heun, laws=["identity"], claims="identity", effort=Effort(examples=5)).findings
    assert found.claimed


def test_a_finding_is_found_by_name_or_refused(report: sepv.Report) -> None:
    assert report.finding("identity").verdict is sepv.Verdict.HOLDS
    with pytest.raises(sepv.UsageError, match="did you mean 'identity'"):
        report.finding("idenity")


def test_a_report_prints_as_its_table_and_is_a_page_in_a_notebook(report: sepv.Report) -> None:
    text = str(report)
    assert text.startswith("midpoint · ")
    assert any(line.split()[:2] == ["law", "claimed"] for line in text.splitlines())
    assert any(line.lstrip().startswith("identity") and "holds" in line for line in text.splitlines())
    assert repr(report) == "<Report of midpoint: 2 hold>"
    shown = report._repr_html_()
    assert shown.startswith("<iframe sandbox=")
    assert html.escape(report.html()) in shown
    hostile = sepv.verify(sepv.Scheme("<script>", heun), laws="identity", effort=Effort(examples=2))
    assert "<script>" not in hostile._repr_html_()


def test_what_users_need_is_exported() -> None:
    names = {"Effort", "Ensemble", "Report", "Verdict", "PolynomialSystem", "Skipped", "Trajectory"}
    assert names <= {*dir(sepv)}
