"""The page of one scheme: verdicts on the scale of their bounds, and counterexamples drawn by the scheme itself."""

import html
import re
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import strategies as st

import sepv
from sepv.commands._cli import main
from sepv.exact import exact_flow
from sepv.files import fault, schema
from sepv.page._verdicts import _scale
from sepv.verification import Effort
from sepv.verification._course import FINER, STEPS, course, with_courses

FEW = Effort(examples=2, paths=64)


@pytest.fixture(scope="module")
def report() -> sepv.Report:
    return sepv.verify("midpoint", laws="energy,casimir,truncation", effort=FEW)


def test_the_command_writes_the_page_that_its_json_makes(reader: Any) -> None:
    reader.sepv("sepv verify midpoint --law energy,identity --examples 2 --json r.json --html r.html")
    reader.sepv("sepv report r.json --out again.html")
    pages = [(reader.folder / name).read_text() for name in ("r.html", "again.html")]
    assert pages[0] == pages[1]
    words = html.unescape(pages[0])
    assert "<h1>midpoint: which structural properties hold?</h1>" in words
    assert "H(y1) − H(y0) = " in words
    assert "sepv verify midpoint --law energy --replay" in words
    assert "sepv verify midpoint --law energy,identity --examples 2 --json r.json --html r.html" in words
    assert re.search(r"sepv [\d.]+, python .*, numpy .*; seed 0, 2 examples, 8192 paths at most", words)


def test_a_course_begins_with_the_counterexample_beside_the_exact_solution(report: sepv.Report) -> None:
    (law,) = (f for f in with_courses(report)["laws"] if "course" in f)
    assert law["law"] == "energy"
    assert fault(with_courses(report), schema("report")) == ""
    found, case = law["course"], sepv.verification.Case
    assert [len(c) for c in found["states"]] == [STEPS + 1] * 2
    assert [len(c) for c in found["exact"]] == [FINER * STEPS + 1] * 2
    witness, message = report.finding("energy").witness, report.finding("energy").message
    assert witness is not None
    from sepv.verification._cases.case import from_json

    case = from_json(witness)
    problem, y, h, dW = case.build()
    y1 = sepv.schemes.midpoint.step(problem, y, h, dW)
    one = [found["components"][k] - 1 for k in (0, 1)]
    assert [c[1] for c in found["states"]] == pytest.approx(y1[one], rel=1e-4)
    moved = re.search(r"step 1: H\(y1\) − H\(y0\) = (\S+),", message)
    assert moved is not None
    assert found["drift"][1] == pytest.approx(float(moved[1]), rel=1e-3)
    theta = float(problem.random_step(h, dW)) * STEPS
    end = exact_flow(problem, [theta], y).y[one, 0]
    assert [c[-1] for c in found["exact"]] == pytest.approx(end, rel=1e-4)


def _on_energy(step: Any, report: sepv.Report) -> dict[str, Any]:
    return course(sepv.Scheme("own", step), report.finding("energy"))


def test_a_course_ends_where_the_scheme_does(report: sepv.Report) -> None:
    def raises_later(problem: Any, y: Any, h: float, dW: Any) -> Any:
        if np.linalg.norm(y) > 3:
            raise RuntimeError("too far")
        return 1.5 * y

    found = _on_energy(raises_later, report)
    assert "RuntimeError: too far" in found["ended"]
    assert 2 < len(found["drift"]) <= STEPS
    assert _on_energy(lambda problem, y, h, dW: 7 * y, report)["ended"] == "it runs away"
    assert _on_energy(lambda problem, y, h, dW: y, report) == {}  # nothing moves: no picture
    law = with_courses(replace(report, scheme=sepv.Scheme("own", lambda problem, y, h, dW: y)))["laws"][0]
    assert "course" not in law


def test_a_course_that_cannot_be_drawn_is_left_out(report, monkeypatch):
    def pendulum(hamiltonian: Any = None) -> sepv.Problem:
        known = sepv.problems.pendulum()
        return replace(
            known, data=None, name="own", hamiltonian=hamiltonian or known.hamiltonian, check=False
        )

    drawn = sepv.verify("midpoint", laws="energy", problems=st.builds(pendulum), effort=FEW)
    assert drawn.finding("energy").verdict is sepv.Verdict.VIOLATED
    assert "course" not in with_courses(drawn)["laws"][0]  # no words name its problem
    assert "H(y1) − H(y0)" in drawn.html()
    monkeypatch.setattr("sepv.verification._course.invariants", lambda *_: 1 / 0)
    assert all("course" not in law for law in with_courses(report)["laws"])


def test_courses_take_no_longer_than_their_time(report: sepv.Report, monkeypatch: pytest.MonkeyPatch) -> None:
    def sleeps(problem: Any, y: Any, h: float, dW: Any) -> Any:
        time.sleep(0.1)
        return 1.01 * y

    slow = replace(report, scheme=sepv.Scheme("slow", sleeps))
    monkeypatch.setattr("sepv.verification._course.SECONDS", 0.25)
    (found,) = (law["course"] for law in with_courses(slow)["laws"] if "course" in law)
    assert found["ended"] == "the time for all courses, 0.25 s, was over"
    assert 2 <= len(found["drift"]) < STEPS
    assert not any("course" in law for law in with_courses(replace(slow, interrupted=True))["laws"])


def test_ctrl_c_while_courses_are_made_leaves_the_files(reader: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("sepv.verification._course.with_courses", interrupted)
    words = "verify midpoint --law energy --examples 2 -q --json r.json --html r.html"
    done = CliRunner().invoke(main, words.split())
    assert done.exit_code == 130
    assert "energy" in (reader.folder / "r.html").read_text()
    assert (reader.folder / "r.json").exists()


def test_a_law_of_casimirs_draws_the_casimir_that_moves_most() -> None:
    report = sepv.verify("euler-maruyama", laws="casimir", problems="rigid-body", effort=FEW)
    found = with_courses(report)["laws"][0]["course"]
    assert found["kept"] == "C"
    assert abs(found["drift"][1]) > 1e-6
    assert "C(y) − C(y₀)" in report.html()


def law(
    defect: float | None, bound: float | None, at_least: bool = False, verdict: str = "violated"
) -> dict[str, Any]:
    return {"defect": defect, "bound": bound, "at_least": at_least, "verdict": verdict}


def test_the_scale_has_the_bound_at_one_place_and_the_wrong_side_at_the_right() -> None:
    laws = [
        law(48.0, 48.0),
        law(1.0, 10.0),
        law(2e9, 2.0),
        law(0.5, 1.0, True),
        law(2.0, 1.0, True),
        law(0.0, 0.0),
    ]
    place, ticks = _scale(laws)
    bound = float({words: x for x, words in ticks}["bound"])
    places = [float(place(v)) for v in laws]
    assert places[0] == bound
    assert places[1] < bound < places[2] <= float(ticks[-1][0])
    assert places[4] < bound < places[3]
    assert places[5] == 5
    assert float(place(law(None, 1.0))) == 95  # not finite
    assert float(place(law(1.0, 0.0))) == 95
    assert place(law(None, None, verdict="not_applicable")) is None
    assert [words for _, words in ticks] == ["10⁻³", "bound", "10³", "10⁶", "10⁹"]
    assert _scale([law(None, None, verdict="error")])[1] == []


def raises(problem: Any, y: Any, h: float, dW: Any) -> Any:
    raise RuntimeError("no luck")


def test_an_error_of_all_laws_is_one_entry() -> None:
    page = sepv.verify(raises, laws="contract,energy,casimir", effort=FEW).html()
    assert page.count("The scheme raised RuntimeError: no luck") == 1
    assert "the same error in 2 other laws" in page


def test_a_share_and_memory_are_said_as_the_table_says_them(report: sepv.Report) -> None:
    held, violated = report.finding("casimir"), report.finding("energy")
    partly = replace(report, findings=(replace(held, share=0.719), replace(violated, afresh="holds")))
    page = partly.html()
    for words in ("holds on 71 %", "depends on earlier calls"):
        assert words in page
        assert words in str(partly)
