"""The HTML page: complete, accessible, small, and inert whatever strangers put into the files."""

import base64
import copy
import hashlib
import html
import re
import subprocess
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from doors import ROOT, chromium, doc
from strangers import (
    ALLOWED,
    EVIL,
    FORMULA,
    Reader,
    comparison,
    empty_page,
    hostile_page,
    hostile_report,
    verify_report,
)

from sepv.errors import UsageError
from sepv.files import fault, schema
from sepv.page import load, render
from sepv.page._pictures import Pictures
from sepv.page._render import fingerprint
from sepv.page._sources import Sources
from sepv.page._views import priced, step_size
from sepv.schemes import EXTENSIONS, PAPER, Look
from sepv.studies._picture import Axis, Series, looks


@pytest.mark.parametrize("page", [hostile_page, hostile_report, empty_page], ids=["hostile", "one", "empty"])
def test_the_page_is_well_formed_and_holds_only_known_elements(page: Callable[[], str]) -> None:
    reader = Reader(page())
    assert reader.open == []
    assert {tag for tag, _ in reader.tags} <= ALLOWED
    for tag, attributes in reader.tags:
        assert not [key for key in attributes if re.match("on|(src|style|srcset|action)$", key)], tag
        assert (attributes.get("href") or "#").startswith("#")
    ids = [a["id"] for _, a in reader.tags if "id" in a]
    assert len(ids) == len(set(ids))
    for _, attributes in reader.tags:
        for key in ("aria-labelledby", "href"):
            for reference in (attributes.get(key) or "").replace("#", "").split():
                assert reference in ids


@pytest.mark.parametrize("made", [hostile_page, hostile_report], ids=["many", "one"])
def test_hostile_strings_are_text(made: Callable[[], str]) -> None:
    page = made()
    assert not [text for text in ("<script", "<img", "\u202e", "\x00", "\x1b") if text in page]
    assert "&lt;script&gt;" in page
    assert "{{ 7 * 7 }}" in page  # shown, not computed
    assert max(map(len, re.findall("x+", page))) <= 1500
    page.encode("utf-8")  # no lone surrogate
    assert len(page) < 400_000


def test_names_are_shown_in_one_line_and_labels_are_no_mathematics() -> None:
    page = hostile_page()
    for shown in ("… (10240 characters)", "(no name)", ">two lines<"):
        assert shown in page
    assert html.escape(FORMULA, quote=False) in "".join(re.findall("<svg.*?</svg>", page, re.DOTALL))


def test_the_policy_names_the_one_style_sheet_and_allows_nothing_else() -> None:
    page = hostile_page()
    tags = [attributes for _, attributes in Reader(page).tags]
    policy = next(a["content"] for a in tags if a.get("http-equiv") == "Content-Security-Policy")
    style = page[page.index("<style>") + 7 : page.index("</style>")]
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    assert policy == f"default-src 'none'; style-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"
    assert page.count("<style") == 1
    assert "url(" not in style
    assert "@import" not in style


def test_headings_captions_and_alternatives() -> None:
    reader = Reader(hostile_page())
    levels = [int(tag[1]) for tag, _ in reader.tags if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(b <= a + 1 for a, b in pairwise(levels))
    kinds = [tag for tag, _ in reader.tags]
    assert kinds.count("table") == kinds.count("caption")
    drawings = [a for tag, a in reader.tags if tag == "svg" and a.get("role") == "img"]
    assert drawings
    assert all(len((a["aria-labelledby"] or "").split()) == 2 for a in drawings)
    assert all(a.get("scope") in ("col", "row") for tag, a in reader.tags if tag == "th")
    assert next(a for tag, a in reader.tags if tag == "html")["lang"] == "en"


def luminance(colour: str) -> float:
    full = colour[1:] if len(colour) == 7 else "".join(2 * c for c in colour[1:])
    channels = [int(full[i : i + 2], 16) / 255 for i in (0, 2, 4)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    a, b = sorted((luminance(one), luminance(other)))
    return (b + 0.05) / (a + 0.05)


@pytest.mark.parametrize("theme", [0, 1], ids=["light", "dark"])
def test_contrast_is_that_of_wcag_aa(theme: int) -> None:
    page = render(Sources())
    rules = re.findall(r":root\{([^}]*)\}", page)
    value = dict(re.findall(r"--(\w+):(#\w+)", rules[theme]))
    marks = ("good", "bad", "warn", "odd")
    pairs = [
        *((text, "bg") for text in ("fg", "soft", "link", *marks)),
        *((t, f"{t}bg") for t in marks),
        ("fg", "pane"),
    ]
    assert not [pair for pair in pairs if contrast(*map(value.get, pair)) < 4.5]
    assert contrast(value["guide"], value["bg"]) >= 3


def test_every_look_of_ours_is_read_on_light_and_on_dark() -> None:
    ours = [s.look for s in (*PAPER.values(), *EXTENSIONS.values()) if s.look is not None]
    for look in (*ours, *looks(["", *(f"stranger {n}" for n in range(11))]).values()):
        assert contrast(look.colour, "#ffffff") >= 3, look
        assert contrast(look.dark, "#0f1419") >= 3, look


def test_a_scheme_that_states_its_look_is_drawn_so_and_nothing_else_passes() -> None:
    own = {"colour": "#123456", "dark": "#ABCDEF", "marker": "h", "dash": "7 1"}
    data = comparison("mine")
    data["methods"][0]["look"] = own
    assert fault(data, schema("comparison")) == ""
    page = render(Sources(compare=[data]))
    assert ":#123456" in page
    assert ":#ABCDEF" in page
    for wrong in ({"colour": "red;}"}, {"marker": "$x$"}, {"dash": "url(x)"}):
        data["methods"][0]["look"] = own | wrong
        assert fault(data, schema("comparison"))
        with pytest.raises(UsageError, match=f"Look\\({next(iter(wrong))}"):
            Look(**(own | wrong))


def test_counterexamples_are_within_a_budget_and_the_rest_is_counted() -> None:
    report = verify_report("chatty", "m" * 1400)
    report["laws"] = [copy.deepcopy(report["laws"][0]) for _ in range(100)]
    page = render(Sources(verify=[report]))
    assert page.count("<pre class") < 100
    left = re.search(r"(\d+) more counterexamples in the JSON file", page)
    assert left
    assert int(left[1]) + page.count('<pre class="wrap"') == 100


def test_what_was_not_settled_is_explained_in_words() -> None:
    heavy = "p: 2 in [-3, 7] from 8192 paths\np, T = 1: rms error 4.34, 0.0872, 0.0417 with 8, 16, 32 steps"
    even = "p: 1 in [0.7, 1.3] from 256 paths\np, T = 1: rms error 0.4, 0.2, 0.1 with 8, 16, 32 steps"
    for message, runs_away in (
        (heavy, True),
        (even, False),
        ("rms error 1e, --, ..", False),
        (EVIL[0], False),
    ):
        page = render(Sources(verify=[verify_report("a", message, "inconclusive")]))
        words = " ".join(Reader(page).words)
        assert "What “inconclusive” means here" in words
        assert message.splitlines()[0] in words
        assert ("A few paths run away" in words) == runs_away
        assert {tag for tag, _ in Reader(page).tags} <= ALLOWED
    assert "What “inconclusive” means here" not in render(Sources(verify=[verify_report("a")]))


def test_the_projects_own_counters_are_on_the_page() -> None:
    page = render(load([ROOT / "benchmarks" / "counters.json"]))
    words = " ".join(Reader(page).words)
    assert "Work, as exact integers" in words
    assert "failed solves" in words


def test_the_committed_page_is_small_and_not_older_than_what_it_shows() -> None:
    """Where it fails: python -m benchmarks.page"""
    page = doc("report.html")
    reader = Reader(page)
    assert {tag for tag, _ in reader.tags} <= ALLOWED
    assert len(page.encode()) <= 600_000  # twelve schemes with a row a law, twenty-four pictures
    words = " ".join(reader.words)
    for expected in ("energy-preserving", "euler-maruyama", "Remark 2.1", "Lotka-Volterra: order"):
        assert expected in words
    made = re.search(r'<meta name="sepv-made-from" content="(\w+)">', page)
    assert made is not None
    assert made[1] == fingerprint(), "the laws or the schemes' claims have changed: python -m benchmarks.page"


def test_a_scheme_handed_over_as_an_object_gets_no_command_that_fails() -> None:
    page = render(Sources(verify=[verify_report("mine")]))
    assert "sepv verify mine" not in page
    assert "# the report of mine was written in Python" in page


def test_the_headline_counts_the_claims_and_names_those_that_break() -> None:
    good, bad = verify_report("fine", verdict="holds"), verify_report("broken")
    alone = render(Sources(verify=[bad]))
    assert "0 of 1 claimed law holds. Not shown to hold: energy." in alone
    assert "Schemes by laws" not in alone
    page = render(Sources(verify=[good, bad]))
    assert "Schemes by laws" in page
    assert "1 of 2 claimed laws holds; 1 of 2 schemes keeps all that it claims." in page
    assert "Not shown to hold: broken: energy." in page
    assert page.index("1 of 2 claimed laws hold") < page.index("<nav")
    silent = verify_report("silent")
    silent["laws"][0] |= {"claimed": False}
    page = render(Sources(verify=[good, silent]))
    kept = "1 of 1 claimed law holds; 1 of 1 scheme keeps all that it claims."
    assert f"{kept} Nothing is claimed of the other one." in page


def test_laws_stand_in_the_order_of_the_suite_and_link_to_what_they_say() -> None:
    report = verify_report("x")
    laws = ("weak-order", "own-law", "energy", "contract")
    report["laws"] = [report["laws"][0] | {"law": law} for law in laws]
    page = render(Sources(verify=[report, report]))
    heads = re.findall(r'class="law">(?:<a href="#law-[a-z-]+">)?([a-z-]+)', page)
    assert heads == ["contract", "energy", "weak-order", "own-law"]
    for anchor in re.findall(r'href="#(law-[a-z-]+)"', page):
        assert f'id="{anchor}"' in page


def test_a_price_picture_begins_where_steps_are_paid_for() -> None:
    seconds = {1: 1.0, 2: 1.01, 4: 1.05, 8: 1.7, 16: 3.3}
    points = [{"steps": n, "paths": 10, "seconds": {"median": s}} for n, s in seconds.items()]
    assert [p["steps"] for p in priced(points)] == [4, 8, 16]
    assert priced(points[:1]) == points[:1]
    assert [step_size(h) for h in (2.0**-4, 0.1, 1.0)] == ["2⁻⁴", "0.1", "1"]


def drawn(series: list[Series], x: Axis, y: Axis, **more: Any) -> str:
    return str(Pictures(s.scheme for s in series).draw(series, x, y, **more).inside)


def test_a_picture_leaves_out_what_cannot_be_drawn_and_keeps_spikes() -> None:
    n = 5000
    y: list[float | None] = [1.0] * n
    y[1234], y[2000], y[2001], y[3000] = 50.0, None, float("nan"), -1.0
    inside = drawn([Series("c", list(range(n)), y)], Axis("x"), Axis("y", log=True))
    (curve,) = re.findall(r'<path d="([^"]*)"[^>]*stroke-width="1.5"', inside)
    numbers = [float(v) for v in re.findall(r"-?[\d.]+", curve)]
    assert len(numbers) < 600
    assert min(numbers[1::2]) == pytest.approx(24, abs=3)  # the spike, 5 % below the top
    ticks = re.findall(r'text-anchor="end"[^>]*>([^<]*)<', inside)
    assert len(set(ticks)) == len(ticks) >= 2
    for nothing in ([], [Series("c", [None], [1.0])], [Series("c", [1.0], [-1.0])]):
        assert "<use" not in drawn(nothing, Axis("x"), Axis("y", log=True), slopes=[1.0])


def test_pictures_share_their_markers_and_curves_of_no_scheme_differ() -> None:
    pictures = Pictures(["midpoint"])
    series = [Series("a", [1.0, 2.0], [1.0, 3.0], "midpoint", "both")] * 2
    first, second = (pictures.draw(series, Axis("x"), Axis("y")) for _ in range(2))
    assert str(first.inside) == str(second.inside)
    assert str(pictures.definitions).count("<path") == 1
    assert first.samples[0][1] != first.samples[1][1]  # one scheme twice: other dashes
    alone = [Series(name, [1.0, 2.0], [1.0, 2.0]) for name in "abc"]
    assert len({str(sample) for _, sample in pictures.draw(alone, Axis("x"), Axis("y")).samples}) == 3


def test_a_page_without_pictures_needs_no_matplotlib(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert "one" in render(Sources(verify=[verify_report("one")]))
    with pytest.raises(UsageError, match=r"pip install 'sepv\[plots\]'"):
        render(Sources(compare=[comparison("m")]))


def test_every_scheme_of_the_paper_has_a_look_of_its_own_and_strangers_another() -> None:
    ours = looks(PAPER)
    assert all(ours[name] == scheme.look for name, scheme in PAPER.items())
    assert len({k.colour for k in ours.values()}) == len({k.marker for k in ours.values()}) == len(ours)
    names = [*PAPER, "numpy/midpoint", *(f"mod:step{n}" for n in range(30))]
    assert len(set(looks(names).values())) == len(names)
    assert looks(names) == looks(names)
    mine = Look("#123456", "#abcdef")
    assert looks(["mine"], {"mine": mine}) == {"mine": mine}
    first = looks(["stranger"])["stranger"]
    assert looks(["stranger", "mine"], {"mine": first})["stranger"].marker != first.marker


def test_a_browser_runs_nothing_of_it(tmp_path: Path) -> None:
    """Chromium's own reading of the hostile page: no element of a stranger, the title ours, the policy obeyed."""
    page = tmp_path / "page.html"
    command = [*chromium(tmp_path / "profile"), "--enable-logging=stderr", "--dump-dom", page.as_uri()]
    page.write_text(hostile_page(), encoding="utf-8")
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    dom = Reader(done.stdout)
    assert {tag for tag, _ in dom.tags} <= ALLOWED
    assert "<title>owned" not in done.stdout
    assert "Content Security Policy" not in done.stderr, "the page itself breaks its policy"
