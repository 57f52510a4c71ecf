"""What a green run guards: pins are strict both ways, a claim that was not measured is red, a bare function is told."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from sepv.commands._cli import main
from sepv.errors import Skipped, UsageError
from sepv.schemes import Scheme
from sepv.schemes._energy_preserving import step as exact
from sepv.schemes._midpoint import step as midpoint
from sepv.verification import Effort, Verdict, verify
from sepv.verification._report import summary

# Cheap ones: *contract*, which everybody claims, takes seconds and is asked once.
LAWS = ["--law", "identity", "--law", "energy", "--law", "casimir"]
MODULE = "from sepv.schemes._{} import step\n"


@pytest.fixture
def pinned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder where the midpoint rule, a bare function that claims nothing, was pinned."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "my_rule.py").write_text(MODULE.format("midpoint"))
    done = call("my_rule:step", "--pin", "pin.toml")
    assert done.exit_code == 0, done.output
    assert "sepv verify my_rule:step --law identity,energy,casimir --expected pin.toml" in done.output
    return tmp_path


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Little effort; above all few checks for simplifying counterexamples."""
    monkeypatch.setattr("sepv.commands._verify._effort", lambda **_: Effort(8, 64, 0, 10))


def call(target: str, *options: str):
    return CliRunner().invoke(main, ["verify", target, *LAWS, *options])


def test_a_pin_holds_what_was_found(pinned: Path) -> None:
    data = tomllib.loads((pinned / "pin.toml").read_text())
    assert data["claims"] == ["identity", "casimir"]
    assert [e["law"] for e in data["expected"]] == ["energy"]
    again = call("my_rule:step", "--law", "contract", "--expected", "pin.toml", "-q")
    assert again.exit_code == 0, again.output
    assert "All 3 claimed laws hold." in again.output


def test_a_pin_is_strict_both_ways(pinned: Path) -> None:
    gained = call("energy-preserving", "--expected", "pin.toml", "-q")
    assert gained.exit_code == 1
    assert "Expected failures that pass: energy." in gained.output
    lost = call("discrete-gradient", "--expected", "pin.toml", "-q")
    assert lost.exit_code == 1
    assert "Claimed and not found to hold: casimir." in lost.output
    other = CliRunner().invoke(
        main, ["verify", "my_rule:step", "--law", "any-casimir", "--expected", "pin.toml", "-q"]
    )
    assert other.exit_code == 1
    assert "Violated and not in the pin: any-casimir." in other.output


def test_a_pin_names_the_laws_that_it_was_written_without(pinned: Path) -> None:
    assert tomllib.loads((pinned / "pin.toml").read_text())["measured"] == ["identity", "energy", "casimir"]
    more = call("my_rule:step", "--law", "truncation", "--expected", "pin.toml", "-q")
    assert more.exit_code == 0, more.output
    assert (
        "Not in the pin, which was written without them: truncation. All 2 claimed laws hold." in more.output
    )
    fewer = CliRunner().invoke(
        main, ["verify", "my_rule:step", "--law", "casimir", "--expected", "pin.toml", "-q"]
    )
    assert fewer.exit_code == 0
    assert "In the pin and not measured now: energy, identity. The claimed law holds." in fewer.output
    file = pinned / "pin.toml"
    # One of an older sepv says nothing of what it measured.
    file.write_text("\n".join(line for line in file.read_text().splitlines() if "measured" not in line))
    assert (
        "Not in the pin"
        not in call("my_rule:step", "--law", "truncation", "--expected", "pin.toml", "-q").output
    )


def test_the_title_does_not_say_that_nothing_is_claimed_beside_a_claim() -> None:
    bare = verify(midpoint, laws=["casimir"], effort=Effort(5, 64, 0, 5))
    assert "a function of which nothing is claimed" in str(bare)
    held = verify(midpoint, laws=["casimir"], claims=["casimir"], effort=Effort(5, 64, 0, 5))
    assert "a function of which nothing" not in str(held)
    assert str(held).splitlines()[0].endswith(" · a function")


def test_a_law_is_either_claimed_or_expected_to_fail(pinned: Path) -> None:
    file = pinned / "pin.toml"
    file.write_text(file.read_text().replace('"casimir"]', '"energy"]'))
    wrong = call("my_rule:step", "--expected", "pin.toml")
    assert wrong.exit_code == 2
    assert "both: energy" in wrong.output


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
    (tmp_path / "our_rule.py").write_text(
        MODULE.format("midpoint") + "SEEN = [0.123, 4.5, 6.75e3, 17.0, 3]\n"
    )
    files = []
    for jobs in ("1", "2"):
        # Laws that hold: how far a counterexample is simplified is a matter of seconds.
        laws = ["--law", "identity", "--law", "casimir", "--law", "midpoint"]
        done = CliRunner().invoke(
            main, ["verify", "our_rule:step", *laws, "-j", jobs, "--json", f"{jobs}.json"]
        )
        assert done.exit_code == 0, done.output
        found = json.loads((tmp_path / f"{jobs}.json").read_text())["laws"]
        files.append([{**law, "seconds": 0} for law in found])
    assert files[0] == files[1]
    assert {law["law"]: law["verdict"] for law in files[0]} == {
        "identity": "holds", "casimir": "holds", "midpoint": "holds",
    }  # fmt: skip


def test_a_scheme_that_cannot_travel_is_refused_in_words() -> None:
    def local(problem, y, h, dW):
        return exact(problem, y, h, dW)

    with pytest.raises(UsageError, match="another process can import"):
        verify(local, laws=["energy", "casimir"], jobs=2)
    with pytest.raises(UsageError, match="jobs"):
        verify("midpoint", jobs=0)


def test_a_worker_that_dies_is_an_error_of_its_law(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "falls.py").write_text(
        "import os, sepv\nscheme = sepv.Scheme('falls', lambda problem, y, h, dW: os._exit(9))\n"
    )
    report = verify("falls:scheme", laws=["contract", "energy"], effort=Effort(8, 64, 0, 10), jobs=2)
    assert [f.verdict for f in report.findings] == [Verdict.ERROR] * 2
    assert "exit code 9" in report.findings[0].message
    assert report.exit_code == 3
