"""What a run leaves for other programs: JSON by its schema, JUnit XML, a badge, expected failures."""

import json
from pathlib import Path
from xml.etree import ElementTree

import jsonschema
import numpy as np
import pytest
from doors import command, obeys

from sepv import schemes
from sepv.errors import UsageError
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
from sepv.schemes import Scheme
from sepv.verification import Effort, Report, verify
from sepv.verification._junit_and_badge import junit_xml

FEW = Effort(examples=2, paths=256, shrink_checks=20)


def broken(problem, y, h, dW):
    raise RuntimeError("</script>\x00\x1b broken 💥")


@pytest.fixture(scope="module")
def made() -> dict[str, Report]:
    one, evil = Scheme("one", schemes.midpoint.step, truncation=None), Scheme("<b>\u202e&\x01", broken)
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
        ({"schema": "ulps"}, "'report' was expected"),
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


def test_expected_failures_are_strict_both_ways(tmp_path: Path) -> None:
    file, few = tmp_path / "expected.toml", "--law energy,casimir --examples 2 --shrink-checks 20"
    # What nobody claims is not listed: a scheme that gains a law must stay green.
    command(f"verify midpoint {few} --write-expected {file}")
    assert "[[expected]]" not in file.read_text()
    command(f"verify midpoint {few} --claim energy --write-expected {file}", 1)
    # Violated as expected, though claimed.
    shown = command(f"verify midpoint {few} --claim energy --expected {file}").output
    assert "expected: violated when this file was written" in shown
    # A scheme that does not fail as expected, and a violation that is not in the file.
    passed = command(f"verify energy-preserving {few} --expected {file}", 1).output
    assert "Expected failures that pass: energy" in passed
    assert "remove the entry" in passed
    command(f"verify discrete-gradient {few} --claim casimir --expected {file}", 1)


# Euler-Maruyama on the Stratonovich coefficients as they are: it converges to the Itô solution.
ITO = """
import sepv
from sepv.problem._fields import vector_field

def step(problem, y, h, dW):
    return y + vector_field(problem, y) * problem.random_step(h, dW)

scheme = sepv.Scheme("ito", step, mean_square_order=0.5, batched=True)
"""


def test_statistical_laws_can_be_expected_failures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, asked = tmp_path / "expected.toml", "verify ito_scheme:scheme --law right-limit,mean-square-order"
    (tmp_path / "ito_scheme.py").write_text(ITO)
    monkeypatch.syspath_prepend(str(tmp_path))
    command(f"{asked} --paths 256 --write-expected {file}", 1)
    assert "seed = 0" in file.read_text()
    command(f"{asked} --expected {file}")
