"""What a run leaves for others: JSON by its schema, JUnit XML, a badge, expected failures,
and marks on GitHub.
"""

import inspect
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import jsonschema
import numpy as np
import pytest
from doors import command, obeys
from drawn import refusing

import sepv
from sepv import Effort, Report, Scheme, UsageError, Verdict, schemes, verify
from sepv.files import (
    RESULTS,
    SCHEMAS,
    finite,
    json_text,
    read_json,
    require_schema,
    schema,
    write_atomically,
    write_json,
)
from sepv.verification._github import error_lines, step_summary
from sepv.verification._junit_and_badge import junit_xml
from sepv.verification._profiles import requirements

FEW = Effort(examples=2, paths=256, shrink_checks=20)


@pytest.fixture(scope="module")
def made() -> dict[str, Report]:
    one = Scheme("one", schemes.midpoint.step, truncation=None)
    evil = Scheme("<b>\u202e&\x01", refusing(RuntimeError("</script>\x00\x1b broken 💥")))
    return {
        "good": verify("energy-preserving", laws="energy,truncation", effort=FEW),
        "unclaimed": verify("midpoint", laws="energy,casimir", effort=FEW),
        "claimed": verify("midpoint", laws="energy,casimir", claims=["energy"], effort=FEW),
        "statistical": verify("euler-heun", laws="right-limit", effort=FEW),
        "broken": verify(evil, laws="contract,energy,rounding", effort=FEW),
        "not applicable": verify(one, laws="truncation,reproducibility,identity", effort=FEW),
    }


def test_json_is_as_the_schema_says_and_counts_add_up(made: dict[str, Report]) -> None:
    for report in made.values():
        data = json.loads(json_text(report.to_json()))
        obeys(data, "report")
        assert sum(data["counts"].values()) == len(data["laws"]) == data["suite"]["laws"]


def test_the_schema_refuses_what_is_no_report(made: dict[str, Report]) -> None:
    data = json.loads(json_text(made["good"].to_json()))
    passed, few = data["laws"][0] | {"verdict": "passed"}, data["counts"] | {"holds": -1}
    obeys(data, "report", {"laws": [passed]}, {"counts": few}, {"extra": 1})
    with pytest.raises(jsonschema.ValidationError):
        obeys({key: value for key, value in data.items() if key != "counts"}, "report")


WORDS = {"expected": "a result", "remedy": "write it anew"}


def test_every_schema_is_one_and_every_result_takes_what_made_it() -> None:
    for name in SCHEMAS:
        described = schema(name)
        jsonschema.Draft202012Validator.check_schema(described)
        assert ("required" in described.get("properties", {}).get("made", {})) == (name in RESULTS)
        assert "made" not in described.get("required", ())  # older files have none


def test_a_result_says_what_made_it_and_older_files_are_read(made: dict[str, Report], tmp_path: Path) -> None:
    file = tmp_path / "r.json"
    write_json(str(file), "report", made["good"].to_json(), command="sepv verify good --json r.json")
    data = read_json(file, **WORDS)
    require_schema(data, "report", file, **WORDS)
    assert next(iter(data)) == "made"
    assert data["made"]["command"] == "sepv verify good --json r.json"
    assert (data["made"]["schema"], data["made"]["version"]) == ("report", RESULTS["report"])
    older = {key: value for key, value in data.items() if key != "made"}
    require_schema(older, "report", file, **WORDS)
    for spoil, words in (
        ({"version": 99}, "version 99, by sepv .*Remedy: install that version"),
        ({"schema": "hard"}, "'report' was expected"),
        ({"more": 1}, "'more' was unexpected"),
    ):
        other = data | {"made": data["made"] | spoil}
        with pytest.raises(UsageError, match=f"(?s){words}"):
            require_schema(other, "report", file, **WORDS)
    with pytest.raises(UsageError, match="is not of type 'object'"):
        require_schema([], "report", file, **WORDS)


def test_what_is_not_finite_is_null_or_refused() -> None:
    mixed = {"a": (np.float64("nan"), np.int64(3), 1.5), "b": [float("inf")]}
    assert finite(mixed) == {"a": [None, 3, 1.5], "b": [None]}
    with pytest.raises(ValueError, match="not JSON compliant"):
        json_text(float("nan"))


def test_commands_write_results_that_obey_their_schemas_and_name_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = {
        "path": "run midpoint --steps 20 --engine numpy -q --json path.json",
        "bench": "bench midpoint --case rigid-body -q --save bench.json",
        "teeth": "teeth b-at-y0 --law expansion --seeds 1 -q --json teeth.json",
        "report": "verify midpoint --law identity --examples 2 -q --json report.json",
    }
    for name, line in words.items():
        assert command(line, None).exit_code in (0, 1)
        data = read_json(f"{name}.json", **WORDS)
        require_schema(data, name, f"{name}.json", **WORDS)
        assert data["made"]["command"] == f"sepv {line}"


def test_junit_counts_what_is_in_it(made: dict[str, Report]) -> None:
    for name, failures, errors, skipped in (
        ("good", 0, 0, 0),
        ("unclaimed", 0, 0, 1),
        ("claimed", 1, 0, 0),
        ("broken", 0, 3, 0),
        ("not applicable", 0, 0, 2),
    ):
        suite = ElementTree.fromstring(junit_xml(made[name]))[0]
        assert suite.get("tests") == str(len(suite))
        found = [sum(t.find(kind) is not None for t in suite) for kind in ("failure", "error", "skipped")]
        assert found == [failures, errors, skipped]
        assert found == [int(suite.get(k) or -1) for k in ("failures", "errors", "skipped")]


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    write_atomically(str(path), "old")
    with pytest.raises(TypeError):
        write_atomically(str(path), ["no text"])
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    write_atomically(str(path), "new \ud800")  # a lone surrogate, as names of others may have
    assert path.read_text() == "new ?"


def test_a_red_run_shows_broken_claims_first_and_junit_says_by_how_much() -> None:
    """Laws in the order of the suite: identity and casimir are violated,
    and only casimir is claimed.
    """
    report = sepv.verify(drifting, laws="identity,casimir", claims="casimir", effort=FEW)
    below_the_table = str(report).rpartition("─\n")[2]
    assert below_the_table.index("casimir violated") < below_the_table.index("identity violated")
    failure = ElementTree.fromstring(junit_xml(report)).find(".//failure")
    assert failure is not None
    found = report.finding("casimir")
    size = f"{found.defect:.3g} against {found.bound:.3g} ulp of C"
    assert failure.get("message") == f"casimir (Prop. 3.2) violated: {size}"


def test_expected_failures_are_strict_both_ways(tmp_path: Path) -> None:
    file, few = tmp_path / "expected.toml", "--law energy,casimir --examples 2 --shrink-checks 20"
    # What nobody claims is not listed: a scheme that gains a law must stay green.
    command(f"verify midpoint {few} --write-expected {file}")
    assert "[[expected]]" not in file.read_text()
    command(f"verify midpoint {few} --claim energy --write-expected {file}", 1)
    shown = command(f"verify midpoint {few} --claim energy --expected {file}").output
    size = r"[\d.e+]+ against [\d.e+]+ ulp of H"
    why = r"\(violated when this file was written.*\)"
    assert re.search(rf"energy \(Prop. 3.1\) expected: {size} {why}", shown)
    assert "H(y) =" not in shown  # one line for a law that is violated as expected
    # A scheme that does not fail as expected, and a violation that is not in the file.
    passed = command(f"verify energy-preserving {few} --expected {file}", 1).output
    assert "Expected failures that pass: energy" in passed
    assert "remove the entry" in passed
    command(f"verify discrete-gradient {few} --claim casimir --expected {file}", 1)


ITO = """
import drawn, sepv
scheme = sepv.Scheme("ito", drawn.euler, mean_square_order=0.5, batched=True)
"""


def test_statistical_laws_can_be_expected_failures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, asked = tmp_path / "expected.toml", "verify ito_scheme:scheme --law right-limit,mean-square-order"
    (tmp_path / "ito_scheme.py").write_text(ITO)
    monkeypatch.syspath_prepend(str(tmp_path))
    command(f"{asked} --paths 256 --write-expected {file}", 1)
    assert "seed = 0" in file.read_text()
    command(f"{asked} --expected {file}")


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
    mark = f"::error file=verification/test_files.py,line={line},title=sepv%3A identity::identity "
    assert found.startswith(mark)
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
    report = measured(refusing(RuntimeError("no luck")))
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
