"""Profiles: what each needs, how an order is decided, what badge and files say;
pins guard a run both ways.
"""

import json
import math
import re
import tomllib
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from doors import command, doc, obeys
from drawn import refusing
from sepv.properties._orders.local_orders import Slope, order_shown
from sepv.properties.test_mean_square_order import MEAN_SQUARE_MARGIN, order_above

import sepv
from sepv import Scheme, Skipped
from sepv.schemes._midpoint import step as midpoint
from sepv.verification import PROFILES, SUITE, Effort, Finding, Report, Verdict, badge_json, load_laws, verify
from sepv.verification._junit_and_badge import BADGE, _fitting
from sepv.verification._profiles import found, missing, profiled, requirements
from sepv.verification._report import summary

DOC = doc("profiles.md")
LAWS = load_laws()
ORDERS = {law for p in PROFILES if p.ordered for law in p.laws}
FEW = Effort(examples=2, paths=512, shrink_checks=0)


def shows(*orders: float | None) -> dict[str, Any]:
    """The witness of a law about orders: what each problem shows."""
    return {"measured": [{"problem": "p", "order": order} for order in orders]}


def findings(
    claims: Iterable[str] = (), orders: dict[str, Any] | None = None, **verdicts: Verdict
) -> list[Finding]:
    """One for each law: all hold, but for those that are named, and all orders are 1,
    but for those that are given.
    """
    named = {name.replace("_", "-"): verdict for name, verdict in verdicts.items()}
    shown = {name: shows(1.0) for name in ORDERS} | (orders or {})
    return [
        law.finding(
            named.get(law.name, Verdict.HOLDS), claimed=law.always_claimed or law.name in claims,
            witness=shown.get(law.name),
        )
        for law in LAWS
    ]  # fmt: skip


def badge(report: Report) -> tuple[str, str]:
    data = json.loads(badge_json(report))
    assert data["label"] == f"sepv {SUITE}"
    return data["message"], data["color"]


def reported(found: list[Finding], **more: Any) -> Report:
    scheme = replace(sepv.schemes.by_name("midpoint"), claims=frozenset(f.law for f in found if f.claimed))
    return Report(scheme, tuple(found), Effort(), **more)


@pytest.mark.parametrize("profile", [p for p in PROFILES if not p.ordered], ids=lambda p: p.name)
@pytest.mark.parametrize("verdict", [v for v in Verdict if v is not Verdict.HOLDS])
def test_a_profile_is_found_only_where_each_of_its_laws_holds(profile: Any, verdict: Verdict) -> None:
    assert profile.words in found(profiled(findings()))
    for law in profile.laws:
        assert profile.words not in found(profiled(findings(**{law: verdict})))


def test_claims_change_no_profile() -> None:
    assert found(profiled(findings(law.name for law in LAWS))) == found(profiled(findings()))


def test_an_order_is_the_least_that_problems_and_laws_show() -> None:
    assert found(profiled(findings()))[:2] == ["method", "order 1"]
    three = ("mean-square-order", "local-mean", "local-mean-square")
    for law in three:
        others = {name: shows(2.0, 3.0) for name in three}
        assert "order 1.5" in found(profiled(findings(orders=others | {law: shows(2.0, 1.5)})))
        nothing = found(profiled(findings(orders=others | {law: shows(2.0, None)})))
        assert not any(re.fullmatch(r"order [\d.]+", words) for words in nothing)


def test_paths_must_have_shown_an_order_and_one_step_may_be_silent() -> None:
    silent = {"local-mean": None, "local-mean-square": None}
    unknown = dict.fromkeys(("local_mean", "local_mean_square"), Verdict.NOT_APPLICABLE)
    assert "order 1" in found(profiled(findings(orders=silent, **unknown)))
    none = findings(orders={"mean-square-order": None}, mean_square_order=Verdict.NOT_APPLICABLE)
    no_paths = found(profiled(none))
    assert "order 1" not in no_paths
    assert "weak order 1" in no_paths  # no mean-square order says more


def test_a_weak_order_is_said_where_it_is_more_than_the_mean_square_one() -> None:
    weak = {"weak-order": shows(2.0), "local-weak": shows(2.0)}
    assert found(profiled(findings(orders=weak)))[1:3] == ["order 1", "weak order 2"]
    assert "weak order 1" not in found(profiled(findings()))


def test_an_interval_shows_the_largest_order_that_it_lies_above_half_way_to() -> None:
    """At 0.75 = 1 − MEAN_SQUARE_MARGIN order ½ may still be the true one: the interval must lie
    above it.
    """
    assert [order_above(low) for low in (-math.inf, math.inf, math.nan)] == [0, 0, 0]
    shown = [order_above(low) for low in (0.1, 0.25, 0.26, 0.75, 0.76, 1.25, 1.26, 1.9)]
    assert (shown, MEAN_SQUARE_MARGIN) == ([0, 0, 0.5, 0.5, 1, 1, 1.5, 2], 0.25)


@pytest.mark.parametrize(
    ("verdict", "value", "order"),
    [
        (Verdict.HOLDS, 2.0, 1.0), (Verdict.HOLDS, 2.26, 1.5), (Verdict.HOLDS, 3.1, 2.0),
        (Verdict.HOLDS, math.inf, 1.0),  # rounding alone shows no higher order than was measured against
        (Verdict.VIOLATED, 1.5, 0.5), (Verdict.VIOLATED, 1.0, None), (Verdict.INCONCLUSIVE, 3.0, None),
    ],
)  # fmt: skip
def test_a_slope_shows_the_largest_order_that_it_suffices_for(verdict, value, order):
    """A mean error: p + 1 − ¼ is needed, and the quadrature sees no power above 3."""
    needs = lambda p: min(p + 1.0, 3.0) - 0.25  # noqa: E731
    assert order_shown(Slope(verdict, value, ""), 1.0, 0.5, needs) == order


def test_a_badge_names_what_was_found_and_no_score() -> None:
    held = reported(findings(["energy"]))
    message, color = badge(held)
    assert color == "brightgreen"
    assert message.partition(", +")[0] in ", ".join(found(held.profiles))
    unclaimed = reported(findings(["casimir"], energy=Verdict.VIOLATED))
    assert badge(unclaimed)[1] == "brightgreen"
    assert "energy" not in badge(unclaimed)[0]
    nothing = dict.fromkeys((law.name.replace("-", "_") for law in LAWS), Verdict.VIOLATED)
    none = reported(findings(orders=dict.fromkeys(ORDERS), **nothing))
    assert badge(none) == ("contract violated", "red")


@pytest.mark.parametrize(
    ("verdict", "color"),
    [(Verdict.VIOLATED, "red"), (Verdict.INCONCLUSIVE, "orange"), (Verdict.ERROR, "orange")],
)
def test_a_claimed_law_that_is_not_found_to_hold_is_named_on_the_badge_which_is_not_green(verdict, color):
    message, seen = badge(reported(findings(["rounding"], rounding=verdict)))
    assert seen == color
    assert message == f"rounding {verdict.text}"


def test_a_badge_has_at_most_sixty_characters() -> None:
    """Seven broken claims are the first with six more;
    long lists of profiles and of waivers are counted too.
    """
    broken = ["casimir", "energy", "identity", "symmetry", "midpoint", "reduction", "noise-sum"]
    violated = dict.fromkeys((law.replace("-", "_") for law in broken), Verdict.VIOLATED)
    assert badge(reported(findings(broken, **violated))) == ("identity violated, +6", "red")
    waived = [
        replace(f, expected="known") if f.verdict is Verdict.VIOLATED else f for f in findings((), **violated)
    ]
    message, color = badge(reported(waived))
    assert message.endswith("; 7 waived")
    assert color == "brightgreen"
    whole = reported(findings(["energy"]))
    assert len(badge(whole)[0]) <= BADGE
    shown, more = badge(whole)[0].split(", +")
    assert len(shown.split(", ")) + int(more) == len(found(whole.profiles))
    assert _fitting(["x" * 80], 60) == "x" * 59 + "…"


def test_a_waiver_makes_no_profile_and_is_shown() -> None:
    waived = [
        replace(f, verdict=Verdict.VIOLATED, expected="walks away") if f.law == "energy" else f
        for f in findings(["energy"])
    ]
    report = reported(waived)
    assert report.exit_code == 0
    assert "energy," not in badge(report)[0]
    assert badge(report)[0].endswith("; waived: energy")
    assert str(report).splitlines()[-1].endswith("; waived: energy.")
    assert report.to_json()["profiles"]["waived"] == ["energy"]


def test_a_required_profile_that_is_not_found_is_exit_code_1_and_the_last_line_says_why() -> None:
    report = reported(findings(energy=Verdict.VIOLATED), required=requirements("energy,order-2,symmetric"))
    assert report.exit_code == 1
    why = "energy (energy violated), order-2 (order 1 was measured)"
    assert str(report).splitlines()[-1].endswith(f"Required and not found: {why}.")
    assert why in report._repr_html_()
    assert badge(report) == ("no energy (energy violated), +1", "red")
    data = report.to_json()
    obeys(data, "report")
    assert data["suite"]["laws_version"] == SUITE
    assert data["profiles"]["required"] == ["energy", "order-2", "symmetric"]
    assert "order-1" in data["profiles"]["found"]
    assert data["profiles"]["not_found"]["energy"] == "energy violated"


def test_a_higher_order_is_more_than_what_was_required() -> None:
    assert missing(profiled(findings()), requirements("order-1/2,weak-order-1,order-1")) == []


def test_a_run_of_a_few_laws_says_what_they_show() -> None:
    few = [f for f in findings() if f.law in ("energy", "rounding")]
    assert found(profiled(few)) == ["energy"]
    assert str(reported([f for f in few if f.law == "rounding"])).count("Found") == 0
    assert missing(profiled(few), requirements("symmetric")) == ["symmetric (not measured)"]


def test_requirements_measure_their_laws_and_those_of_a_method() -> None:
    report = sepv.verify("euler-maruyama", require="energy", effort=FEW)
    assert [f.law for f in report.findings] == ["contract", "reproducibility", "energy", "right-limit"]
    assert report.exit_code == 1


def test_the_commands_of_the_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every line of docs/profiles.md's sh blocks as it stands, with a smaller default effort."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sepv.verification, "Effort", partial(Effort, 2, 2048, shrink_checks=10))
    lines = "".join(re.findall(r"^```sh\n(.*?)^```$", DOC, flags=re.MULTILINE | re.DOTALL)).splitlines()
    assert len(lines) == 3
    for line in lines:
        command(line.removeprefix("sepv "))


def test_the_page_lists_every_profile_with_its_laws() -> None:
    for profile in PROFILES:
        name = f"{profile.name}-P" if profile.ordered else profile.name
        row = next(line for line in DOC.splitlines() if line.startswith(f"| `{name}` |"))
        assert re.findall(r"\*([a-z:-]+)\*", row) == list(profile.laws)


def test_a_law_more_is_a_new_version() -> None:
    rows = re.findall(r"^\| (\d+) \| sepv .*$", DOC, re.MULTILINE)
    assert rows == [str(n + 1) for n in range(SUITE)]
    last = re.findall(rf"^\| {SUITE} \| sepv \S+ \| (\d+) \|$", DOC, re.MULTILINE)
    assert last == [str(len(LAWS))]


# Cheap ones: *contract*, which everybody claims, takes seconds and is asked once.
THREE = "identity,energy,casimir"
MODULE = "from sepv.schemes._{} import step\n"


@pytest.fixture
def pinned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quick: None) -> Path:
    """A folder where the midpoint rule, a bare function that claims nothing, was pinned."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "my_rule.py").write_text(MODULE.format("midpoint"))
    shown = said("my_rule:step --pin pin.toml")
    assert "sepv verify my_rule:step --law identity,energy,casimir --expected pin.toml" in shown
    return tmp_path


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Little effort; above all few checks for simplifying counterexamples."""
    monkeypatch.setattr("sepv.commands._verify._effort", lambda **_: Effort(8, 64, 0, 10))


def said(line: str, code: int = 0, laws: str = THREE) -> str:
    return " ".join(command(f"verify --law {laws} {line}", code).output.split())


def test_a_pin_holds_what_was_found(pinned: Path) -> None:
    data = tomllib.loads((pinned / "pin.toml").read_text())
    assert data["claims"] == ["identity", "casimir"]
    assert [e["law"] for e in data["expected"]] == ["energy"]
    again = said("my_rule:step --expected pin.toml -q", laws=f"{THREE},contract")
    assert "All 3 claimed laws hold." in again


def test_a_run_complains_of_claims_alone() -> None:
    """A law that holds, one that is violated and not claimed,
    and one whose failure is expected are no complaints.
    """
    found = findings(("energy", "casimir", "midpoint"), energy=Verdict.VIOLATED, symmetry=Verdict.VIOLATED)
    expected = [
        replace(f, expected="known", verdict=Verdict.VIOLATED) if f.law == "casimir" else f for f in found
    ]
    text = summary(reported(expected)).plain
    assert "Claimed and not found to hold: energy." in text
    assert not re.search("Claimed and not measured|Expected failures that pass|not in the pin", text)


def test_a_pin_is_strict_both_ways(pinned: Path) -> None:
    gained = said("energy-preserving --expected pin.toml -q", 1)
    assert "Expected failures that pass: energy." in gained
    lost = said("discrete-gradient --expected pin.toml -q", 1)
    assert "Claimed and not found to hold: casimir." in lost
    other = said("my_rule:step --expected pin.toml -q", 1, laws="invariant:casimir")
    assert "Violated and not in the pin: invariant:casimir." in other


def test_a_pin_names_the_laws_that_it_was_written_without(pinned: Path) -> None:
    assert tomllib.loads((pinned / "pin.toml").read_text())["measured"] == ["identity", "energy", "casimir"]
    more = said("my_rule:step --expected pin.toml -q", laws=f"{THREE},truncation")
    assert "Not in the pin, which was written without them: truncation. All 2 claimed laws hold." in more
    fewer = said("my_rule:step --expected pin.toml -q", laws="casimir")
    assert "In the pin and not measured now: energy, identity. The claimed law holds." in fewer
    file = pinned / "pin.toml"
    file.write_text("\n".join(line for line in file.read_text().splitlines() if "measured" not in line))
    assert "Not in the pin" not in said("my_rule:step --expected pin.toml -q", laws=f"{THREE},truncation")


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


def test_a_claim_whose_cases_are_all_skipped_is_a_failure() -> None:
    scheme = Scheme("choosy", refusing(Skipped("not today")), claims=["mean-square-order"])
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


def test_laws_side_by_side_find_the_same_to_the_bit(tmp_path, monkeypatch, quick):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    # A module full of constants, which Hypothesis would draw where it is loaded.
    code = MODULE.format("midpoint") + "SEEN = [0.123, 4.5, 6.75e3, 17.0, 3]\n"
    (tmp_path / "our_rule.py").write_text(code)
    files = []
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
