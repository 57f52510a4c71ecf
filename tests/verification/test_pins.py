"""What a green run guards: pins are strict both ways, a claim that was not measured is red, a bare function is told."""

import json
import tomllib
from pathlib import Path

import pytest
from doors import command

from sepv.errors import Skipped
from sepv.schemes import Scheme
from sepv.schemes._midpoint import step as midpoint
from sepv.verification import Effort, Verdict, verify
from sepv.verification._report import summary

# Cheap ones: *contract*, which everybody claims, takes seconds and is asked once.
LAWS = "identity,energy,casimir"
MODULE = "from sepv.schemes._{} import step\n"


@pytest.fixture
def pinned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder where the midpoint rule, a bare function that claims nothing, was pinned."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "my_rule.py").write_text(MODULE.format("midpoint"))
    shown = said("my_rule:step --pin pin.toml")
    assert "sepv verify my_rule:step --law identity,energy,casimir --expected pin.toml" in shown
    return tmp_path


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Little effort; above all few checks for simplifying counterexamples."""
    monkeypatch.setattr("sepv.commands._verify._effort", lambda **_: Effort(8, 64, 0, 10))


def said(line: str, code: int = 0, laws: str = LAWS) -> str:
    return " ".join(command(f"verify --law {laws} {line}", code).output.split())


def test_a_pin_holds_what_was_found(pinned: Path) -> None:
    data = tomllib.loads((pinned / "pin.toml").read_text())
    assert data["claims"] == ["identity", "casimir"]
    assert [e["law"] for e in data["expected"]] == ["energy"]
    again = said("my_rule:step --expected pin.toml -q", laws=f"{LAWS},contract")
    assert "All 3 claimed laws hold." in again


def test_a_pin_is_strict_both_ways(pinned: Path) -> None:
    gained = said("energy-preserving --expected pin.toml -q", 1)
    assert "Expected failures that pass: energy." in gained
    lost = said("discrete-gradient --expected pin.toml -q", 1)
    assert "Claimed and not found to hold: casimir." in lost
    other = said("my_rule:step --expected pin.toml -q", 1, laws="any-casimir")
    assert "Violated and not in the pin: any-casimir." in other


def test_a_pin_names_the_laws_that_it_was_written_without(pinned: Path) -> None:
    assert tomllib.loads((pinned / "pin.toml").read_text())["measured"] == ["identity", "energy", "casimir"]
    more = said("my_rule:step --expected pin.toml -q", laws=f"{LAWS},truncation")
    assert "Not in the pin, which was written without them: truncation. All 2 claimed laws hold." in more
    fewer = said("my_rule:step --expected pin.toml -q", laws="casimir")
    assert "In the pin and not measured now: energy, identity. The claimed law holds." in fewer
    file = pinned / "pin.toml"
    # One of an older sepv says nothing of what it measured.
    file.write_text("\n".join(line for line in file.read_text().splitlines() if "measured" not in line))
    assert "Not in the pin" not in said("my_rule:step --expected pin.toml -q", laws=f"{LAWS},truncation")


def test_the_title_does_not_say_that_nothing_is_claimed_beside_a_claim() -> None:
    bare = verify(midpoint, laws=["casimir"], effort=Effort(5, 64, 0, 5))
    assert "a function of which nothing is claimed" in str(bare)
    held = verify(midpoint, laws=["casimir"], claims=["casimir"], effort=Effort(5, 64, 0, 5))
    assert "a function of which nothing" not in str(held)
    assert str(held).splitlines()[0].endswith(" · a function")


def test_a_law_is_either_claimed_or_expected_to_fail(pinned: Path) -> None:
    file = pinned / "pin.toml"
    file.write_text(file.read_text().replace('"casimir"]', '"energy"]'))
    assert "both: energy" in said("my_rule:step --expected pin.toml", 2)


def choosy(problem, y, h, dW):
    raise Skipped("not today")


def test_a_claim_whose_cases_are_all_skipped_is_a_failure() -> None:
    scheme = Scheme("choosy", choosy, claims=["mean-square-order"])
    report = verify(scheme, laws=["mean-square-order", "weak-order"], effort=Effort(5, 64, 0, 10))
    claimed, other = report.findings
    assert claimed.verdict is other.verdict is Verdict.NOT_APPLICABLE
    assert claimed.skipped
    assert report.failing == (claimed,)
    assert report.exit_code == 1
    text = summary(report).plain
    assert text.endswith("Claimed and not measured: mean-square-order.")
    assert " skipped. " in text


def test_a_claim_about_something_else_is_named_and_no_failure() -> None:
    scheme = Scheme("one", midpoint, claims=["casimir", "reproducibility"])
    report = verify(scheme, laws=["casimir", "reproducibility"], effort=Effort(5, 64, 0, 10))
    assert report.exit_code == 0
    said = "The claimed law holds. Claimed, but not about this scheme: reproducibility."
    assert said in summary(report).plain


def test_laws_side_by_side_find_the_same_to_the_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    # A module full of constants, which Hypothesis would draw where it is loaded.
    code = MODULE.format("midpoint") + "SEEN = [0.123, 4.5, 6.75e3, 17.0, 3]\n"
    (tmp_path / "our_rule.py").write_text(code)
    files = []
    # Laws that hold: how far a counterexample is simplified is a matter of seconds.
    laws = "identity,casimir,midpoint"
    for jobs in (1, 2):
        said(f"our_rule:step -j {jobs} --json {jobs}.json", laws=laws)
        found = json.loads((tmp_path / f"{jobs}.json").read_text())["laws"]
        files.append([{**law, "seconds": 0} for law in found])
    assert files[0] == files[1]
    assert {law["law"]: law["verdict"] for law in files[0]} == dict.fromkeys(laws.split(","), "holds")


def test_a_worker_that_dies_is_an_error_of_its_law(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "falls.py").write_text(
        "import os, sepv\nscheme = sepv.Scheme('falls', lambda problem, y, h, dW: os._exit(9))\n"
    )
    report = verify("falls:scheme", laws=["contract", "energy"], effort=Effort(8, 64, 0, 10), jobs=2)
    assert [f.verdict for f in report.findings] == [Verdict.ERROR] * 2
    assert "exit code 9" in report.findings[0].message
    assert report.exit_code == 3
