"""Names of laws: parts of laws are claimed apart, and names of former versions work and are noted
once.
"""

import json
import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest
from doors import command
from sepv.properties import renamed

import sepv
from sepv import Scheme, schemes
from sepv.schemes import ALL_LAWS, FORMER_LAWS, page_of
from sepv.schemes._claims import note_former
from sepv.verification import Effort, Verdict, load_expectations, load_laws

FEW = Effort(examples=1)
step = schemes.midpoint.step


@pytest.fixture(autouse=True)
def unnoted() -> Iterator[None]:
    note_former.cache_clear()
    yield
    note_former.cache_clear()


def test_there_are_few_laws_and_each_former_name_leads_to_one() -> None:
    assert len({page_of(law) for law in ALL_LAWS}) <= 32
    assert set(FORMER_LAWS.values()) <= set(ALL_LAWS)
    assert not set(FORMER_LAWS) & set(ALL_LAWS)
    assert all(page_of(law) in ALL_LAWS for law in ALL_LAWS)


@pytest.mark.parametrize("old", FORMER_LAWS)
def test_a_former_name_is_a_claim_and_a_law_and_is_noted_once(old: str) -> None:
    with pytest.warns(FutureWarning, match=f"the law {old} is now {FORMER_LAWS[old]}") as noted:
        scheme = Scheme("mine", step, claims=[old.replace("-", "_"), "energy"])
    (law,) = load_laws(old)  # a second note would be an error
    assert len(noted) == 1
    assert scheme.claims == {FORMER_LAWS[old], "energy"}
    assert law.name == FORMER_LAWS[old]
    assert law.claimed_by(scheme)


def test_the_part_of_a_law_is_claimed_without_the_law() -> None:
    laws = ["poisson-map", "poisson-map:constant"]
    report = sepv.verify("midpoint", laws=laws, effort=FEW)
    assert [(f.law, f.claimed, f.verdict.text) for f in report.findings] == [
        ("poisson-map", False, "violated"), ("poisson-map:constant", True, "holds"),
    ]  # fmt: skip
    assert report.exit_code == 0
    with pytest.warns(FutureWarning):
        assert report.finding("symplecticity") is report.finding("poisson-map:constant")


def test_a_scheme_claims_casimirs_of_friction_and_says_nothing_of_those_of_lotka_and_volterra() -> None:
    """The step of *conformal* without friction is (2.1),
    which loses the Casimir ln y1 + bd ln y2 − d ln y3.
    """
    report = sepv.verify("conformal", laws="invariant:casimir", problems="lotka-volterra", effort=FEW)
    (found,) = report.findings
    assert found.claimed
    assert found.verdict is Verdict.NOT_APPLICABLE
    assert "states no other Casimirs" in found.message
    assert not report.failing
    unclaimed = sepv.verify(
        "energy-preserving", laws="invariant:casimir", problems="lotka-volterra", effort=FEW
    )
    assert [f.verdict for f in unclaimed.findings] == [Verdict.VIOLATED]


def test_laws_of_an_old_report_that_are_one_now_keep_the_verdict_that_says_most() -> None:
    def law(name: str, verdict: str) -> dict[str, str]:
        return {"law": name, "verdict": verdict}

    old = [law("any-casimir", "not_applicable"), law("casimir-drift", "holds"), law("energy", "holds")]
    counts = {"holds": 2, "violated": 0, "not_applicable": 1}
    with pytest.warns(FutureWarning):
        new = renamed({"laws": old, "counts": counts, "suite": {"laws": 3}})
    assert new["laws"] == [law("energy", "holds"), law("invariant:casimir", "holds")]
    assert new["counts"] == counts | {"not_applicable": 0}
    assert new["suite"] == {"laws": 2}


def test_a_pin_and_a_report_with_former_names_are_read(tmp_path: Path) -> None:
    pin, report = tmp_path / "pin.toml", tmp_path / "report.json"
    token = command("verify energy-preserving --law poisson-map:constant --examples 1").output
    token = token.partition("--replay ")[2].split()[0]
    pin.write_text(
        f"""claims = ["contract"]\nmeasured = ["contract", "symplecticity"]
[[expected]]\nlaw = "symplecticity"\nreason = "it keeps H"\nwitness = "{token}"\n"""
    )
    with pytest.warns(FutureWarning):
        known = load_expectations(pin, ALL_LAWS)
    assert known.measured == {"contract", "poisson-map:constant"}
    assert list(known.failures) == ["poisson-map:constant"]
    run = f"verify energy-preserving --law poisson-map:constant,contract --examples 1 --expected {pin}"
    assert command(run, 0).exit_code == 0
    command(f"verify midpoint --law poisson-map:constant --examples 1 --json {report}", 0)
    data = json.loads(report.read_text())
    data["laws"][0]["law"] = "symplecticity"
    report.write_text(json.dumps(data))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        found = command(f"verify midpoint --against {report}")
    assert found.exit_code == 0, found.output
