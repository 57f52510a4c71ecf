"""The HTML page, of many schemes and of one: complete, accessible, small,
inert whatever strangers put into files.
"""

import base64
import copy
import hashlib
import html
import json
import re
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from doors import ROOT, chromium, command, doc
from drawn import refusing
from hypothesis import strategies as st
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

import sepv
from sepv import Effort, UsageError, exact_flow
from sepv.commands._cli import main
from sepv.files import fault, made, schema
from sepv.page import Sources, _text, changes, load, render
from sepv.page._pictures import Pictures
from sepv.page._render import fingerprint
from sepv.page._verdicts import _scale
from sepv.page._views import priced, step_size
from sepv.pictures import Axis, Series, looks
from sepv.schemes import EXTENSIONS, PAPER, Look
from sepv.verification._course import COURSE_STEPS, EXACT_POINTS_PER_STEP, course, with_courses


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
    for message in (heavy, "rms error 1e, --, ..", EVIL[0]):
        page = render(Sources(verify=[verify_report("a", message, "inconclusive")]))
        words = " ".join(Reader(page).words)
        assert "What “inconclusive” means here" in words
        assert message.splitlines()[0] in words
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


def test_long_numbers_of_an_axis_do_not_touch_its_name() -> None:
    """The name is centred at x = 14 - 3; a digit of 12 points is at least 7 wide."""
    for low, high, longest in ((-0.5205, -0.5185, 7), (0.0, 1.0, 3)):
        inside = drawn([Series("c", [0.0, 1.0], [low, high])], Axis("x"), Axis("H"))
        numbers = re.findall(r'<text x="([\d.]+)"[^>]*text-anchor="end"[^>]*>([^<]*)<', inside)
        assert max(len(words) for _, words in numbers) == longest
        assert all(float(x) - 7 * len(words) > 22 for x, words in numbers)


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
    assert str(pictures.definitions).count("<path") == 2  # two markers
    assert first.samples[0][1] != first.samples[1][1]  # one scheme twice: other dashes and markers
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
    """Chromium's own reading of the hostile page: no element of a stranger, the title ours,
    the policy obeyed.
    """
    page = tmp_path / "page.html"
    command = [*chromium(tmp_path / "profile"), "--enable-logging=stderr", "--dump-dom", page.as_uri()]
    page.write_text(hostile_page(), encoding="utf-8")
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    dom = Reader(done.stdout)
    assert {tag for tag, _ in dom.tags} <= ALLOWED
    assert "<title>owned" not in done.stdout
    assert "Content Security Policy" not in done.stderr, "the page itself breaks its policy"


FEW = Effort(examples=2, paths=64)


@pytest.fixture(scope="module")
def report() -> sepv.Report:
    return sepv.verify("midpoint", laws="energy,casimir,truncation", effort=FEW)


def test_the_command_writes_the_page_that_its_json_makes(reader: Any) -> None:
    reader.sepv("sepv verify midpoint --law energy,identity --examples 2 --json r.json --html r.html")
    reader.sepv("sepv report r.json --out again.html")
    pages = [(reader.folder / name).read_text() for name in ("r.html", "again.html")]
    assert pages[0] == pages[1]
    words = html.unescape(pages[0])
    assert "<h1>midpoint: which structural properties hold?</h1>" in words
    assert "H(y1) − H(y0) = " in words
    assert "sepv verify midpoint --law energy --replay" in words
    assert "sepv verify midpoint --law energy,identity --examples 2 --json r.json --html r.html" in words
    assert re.search(r"sepv [\d.]+, python .*, numpy .*; seed 0, 2 examples, 8192 paths at most", words)


def test_a_course_begins_with_the_counterexample_beside_the_exact_solution(report: sepv.Report) -> None:
    (law,) = (f for f in with_courses(report)["laws"] if "course" in f)
    assert law["law"] == "energy"
    assert fault(with_courses(report), schema("report")) == ""
    found, case = law["course"], sepv.verification.Case
    assert [len(c) for c in found["states"]] == [COURSE_STEPS + 1] * 2
    assert [len(c) for c in found["exact"]] == [EXACT_POINTS_PER_STEP * COURSE_STEPS + 1] * 2
    witness, message = report.finding("energy").witness, report.finding("energy").message
    assert witness is not None
    from sepv.law.cases.case import from_json

    case = from_json(witness)
    problem, y, h, dW = case.build()
    y1 = sepv.schemes.midpoint.step(problem, y, h, dW)
    one = [found["components"][k] - 1 for k in (0, 1)]
    assert [c[1] for c in found["states"]] == pytest.approx(y1[one], rel=1e-4)
    moved = re.search(r"step (\d): H\(y1\) − H\(y0\) = (\S+),", message)
    assert moved is not None
    n, drift = int(moved[1]), found["drift"]
    assert drift[n] - drift[n - 1] == pytest.approx(float(moved[2]), rel=1e-3)
    theta = float(problem.random_step(h, dW)) * COURSE_STEPS
    end = exact_flow(problem, [theta], y).y[one, 0]
    assert [c[-1] for c in found["exact"]] == pytest.approx(end, rel=1e-4)


def test_a_law_that_keeps_no_invariant_draws_its_own_defect_above_its_bound() -> None:
    """A picture of H says nothing of symmetry, nor of the distance from the midpoint rule."""
    report = _of_heun("symmetry,midpoint")
    for law in with_courses(report)["laws"]:
        found = law["course"]
        assert len(found["defects"]) == len(found["bounds"]) == len(found["states"][0])
        assert found["defects"][0] == pytest.approx(law["defect"], rel=1e-4)
        assert found["defects"][0] > found["bounds"][0]
    words = report.html()
    assert "defect in ulp of y" in words
    assert "H(y) − H(y₀)" not in words
    (energy,) = with_courses(_of_heun("energy"))["laws"]
    assert "defects" not in energy["course"]
    assert_the_longest_numbers_fit_beside(words)


def assert_the_longest_numbers_fit_beside(page: str) -> None:
    """A sign of 12 px is at most 8 px wide; `number` makes nine, as in −2.55e+04."""
    assert len(_text.number(-25512.0)) == len(_text.number(-1.25e-300)) == 9
    panels = re.findall(r'<svg viewBox="(\S+) 0 \S+ 190".*?</svg>', page, re.DOTALL)
    assert len(panels) == 4
    texts = re.findall(r'<text class="soft" x="(\d+)" y="\d+" text-anchor="end">', page)
    for left in map(float, panels):
        assert min(map(float, texts)) - 9 * 8 >= left


def _of_heun(laws: str) -> sepv.Report:
    def heun(problem: Any, y: Any, h: float, dW: Any) -> Any:
        delta, f = float(problem.random_step(h, dW)), lambda z: problem.structure(z) @ problem.gradient(z)
        return y + 0.5 * delta * (f(y) + f(y + delta * f(y)))

    return sepv.verify(heun, laws=laws, effort=FEW)


def _on_energy(step: Any, report: sepv.Report) -> dict[str, Any]:
    return course(sepv.Scheme("own", step), report.finding("energy"))


def test_a_course_ends_where_the_scheme_does(report: sepv.Report) -> None:
    def raises_later(problem: Any, y: Any, h: float, dW: Any) -> Any:
        if np.linalg.norm(y) > 3:
            raise RuntimeError("too far")
        return 1.5 * y

    found = _on_energy(raises_later, report)
    assert "RuntimeError: too far" in found["ended"]
    assert 2 < len(found["drift"]) <= COURSE_STEPS
    assert _on_energy(lambda problem, y, h, dW: 7 * y, report)["ended"] == "it runs away"
    assert _on_energy(lambda problem, y, h, dW: y, report) == {}  # nothing moves: no picture
    law = with_courses(replace(report, scheme=sepv.Scheme("own", lambda problem, y, h, dW: y)))["laws"][0]
    assert "course" not in law


def test_a_course_that_cannot_be_drawn_is_left_out(report, monkeypatch):
    def pendulum(H: Any = None) -> sepv.Problem:
        known = sepv.problems.pendulum()
        return replace(known, data=None, name="own", hamiltonian=H or known.hamiltonian, check=False)

    drawn = sepv.verify("midpoint", laws="energy", problems=st.builds(pendulum), effort=FEW)
    assert drawn.finding("energy").verdict is sepv.Verdict.VIOLATED
    assert "course" not in with_courses(drawn)["laws"][0]  # no words name its problem
    assert "H(y1) − H(y0)" in drawn.html()
    monkeypatch.setattr("sepv.verification._course.invariants", lambda *_: 1 / 0)
    assert all("course" not in law for law in with_courses(report)["laws"])


def test_courses_take_no_longer_than_their_time(report: sepv.Report, monkeypatch: pytest.MonkeyPatch) -> None:
    def sleeps(problem: Any, y: Any, h: float, dW: Any) -> Any:
        time.sleep(0.1)
        return 1.01 * y

    slow = replace(report, scheme=sepv.Scheme("slow", sleeps))
    monkeypatch.setattr("sepv.verification._course.COURSES_MAX_SECONDS", 0.9)
    (found,) = (law["course"] for law in with_courses(slow)["laws"] if "course" in law)
    assert found["ended"] == "the time for all courses, 0.9 s, was over"
    assert 2 <= len(found["drift"]) < COURSE_STEPS
    assert not any("course" in law for law in with_courses(replace(slow, interrupted=True))["laws"])


def test_ctrl_c_while_courses_are_made_leaves_the_files(reader: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("sepv.verification._course.with_courses", interrupted)
    words = "verify midpoint --law energy --examples 2 -q --json r.json --html r.html"
    done = CliRunner().invoke(main, words.split())
    assert done.exit_code == 130
    assert "energy" in (reader.folder / "r.html").read_text()
    assert (reader.folder / "r.json").exists()


def test_a_law_of_casimirs_draws_the_casimir_that_moves_most() -> None:
    report = sepv.verify("euler-maruyama", laws="casimir", problems="rigid-body", effort=FEW)
    found = with_courses(report)["laws"][0]["course"]
    assert found["kept"] == "C"
    assert abs(found["drift"][1]) > 1e-6
    assert "C(y) − C(y₀)" in report.html()


def law(
    defect: float | None, bound: float | None, at_least: bool = False, verdict: str = "violated"
) -> dict[str, Any]:
    return {"defect": defect, "bound": bound, "at_least": at_least, "verdict": verdict}


def test_the_scale_has_the_bound_at_one_place_and_the_wrong_side_at_the_right() -> None:
    laws = [
        law(48.0, 48.0),
        law(1.0, 10.0),
        law(2e9, 2.0),
        law(0.5, 1.0, True),
        law(2.0, 1.0, True),
        law(0.0, 0.0),
    ]
    place, ticks = _scale(laws)
    bound = float({words: x for x, words in ticks}["bound"])
    places = [float(place(v)) for v in laws]
    assert places[0] == bound
    assert places[1] < bound < places[2] <= float(ticks[-1][0])
    assert places[4] < bound < places[3]
    assert places[5] == 5
    assert float(place(law(None, 1.0))) == 95  # not finite
    assert float(place(law(1.0, 0.0))) == 95
    assert place(law(None, None, verdict="not_applicable")) is None
    assert [words for _, words in ticks] == ["10⁻³", "bound", "10³", "10⁶", "10⁹"]
    assert _scale([law(None, None, verdict="error")])[1] == []


def test_an_error_of_all_laws_is_one_entry() -> None:
    page = sepv.verify(refusing(RuntimeError("no luck")), laws="contract,energy,casimir", effort=FEW).html()
    assert page.count("The scheme raised RuntimeError: no luck") == 1
    assert "the same error in 2 other laws" in page


def test_a_share_and_memory_are_said_as_the_table_says_them(report: sepv.Report) -> None:
    held, violated = report.finding("casimir"), report.finding("energy")
    partly = replace(report, findings=(replace(held, share=0.719), replace(violated, afresh="holds")))
    page = partly.html()
    for words in ("holds on 71 %", "depends on earlier calls"):
        assert words in page
        assert words in str(partly)


def test_two_reports_of_one_scheme_show_what_changed(tmp_path: Path) -> None:
    """A scheme whose energy breaks between two runs, under one name;
    a third report equals the second.
    """
    few = sepv.Effort(examples=2, shrink_checks=5)
    laws = "energy,casimir,truncation"

    def reported(step: Any, file: str) -> str:
        scheme = sepv.Scheme("mine", step, claims=["energy"])
        data = {"made": made("report")} | sepv.verify(scheme, laws=laws, effort=few).to_json()
        (tmp_path / file).write_text(json.dumps(data))
        return str(tmp_path / file)

    right, wrong = sepv.schemes.energy_preserving.step, sepv.schemes.midpoint.step
    files = [reported(right, "before.json"), reported(wrong, "after.json"), reported(wrong, "again.json")]
    first, second = changes(load(files).verify)
    assert second == ("mine", [])
    rows = {law: (before, after) for law, before, after in first[1]}
    assert rows["energy"][0].startswith("holds, ")
    assert rows["energy"][1].startswith("violated, ")
    assert rows["energy"][1].endswith("ulp of H, claimed")
    assert "truncation" not in rows
    page = tmp_path / "page.html"
    shown = command(f"report {files[0]} {files[1]} --out {page}", COLUMNS="120").output
    assert "mine: what changed" in shown
    assert rows["energy"][1] in " ".join(shown.split())
    assert rows["energy"][1] in page.read_text(encoding="utf-8")
    assert "nothing changed" in command(f"report {files[1]} {files[2]} --out {page}").output
    assert changes(load(files[:1]).verify) == []


def test_results_for_asv_are_of_the_commit_and_keep_those_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The layout that asv 0.6 reads: one row of columns for each benchmark,
    with a version of its parameters.
    """
    report = sepv.verify("midpoint", laws="energy,truncation", effort=Effort(examples=2, shrink_checks=5))
    (tmp_path / "r.json").write_text(json.dumps({"made": made("report")} | report.to_json()))
    monkeypatch.chdir(tmp_path)
    assert "git repository" in command("report r.json --asv asv", 2).stderr
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-c", "init.defaultBranch=main"]
    commits = []
    for number in range(2):
        for words in ("init -q .", f"commit -q --allow-empty -m {number}"):
            subprocess.run([*git, *words.split()], check=True)
        done = subprocess.run([*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True)
        commits.append(done.stdout.strip())
        assert "2 numbers for asv" in command("report r.json --asv asv").output
    listed = json.loads((tmp_path / "asv" / "benchmarks.json").read_text())
    assert listed.pop("version") == 2
    results = [json.loads(p.read_text()) for p in (tmp_path / "asv").glob("*/*-sepv-*.json")]
    assert {data["commit_hash"] for data in results} == {*commits}
    for data in results:
        row = dict(zip(data["result_columns"], data["results"]["midpoint.energy"], strict=True))
        assert row["result"] == [report.finding("energy").defect]
        assert row["version"] == listed["midpoint.energy"]["version"]
        assert set(data["results"]) == set(listed) == {"midpoint.energy", "midpoint.truncation"}
