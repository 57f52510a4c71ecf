"""What a user hands over: names, functions and records alike, and words for everything else."""

import html
import re
from typing import Any

import numpy as np
import pytest

import sepv
from sepv.problem import vector_field
from sepv.verification import Effort

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
    assert np.array_equal(run("tests.test_arguments:heun", "rigid-body"), run(own, "rigid-body"))


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
    assert {"Effort", "Ensemble", "Report", "Verdict", "PolynomialSystem", "Skipped", "Trajectory"} <= {
        *dir(sepv)
    }
