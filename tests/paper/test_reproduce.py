"""The reproduction of the paper's figures, with verdicts that can fail,
and what does not hold as printed.
"""

import csv
import html
import io
import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from doors import command, doc, obeys
from sepv.properties import StrongErrors

from sepv import ensemble, exact_flow, problems, schemes
from sepv.paper import (
    errata,
    figure_4_3,
    figure_4_6,
    figures_4_1_and_4_2,
    figures_4_4_and_4_5,
    judge,
    order,
    runs,
)
from sepv.paper.errata import ENTRIES, Erratum, Evidence
from sepv.paper.record import FIGURE_HEIGHT, ORDER_OF_OURS, STATED_ORDERS, Size, draw, rms_points
from sepv.paper.suite import Reproduction, reproduce
from sepv.paper.suite import _run as run_jobs
from sepv.pictures import Axis, draw_curves, figure, looks, looks_of
from sepv.studies._energy_diffusion import energy_diffusion
from sepv.studies._energy_growth import judged

# The compiled engine has its own tests, and compiles longer than this computes.
TINY = Size(share=1e-3, engine="numpy")


@pytest.fixture(scope="module")
def rigid() -> Reproduction:
    return reproduce(["4.3", "text"], size=TINY, workers=1)


def verdicts(found: Reproduction, words: str) -> set[str]:
    return {s.verdict for s in found.statements if words in s.text}


def test_a_record_obeys_its_schema_and_holds_no_nan(rigid: Reproduction) -> None:
    data = json.loads(json.dumps(rigid.to_json(), allow_nan=False))
    obeys(data, "reproduction")
    assert [p["key"] for p in data["panels"]] == ["4.3-casimir", "4.3-hamiltonian", "4.3-order"]
    assert sum(data["counts"].values()) == len(rigid.statements)


def test_the_papers_statements_about_the_rigid_body(rigid: Reproduction) -> None:
    sentences = (
        "does not keep the Casimir", "energy-preserving scheme keeps the", "are one integrator", "C(y) = ‖y‖² and",
    )  # fmt: skip
    assert [verdicts(rigid, words) for words in sentences] == [{"holds"}] * 4


def test_the_csv_has_every_point(rigid: Reproduction) -> None:
    panel = rigid.panels[0]
    rows = list(csv.reader(io.StringIO(panel.to_csv())))
    assert rows[0] == ["series", "scheme", panel.x.label, panel.y.label, "±"]
    assert len(rows) == 1 + sum(len(s.x) for s in panel.series)
    first = panel.series[0]
    assert [float(v) for v in rows[1][2:4]] == [first.x[0], first.y[0]]


def test_the_numbers_do_not_depend_on_the_workers() -> None:
    jobs = [job for job in figure_4_3.jobs(TINY) if job.key[1] == "run"]
    done: list[tuple[float, float]] = []
    alone, together = (run_jobs(jobs, workers, lambda *p: done.append(p)) for workers in (1, 2))
    for job in jobs:
        assert np.array_equal(alone[job.key].y, together[job.key].y)
    assert all(0 <= part <= whole * (1 + 1e-12) for part, whole in done)
    assert done[-1][0] == pytest.approx(done[-1][1])


def test_a_broken_scheme_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Euler-Maruyama under the name of the energy-preserving scheme:
    nothing that the paper says of it holds then.
    """
    monkeypatch.setitem(schemes.PAPER, "energy-preserving", schemes.PAPER["euler-maruyama"])
    run = runs.long_run("energy-preserving", "rigid-body", h=0.01, steps=300, seed=0, engine="numpy")
    for what in ("energy", "Casimir"):
        found = runs.statement(replace(run, scheme="energy-preserving"), what, constant=True, source="")
        assert found.verdict == "fails"
    how: dict = {"T": 1.0, "steps": (32, 64, 128), "samples": 1024, "seed": 0, "engine": "numpy"}
    errors = {name: runs.errors(name, "rigid-body", **how) for name in ("energy-preserving", "midpoint")}
    assert order.same_statement("energy-preserving", "midpoint", errors, "", "").verdict == "fails"
    assert order.order_statement("energy-preserving", errors["energy-preserving"], "").verdict == "fails"
    assert order.order_statement("midpoint", errors["midpoint"], "").verdict == "holds"


def test_a_scheme_that_keeps_the_energy_refutes_that_it_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(schemes.PAPER, "milstein", schemes.energy_preserving)
    found = reproduce(["4.4"], size=Size(share=0.004, engine="numpy"), workers=1)
    assert verdicts(found, "Milstein does not keep the energy") == {"fails"}
    assert verdicts(found, "Euler-Heun does not keep the energy") == {"holds"}


def test_the_growth_of_the_oscillator_is_that_of_one_step() -> None:
    h, rng = 0.01, np.random.default_rng(0)
    problem = problems.harmonic_oscillator()
    y = np.repeat(np.array(problem.initial)[:, None], 200_000, axis=1)
    dW = 0.1 * rng.standard_normal((1, y.shape[1]))
    for name in ("euler-maruyama", "milstein", "euler-heun"):
        mean, variance = figures_4_1_and_4_2.growth_per_step(name, h)
        ln = np.log(problem.hamiltonian(schemes.PAPER[name].step(problem, y, h, dW)) / problem.hamiltonian(y))
        # Five standard errors of the mean: a false alarm in two million.
        assert abs(ln.mean() - mean) < 5 * np.sqrt(variance / ln.size)
        assert abs(ln.var() / variance - 1) < 0.05


def test_a_fine_step_reference_sees_no_error_at_its_own_step() -> None:
    steps, names = (8, 32, 128), ("midpoint", "milstein")
    setting = order.Setting("4.5", "pendulum", T=1.0, steps=steps, samples=128, schemes=names)
    jobs = order.fine_jobs(setting, Size(engine="numpy"))
    panel = order.fine_panel(setting, {job.key: job.function(**job.arguments) for job in jobs})
    seen = panel.numbers["midpoint"]["fine-step reference"]
    truth, problem = [], problems.pendulum()
    for steps in setting.steps:
        ends = ensemble("midpoint", problem, h=1.0 / steps, steps=steps, paths=128)
        exact = exact_flow(problem, problem.random_step(1.0, ends.W)).y
        truth.append(np.sqrt(np.mean(np.sum((ends.y - exact) ** 2, axis=0))))
    assert seen[-1] == 0
    assert panel.numbers["midpoint"]["exact reference"] == pytest.approx(truth)
    assert panel.statements[0].verdict == "fails"
    assert all(v > 0 for s in panel.series for v in s.y)  # what a logarithmic axis can show


def test_a_run_ends_where_its_sample_leaves_the_domain() -> None:
    how: dict = {"h": 2.0**-2, "steps": 64, "seed": 0, "samples": 4, "engine": "numpy"}
    run = runs.long_run("euler-maruyama", "lotka-volterra", **how)
    assert run.stopped > 0
    assert run.t[-1] == (run.stopped - 1) * run.h
    assert np.all(np.isfinite(run.y))


def test_settings_are_the_papers() -> None:
    first, order = figures_4_1_and_4_2.OSCILLATOR_RUNS, figures_4_1_and_4_2.OSCILLATOR_ORDER
    assert (first.steps, first.h, order.T, order.samples) == (10**5, 0.01, 5.0, 5000)
    body = figure_4_3.BODY_RUNS
    assert (body.steps, body.h, figure_4_3.BODY_ORDER.T) == (300, 0.01, 1.0)
    pendulum = figures_4_4_and_4_5.PENDULUM_RUNS
    assert (pendulum.steps * pendulum.h, pendulum.h) == (500.0, 2.0**-6)
    assert (figures_4_4_and_4_5.PENDULUM_ORDER.T, figures_4_4_and_4_5.PENDULUM_ORDER.samples) == (2.0, 1000)
    assert figures_4_4_and_4_5.PENDULUM_FINE.T / figures_4_4_and_4_5.PENDULUM_FINE.steps[-1] == 2.0**-12
    lotka = figure_4_6.LOTKA_VOLTERRA_RUNS
    assert (lotka.steps * lotka.h, lotka.h) == (5.0, 2.0**-8)


def test_figures_are_the_same_files_for_the_same_numbers(rigid: Reproduction, tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        svg, png, pdf = draw(rigid.panels[2], tmp_path / folder)
        assert pdf.read_bytes().startswith(b"%PDF")
        assert png.read_bytes().startswith(b"\x89PNG")
        assert "<svg" in svg.read_text()
    for name in ("4.3-order.svg", "4.3-order.png", "4.3-order.pdf"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_a_legend_of_long_labels_has_one_column_and_makes_the_figure_higher(
    rigid: Reproduction, tmp_path: Path
) -> None:
    panel = rigid.panels[2]
    assert len(panel.series) > 3
    for letters, rows in ((22, math.ceil(len(panel.series) / 2)), (23, len(panel.series))):
        named = [replace(s, name=s.name[:1].ljust(letters, "x")) for s in panel.series]
        svg, _, _ = draw(replace(panel, series=named), tmp_path)
        height = re.search(r'<svg [^>]*height="([\d.]+)pt"', svg.read_text())
        assert height is not None
        assert float(height[1]) == pytest.approx(72 * (FIGURE_HEIGHT + 0.14 * max(0, rows - 3)), abs=0.01)


def test_curves_have_one_order_in_all_legends_and_no_two_look_alike(rigid: Reproduction) -> None:
    errors = strong_errors_of(rows=3)
    fine = order.fine_panel(
        replace(figure_4_3.BODY_ORDER, steps=(8, 16, 32), schemes=("midpoint", "milstein")),
        {(figure_4_3.BODY_ORDER.figure, "fine", name): errors for name in ("midpoint", "milstein")}
        | {(figure_4_3.BODY_ORDER.figure, "fine", "truncated"): [0, 0, 0]},
    )
    for panel in (*rigid.panels, fine):
        names = [s.scheme for s in panel.series]
        assert names == sorted(names, key=(*STATED_ORDERS, *ORDER_OF_OURS).index)
        used = looks_of(panel.series, looks(s.look_key for s in panel.series))
        assert len({(look.colour, look.marker, look.dash) for look in used}) == len(panel.series)


def strong_errors_of(rows: int) -> StrongErrors:
    gaps = np.random.default_rng(0).normal(size=(rows, 3, 256)) / 8.0 ** np.arange(1, rows + 1)[:, None, None]
    return StrongErrors(1.0, (8, 16, 32)[:rows], np.sum(gaps**2, axis=1), gaps, (0,) * rows, 1.0)


def test_an_interval_of_an_rms_error_is_that_of_its_samples() -> None:
    """Normal errors with rms σ√3: the standard error of √mean(|e|²) over M samples is σ/√(2M)
    to first order.
    """
    curve = rms_points("x", [0.1], strong_errors_of(rows=1).squared, "milstein")
    assert curve.y[0] == pytest.approx(np.sqrt(3) / 8, rel=0.1)
    # Student's quantile for 31 degrees of freedom at 97.5 % is 2.04; a jackknife of 32 groups
    # scatters by an eighth.
    assert curve.half[0] == pytest.approx(2.04 / 8 / np.sqrt(512), rel=0.4)
    drawn = axes_with([curve])
    (bars,) = drawn.containers
    assert bars.has_yerr


def axes_with(series: list[Any]) -> Any:
    with figure(3.0, 3.0) as drawn:
        axes = drawn.add_subplot()
        draw_curves(
            axes, series, looks(s.look_key for s in series), Axis("h", log=True), Axis("error", log=True)
        )
        return axes


def test_the_command_writes_numbers_and_prints_verdicts(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = command("reproduce text --json paper.json -o out --no-figures")
    assert "fails 0 ≤ E[ξ² − ζ_h²] = " in result.stdout
    assert "\x1b" not in result.output
    obeys(json.loads(Path("paper.json").read_text()), "reproduction")
    assert sorted(p.name for p in tmp_path.rglob("*.json")) == ["paper.json", "reproduction.json"]


def test_verdicts_exclude_each_other_and_leave_room_between() -> None:
    decided = [judge.decide(*v) for v in ((True, False), (False, True), (False, False))]
    assert decided == ["holds", "fails", "open"]
    with pytest.raises(AssertionError):
        judge.decide(True, True)
    three = ["holds", "open", "fails"]
    assert [judge.at_most(v, 1, 3) for v in (1, 2, 4)] == three
    assert [judge.above(v, 3, 1) for v in (4, 2, 0)] == three
    assert [judge.near(v, 2, 0.25, 0.5) for v in (1.8, 2.4, 1.4)] == three
    assert [judge.interval_near(*v, 1, 0.25) for v in ((0.9, 1.2), (0.7, 1.2), (0.4, 0.7))] == three
    assert [judge.every("holds", v) for v in ("holds", "open", "fails")] == three
    assert judge.every("open", "fails") == "fails"
    unknown = float("nan")
    undecided = judge.at_most(unknown, 1, 3), judge.above(unknown, 3, 1), judge.near(unknown, 2, 0.25, 0.5)
    assert set(undecided) == {"open"}


def _walking(T: float, kind: str, seed: int) -> runs.SampledRun:
    """32 samples whose energy error is a random walk, or bounded:
    an oscillation of random amplitude and phase.
    """
    rng, h, samples = np.random.default_rng(seed), figures_4_4_and_4_5.PENDULUM_RUNS.h, 32
    steps = round(T / h)
    checkpoints = np.array([*(2**i for i in range(steps.bit_length()) if 2**i < steps), steps])
    if kind == "walk":
        widths = np.sqrt(np.diff(checkpoints, prepend=0))[:, None]
        error = 1e-4 * np.cumsum(widths * rng.standard_normal((checkpoints.size, samples)), axis=0)
    else:
        phase = rng.uniform(0, 2 * np.pi, samples)
        size = 1e-3 * np.abs(rng.standard_normal(samples))
        error = size * (np.cos(phase + checkpoints[:, None] * h) - np.cos(phase))
    start, none = -0.520014, np.empty(0)
    energies: tuple = (np.array([start]), none, checkpoints, start + error)
    return runs.SampledRun("midpoint", "pendulum", h, none, none, none, *energies, stopped=-1)


def test_a_short_run_does_not_say_whether_the_energy_walks() -> None:
    """By chance once in a thousand: of 40 runs of each kind none says the wrong thing,
    and short ones say nothing.
    """

    def said(T: float, kind: str) -> list[str]:
        return [figures_4_4_and_4_5._walk(_walking(T, kind, seed)).verdict for seed in range(40)]

    walks = said(500.0, "walk")
    assert set(walks) <= {"holds", "open"}
    assert walks.count("holds") >= 36
    assert set(said(500.0, "bounded")) <= {"fails", "open"}
    for T in (15.6, 7.0):
        assert {*said(T, "walk"), *said(T, "bounded")} == {"open"}


def test_a_quick_figure_4_4_refutes_nothing_that_the_paper_says(tmp_path: Path) -> None:
    """A share of 1/32 of the time, t ≤ 15.6: what it is too short for is open,
    and exponents of it decide nothing.
    """
    file = tmp_path / "quick.json"
    command(f"reproduce 4.4 --quick --engine numpy --workers 1 --json {file}")
    panels = json.loads(file.read_text())["panels"]
    found = {s["text"]: s for panel in panels for s in panel["statements"]}
    assert {s["verdict"] for s in found.values()} == {"holds", "open"}
    (walk,) = [s for text, s in found.items() if "not bounded" in text]
    assert walk["verdict"] == "open"
    assert "too short to tell" in walk["measured"]
    assert [s["verdict"] for text, s in found.items() if "symplecticity" in text] == ["open"]


def test_a_drift_that_symplecticity_does_not_leave_refutes_the_papers_sentence() -> None:
    """Made errors: the walk of theory, and a drift of that size, of another,
    or too small to be seen.
    """
    times, rng = 2.0 ** np.arange(10), np.random.default_rng(0)
    verdicts = {}
    theories = {
        h: energy_diffusion(schemes.midpoint, problems.pendulum(), h) for h in figures_4_4_and_4_5.MEAN_H
    }
    for case, drift, paths in (("theory", 1.0, 4000), ("another", 5.0, 4000), ("unseen", 1.0, 64)):
        found = {}
        for h, theory in theories.items():
            widths = np.sqrt(2 * theory.diffusion * np.diff(times, prepend=0))[:, None]
            walk = np.cumsum(widths * rng.standard_normal((times.size, paths)), axis=0)
            errors = walk + theory.offset + drift * theory.drift * times[:, None]
            found[h] = judged("midpoint", times, errors, rounding=0.0, derived=theory)
        verdicts[case] = " ".join(s.verdict for s in figures_4_4_and_4_5._mean(found).statements)
    assert verdicts == {"theory": "holds holds", "another": "fails holds", "unseen": "open open"}


def test_every_entry_is_refuted_by_its_evidence() -> None:
    assert {s.source: s.verdict for s in errata.statements()} == {e.place: "fails" for e in ENTRIES}


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda e: e.place)
def test_an_entry_quotes_its_sentence_with_its_neighbours(entry: Erratum) -> None:
    """Words before or after the formula that is decided on, and each field filled in."""
    assert all(getattr(entry, name) for name in ("printed", "criterion", "hypotheses", "right", "command"))
    words = re.findall(r"[A-Za-z]{2,}", re.sub(r"`[^`]*`", "", entry.quote))
    assert len(words) >= 15


def test_no_verdict_is_written_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """An entry whose evidence holds, or decides nothing, is not shown as an erratum."""
    held = replace(ENTRIES[0], evidence=lambda: Evidence(True, False, "equal"))
    open_ = replace(ENTRIES[1], evidence=lambda: Evidence(False, False, "not decided"))
    monkeypatch.setattr(errata, "ENTRIES", (held, open_, ENTRIES[2]))
    assert [entry.place for entry, _ in errata.errata()] == [ENTRIES[2].place]
    assert [s.verdict for s in errata.statements()] == ["holds", "open", "fails"]


def test_the_page_shows_what_is_computed() -> None:
    assert doc("errata.md") == command("reproduce --errata").output, (
        "sepv reproduce --errata > docs/errata.md"
    )


def test_pictures_of_fine_step_references_are_named_like_the_others() -> None:
    titles = re.findall(r"<h3>(.*?: what a fine-step reference hides)</h3>", doc("report.html"))
    assert [title.partition(":")[0] for title in titles] == ["Oscillator", "Pendulum", "Lotka-Volterra"]


def test_the_committed_report_refutes_nothing_of_the_paper_but_the_errata() -> None:
    """What is not the paper's says "(ours)". Where it fails: python -m benchmarks.page"""
    refuted = [html.unescape(t) for t in re.findall(r"does not hold</span> (.*?) <span", doc("report.html"))]
    assert refuted
    assert {text for text in refuted if not text.startswith("(ours)")} <= {e.printed for e in ENTRIES}
