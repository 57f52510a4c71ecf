"""Profiles: what each needs, how an order is decided, what the badge, the files and the last line say."""

import json
import math
import re
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from doors import command, doc, obeys
from sepv.properties._orders.local_orders import Slope, order_shown
from sepv.properties.test_mean_square_order import MARGIN, order_above

import sepv
from sepv.verification import PROFILES, SUITE, Effort, Finding, Report, Verdict, load_laws
from sepv.verification._junit_and_badge import badge_json
from sepv.verification._profiles import found, missing, profiled, requirements

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
    """One for each law: all hold, but for those that are named, and all orders are 1, but for those that are given."""
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
    """At 0.75 = 1 − MARGIN order ½ may still be the true one: the interval must lie above it."""
    assert [order_above(low) for low in (-math.inf, math.inf, math.nan)] == [0, 0, 0]
    shown = [order_above(low) for low in (0.1, 0.25, 0.26, 0.75, 0.76, 1.25, 1.26, 1.9)]
    assert (shown, MARGIN) == ([0, 0, 0.5, 0.5, 1, 1, 1.5, 2], 0.25)


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
    assert badge(held) == (", ".join(found(held.profiles)), "brightgreen")
    unclaimed = reported(findings(["casimir"], energy=Verdict.VIOLATED))
    assert badge(unclaimed)[1] == "brightgreen"
    assert "energy" not in badge(unclaimed)[0]
    nothing = dict.fromkeys((law.name.replace("-", "_") for law in LAWS), Verdict.VIOLATED)
    none = reported(findings(orders=dict.fromkeys(ORDERS), **nothing))
    assert badge(none) == ("contract violated; no profile", "red")


@pytest.mark.parametrize(
    ("verdict", "color"),
    [(Verdict.VIOLATED, "red"), (Verdict.INCONCLUSIVE, "orange"), (Verdict.ERROR, "orange")],
)
def test_a_claimed_law_that_is_not_found_to_hold_is_named_on_the_badge_which_is_not_green(verdict, color):
    message, seen = badge(reported(findings(["rounding"], rounding=verdict)))
    assert seen == color
    assert message.startswith(f"rounding {verdict.text}; method, order 1")


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
    held = ", ".join(found(report.profiles))
    assert badge(report) == (f"no energy (energy violated); no order-2 (order 1 was measured); {held}", "red")
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
    monkeypatch.setattr(
        sepv.verification, "Effort", partial(Effort, examples=2, paths=2048, shrink_checks=10)
    )
    lines = "".join(re.findall(r"^```sh\n(.*?)^```$", DOC, flags=re.MULTILINE | re.DOTALL)).splitlines()
    assert len(lines) == 3
    for line in lines:
        command(line.removeprefix("sepv "))


def test_the_page_lists_every_profile_with_its_laws() -> None:
    for profile in PROFILES:
        name = f"{profile.name}-P" if profile.ordered else profile.name
        row = next(line for line in DOC.splitlines() if line.startswith(f"| `{name}` |"))
        assert re.findall(r"\*([a-z-]+)\*", row) == list(profile.laws)


def test_a_law_more_is_a_new_version() -> None:
    rows = re.findall(r"^\| (\d+) \| sepv .*$", DOC, re.MULTILINE)
    assert rows == [str(n + 1) for n in range(SUITE)]
    last = re.findall(rf"^\| {SUITE} \| sepv \S+ \| (\d+) \|$", DOC, re.MULTILINE)
    assert last == [str(len(LAWS))]
