"""A report in GitHub Actions: the summary, and annotations; nothing in them is markup or a command."""

import inspect
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from doors import command

import sepv
from sepv.verification import Effort, Verdict
from sepv.verification._github import error_lines, step_summary
from sepv.verification._profiles import requirements

FEW = Effort(examples=2, paths=64)
EVIL = "a|b\n::error::x% <img src=x> [l](http://x) `c`\r\x1b[31m"


def drifting(problem: Any, y: Any, h: float, dW: Any) -> Any:
    return y + 1e-3


def measured(step: Any = drifting, **more: Any) -> sepv.Report:
    return sepv.verify(step, laws="identity,truncation", effort=FEW, **more)


def hostile() -> sepv.Report:
    report = measured(claims="identity")
    findings = tuple(replace(f, message=EVIL, source=EVIL, unit=EVIL) for f in report.findings)
    scheme = replace(report.scheme, name=EVIL)
    return replace(report, scheme=scheme, findings=findings, target=EVIL, gaps=(EVIL,))


def test_each_claimed_violation_is_an_error_at_the_line_of_the_step(monkeypatch: pytest.MonkeyPatch) -> None:
    report = measured(claims="identity")
    monkeypatch.chdir(Path(__file__).parents[1])
    (found,) = error_lines(report)
    line = inspect.getsourcelines(drifting)[1]
    assert found.startswith(
        f"::error file=verification/test_github.py,line={line},title=sepv%3A identity::identity "
    )
    assert "%0A" in found
    monkeypatch.chdir("/")
    monkeypatch.setattr(inspect, "getsourcefile", lambda _: None)
    assert error_lines(report)[0].startswith("::error title=sepv%3A identity::")
    assert error_lines(measured()) == []  # what nobody claims is no error


def test_profiles_that_are_missing_and_gaps_are_annotated() -> None:
    report = replace(measured(), required=requirements("energy"), gaps=("The pin is about another.",))
    missing, gap = error_lines(report)
    assert missing.startswith("::error title=sepv::required and not found: energy")
    assert gap == "::warning title=sepv::The pin is about another."


def test_an_error_of_all_laws_is_one_annotation() -> None:
    def raises(problem: Any, y: Any, h: float, dW: Any) -> Any:
        raise RuntimeError("no luck")

    report = measured(raises)
    same = tuple(replace(f, verdict=Verdict.ERROR, message="a\nb\nc") for f in report.findings)
    report = replace(report, findings=same)
    assert len(error_lines(report)) == 1
    assert step_summary(report).count("<details>") == 1


def test_text_of_strangers_is_no_markup_and_no_command() -> None:
    lines = error_lines(hostile())
    assert len(lines) == 2
    assert all(re.fullmatch(r"::(error|warning) [^:\n\r]*::[^\n\r\x1b]*", line) for line in lines)
    text = step_summary(hostile())
    assert "<img" not in text
    assert "\x1b" not in text
    table = [line for line in text.splitlines() if line.startswith("|")]
    assert {line.count("|") for line in table} == {8}
    outside = re.sub(r"<pre>.*?</pre>", "", text, flags=re.DOTALL)
    assert "`" not in outside
    assert "[l]" not in outside


def test_the_command_adds_to_the_summary_and_keeps_its_exit_code(tmp_path: Path) -> None:
    line = "verify midpoint --law energy --claim energy --examples 2 -q"
    summary = tmp_path / "summary.md"
    summary.write_text("before\n")
    done = command(line, 1, GITHUB_STEP_SUMMARY=str(summary), GITHUB_ACTIONS="true")
    assert done.stderr.count("::error title=sepv%3A energy::energy (Prop. 3.1) violated") == 1
    assert "::error" not in done.stdout
    text = summary.read_text()
    assert text.startswith("before\n### ❌ sepv: midpoint\n")
    assert "| energy | yes | violated |" in text
    assert "replay: sepv verify midpoint --law energy --replay" in text
    done = command(line, 1, GITHUB_STEP_SUMMARY=str(tmp_path / "no" / "file"), GITHUB_ACTIONS="")
    assert "sepv: no summary for GitHub: " in done.stderr
    assert "::error" not in done.stderr
