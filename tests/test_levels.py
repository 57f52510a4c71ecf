"""Levels of conformance: what each needs, what a waiver does, what the files and the last line say."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import jsonschema
import pytest
from click.testing import CliRunner

import sepv
from sepv.commands._cli import main
from sepv.errors import UsageError
from sepv.files import schema
from sepv.verification import LEVELS, SUITE, Effort, Finding, Report, Verdict, conformance, load_laws
from sepv.verification._junit_and_badge import badge_json

DOC = (Path(__file__).resolve().parents[1] / "docs" / "levels.md").read_text()
LAWS = load_laws()
ORDERS = [law.name for law in LAWS if law.level == 2]


def findings(claims: list[str], **verdicts: Verdict) -> list[Finding]:
    """One for each law: all hold, but for those that are named."""
    named = {name.replace("_", "-"): verdict for name, verdict in verdicts.items()}
    return [
        replace(
            law.finding(named.get(law.name, Verdict.HOLDS)), claimed=law.always_claimed or law.name in claims
        )
        for law in LAWS
    ]


def level(found: list[Finding]) -> int:
    reached = conformance(found, LAWS)
    assert reached is not None
    return reached.level


def test_each_level_needs_the_one_below() -> None:
    everything = [*ORDERS, "energy"]
    assert level(findings(everything)) == 3
    assert level(findings(ORDERS)) == 2  # claims to keep nothing
    assert level(findings(["energy"])) == 1  # claims no order
    assert level(findings(everything, energy=Verdict.VIOLATED)) == 2
    assert level(findings(everything, weak_order=Verdict.INCONCLUSIVE)) == 1
    assert level(findings(everything, right_limit=Verdict.VIOLATED)) == 0
    assert level(findings(everything, contract=Verdict.ERROR)) == 0


def test_what_nobody_claims_hinders_only_where_it_is_needed() -> None:
    claims = [*ORDERS, "energy"]
    assert level(findings(claims, identity=Verdict.VIOLATED, casimir=Verdict.VIOLATED)) == 3
    assert level(findings([*claims, "identity"], identity=Verdict.VIOLATED)) == 0
    assert level(findings(claims, reproducibility=Verdict.VIOLATED)) == 0


def test_a_law_that_says_nothing_makes_no_level_and_hinders_none() -> None:
    claims = [*ORDERS, "energy", "commutation"]
    assert level(findings(claims, commutation=Verdict.NOT_APPLICABLE)) == 3
    assert level(findings([*ORDERS, "commutation"], commutation=Verdict.NOT_APPLICABLE)) == 2
    skipped = [
        replace(f, verdict=Verdict.NOT_APPLICABLE, skipped=7) if f.law == "energy" else f
        for f in findings(claims)
    ]
    assert level(skipped) == 2


def test_a_waiver_is_counted_and_shown() -> None:
    found = [
        replace(f, verdict=Verdict.VIOLATED, expected="walks away") if f.law == "rounding" else f
        for f in findings([*ORDERS, "energy", "rounding"])
    ]
    reached = conformance(found, LAWS)
    assert reached is not None
    assert (reached.level, reached.waived) == (3, ("rounding",))
    assert "rounding" not in reached.laws[3]
    assert str(reached) == f"Level 3 of suite version {SUITE} with 1 waived (rounding)."


def test_a_run_of_a_few_laws_says_nothing() -> None:
    assert conformance([f for f in findings([]) if f.law != "identity"], LAWS) is None
    without_orders = [f for f in findings(ORDERS) if f.law not in ORDERS]
    reached = conformance(without_orders, LAWS)
    assert reached is not None
    assert (reached.level, reached.why) == (1, "")


def test_badge_json_and_last_line_name_level_and_version() -> None:
    scheme = sepv.schemes.by_name("midpoint")
    report = Report(
        scheme, tuple(findings([*ORDERS, "casimir"], casimir=Verdict.VIOLATED)), Effort(), level=3
    )
    assert report.exit_code == 1
    assert (
        str(report)
        .splitlines()[-1]
        .endswith(f"Level 2 of suite version {SUITE}; not 3: casimir violated. Level 3 was asked for.")
    )
    assert json.loads(badge_json(report))["message"].startswith(f"level 2 of suite {SUITE}: ")
    data = report.to_json()
    jsonschema.validate(data, schema("report"))
    assert data["suite"]["laws_version"] == SUITE
    assert data["conformance"]["laws"]["2"] == ORDERS
    assert data["conformance"]["why_not_more"] == "casimir violated"


def test_a_level_measures_its_laws_alone() -> None:
    report = sepv.verify("midpoint", level=1, effort=Effort(examples=2, shrink_checks=0))
    assert [f.law for f in report.findings] == [law.name for law in LAWS if law.level == 1]
    assert report.exit_code == 0
    assert report.conformance is not None
    assert report.conformance.level == 1


@pytest.mark.parametrize(
    ("wrong", "laws"), [(0, None), (4, None), (True, None), ("2", None), (1, ["energy"])]
)
def test_a_wrong_level_is_refused(wrong: object, laws: object) -> None:
    with pytest.raises(UsageError, match="a level of 1, 2 or 3"):
        sepv.verify("midpoint", level=wrong, laws=laws)  # type: ignore[arg-type]  # refused on purpose


def test_the_commands_of_the_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every line of docs/levels.md's sh blocks as it stands, with a smaller default effort."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sepv.verification, "Effort", partial(Effort, examples=2, paths=512, shrink_checks=10))
    lines = "".join(re.findall(r"^```sh\n(.*?)^```$", DOC, flags=re.MULTILINE | re.DOTALL)).splitlines()
    assert [line.split()[1] for line in lines] == ["verify", "submit", "check"]
    for line in lines:
        done = CliRunner().invoke(main, line.split()[1:])
        assert done.exit_code == 0, done.output


def test_the_page_lists_every_law_under_its_level() -> None:
    for number in LEVELS:
        row = next(line for line in DOC.splitlines() if line.startswith(f"| {number} | ") and "*" in line)
        own = [law.name + (" (needed)" if law.needed else "") for law in LAWS if law.level == number]
        assert [cell.replace("*", "") for cell in row.split("|")[3].strip().split(", ")] == own


def test_a_law_more_is_a_new_version() -> None:
    rows = re.findall(r"^\| (\d+) \| sepv .*$", DOC, re.MULTILINE)
    assert rows == [str(n + 1) for n in range(SUITE)]
    last = re.findall(rf"^\| {SUITE} \| sepv .*$", DOC, re.MULTILINE)[0]
    assert re.findall(r"\*([a-z-]+)\*", last) == [law.name for law in LAWS]
