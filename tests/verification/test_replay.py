"""Each replay that is printed replays: as a command where words name the scheme and its problem, else in Python."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import pytest
from doors import command
from hypothesis import strategies as st
from reader import Reader

import sepv
from sepv.page._views import again
from sepv.verification import Effort, Verdict
from sepv.verification._cases.users_problems import items, problems_of
from sepv.verification._junit_and_badge import junit_xml

FEW = Effort(examples=2, paths=256, shrink_checks=10)
COMMAND = re.compile(r"sepv verify .*--law energy .*")


def euler(problem: Any, y: Any, h: float, dW: Any) -> Any:
    return y + problem.random_step(h, dW) * problem.structure(y) @ problem.gradient(y)


def measured(scheme: Any, problems: Any = None) -> sepv.Report:
    return sepv.verify(scheme, laws="energy", problems=problems, effort=FEW)


def own_problem(name: str = "own") -> sepv.Problem:
    """A pendulum that is not known by its data."""
    return replace(sepv.problems.pendulum(), name=name, data=None)


def renamed(step: Any) -> Any:
    """The same function under a name that no import finds."""
    return lambda problem, y, h, dW: step(problem, y, h, dW)  # noqa: PLW0108  (another name is the point)


@pytest.mark.parametrize(
    ("scheme", "problems"),
    [(renamed(euler), None), (euler, own_problem()), ("midpoint", [own_problem(), own_problem("another")])],
    ids=["a function", "a problem", "two problems"],
)
def test_what_was_handed_over_as_an_object_is_replayed_by_its_report(scheme: Any, problems: Any) -> None:
    report = measured(scheme, problems)
    assert 'report.replay("energy")' in str(report)
    assert "sepv verify" not in str(report)
    again = report.replay("energy")
    assert again.verdict is Verdict.VIOLATED
    assert again.defect == report.finding("energy").defect


def test_the_problem_of_a_strategy_has_no_name_and_a_token_says_so() -> None:
    report = measured("midpoint", st.builds(own_problem))
    with pytest.raises(sepv.UsageError, match="handed over as an object"):
        report.replay("energy")


def test_a_named_scheme_and_problem_are_replayed_by_the_command_in_every_output(reader: Reader) -> None:
    report = measured("midpoint", "pendulum")
    for text in (str(report), report.html(), junit_xml(report)):
        (command,) = COMMAND.findall(unescape(text).replace("</", "\n"))
        assert "energy violated" in reader.sepv(f"{command}  # red")
        assert "H(y1) − H(y0) = " in text


def test_a_pin_keeps_what_the_scheme_is_for(reader: Reader) -> None:
    reader.sepv("sepv verify midpoint -p pendulum --law energy,casimir --examples 2 --pin pin.toml")
    assert 'problems = ["pendulum"]' in (reader.folder / "pin.toml").read_text()
    asked = "sepv verify midpoint --law energy,casimir --examples 2"
    held = reader.sepv(f"{asked} --expected pin.toml --json r.json")
    assert "The pin is about" not in held
    assert '"target": "midpoint -p pendulum"' in (reader.folder / "r.json").read_text()
    other = reader.sepv("sepv verify midpoint -p rigid-body --law energy,casimir --expected pin.toml")
    assert "The pin is about pendulum, and this run about rigid-body." in other


def test_a_problem_of_a_family_that_is_named_too_is_measured_once() -> None:
    scheme = replace(sepv.schemes.midpoint, problems=items(["canonical-separable", "pendulum", "pendulum"]))
    assert [p.name for p in problems_of(scheme) or ()] == ["harmonic-oscillator", "pendulum"]


def test_the_page_has_the_commands_that_made_its_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = [
        "compare midpoint --problem rigid-body --steps 4,8 --paths 32 --repeats 1 --seed 3 --json 'my file.json'",
        "bench midpoint --case rigid-body --save bench.json",
        "verify midpoint --law energy --examples 3 --seed 5 --json laws.json",
    ]
    for line in (*lines, "report 'my file.json' bench.json laws.json"):
        command(line)
    page = unescape((tmp_path / "report.html").read_text(encoding="utf-8"))
    for line in lines:
        assert f"\nsepv {line}\n" in page.replace(">sepv verify", "\nsepv verify")


def test_a_file_made_by_python_m_has_the_same_command(tmp_path: Path) -> None:
    line = ["verify", "midpoint", "--law", "identity", "--examples", "2", "-q", "--json", "r.json"]
    subprocess.run([sys.executable, "-m", "sepv", *line], cwd=tmp_path, check=True, capture_output=True)
    made = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))
    assert again(made, "it") == f"sepv {' '.join(line)}"


def test_a_command_of_a_file_is_quoted_anew_and_is_of_sepv() -> None:
    made = {"made": {"command": "sepv report x.json; touch y"}}
    assert again(made, "it") == "sepv report 'x.json;' touch y"
    for line in ("touch y", "sepv 'open", "", None):
        assert again({"made": {"command": line}}, "it").startswith("# it was written in Python")
    assert again({}, "it").startswith("#")
