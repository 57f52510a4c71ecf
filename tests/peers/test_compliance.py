"""The compliance table of other libraries' solvers, the scripts that show deviations,
and the records of versions.
"""

import ast
import json
import os
import subprocess
import sys
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from doors import ROOT

from benchmarks.peers import changes as trend
from benchmarks.peers import compliance, deviations
from benchmarks.peers import compliance_measurements as measurements
from benchmarks.peers import one_release as peer
from benchmarks.peers import records as history
from benchmarks.peers.deviations import ScriptResult as Script
from benchmarks.peers.deviations import _notes
from benchmarks.peers.environments import VERSIONS
from benchmarks.peers.releases import main as releases
from benchmarks.peers.trend import main as trends
from benchmarks.peers.trend_page import page
from sepv import Scheme, TargetError, UsageError
from sepv.console import ShownProgress
from sepv.peers.peer import Peer, load
from sepv.verification import Effort, load_laws

DOCS = ROOT / "docs"
QUICK = Effort(examples=20, paths=256, shrink_checks=30)


OF_HEUN = {"energy": ("violated", False), "contract": ("holds", True)}


def _row(
    library: str = "lib", solver: str = "heun", verdicts: dict[str, tuple[str, bool]] = OF_HEUN
) -> measurements.Row:
    scheme = Scheme(f"{library} {solver}", lambda problem, y, h, dW: y, source="its manual")
    found = {law: {"verdict": v, "claimed": c, "message": ""} for law, (v, c) in verdicts.items()}
    return measurements.Row(library, scheme, found)


def energies(*rows: measurements.Row) -> dict[str, tuple[str, ...]]:
    return {row.scheme.name: ("5", "6") for row in rows}


def test_the_page_groups_solvers_by_their_verdicts_and_marks_what_is_contradicted(monkeypatch) -> None:
    marks = {
        "energy": ("violated", True), "symmetry": ("inconclusive", True), "casimir": ("holds", False),
        "truncation": ("not_applicable", False),
    }  # fmt: skip
    found = [_row(), _row(solver="twin"), _row("other", "box"), _row(solver="open", verdicts=marks)]
    monkeypatch.setattr(compliance, "release", lambda _library: "1.0")
    contradicted = [deviations.Deviation("lib heun", "### lib heun: no")]
    page = compliance.document(found, energies(*found), contradicted, "the command")
    lines = page.splitlines()
    assert "Not measured: reproducibility, identity, " in page
    assert "| lib heun †; twin; other box | 1 of 1 |  |" in lines
    assert "| lib open | 0 of 2; energy violated; symmetry open | casimir |" in lines
    assert "- pendulum: lib heun 6; other solvers 6 to 6" in lines
    assert "the command" in page
    assert "† The solver does less than documented, as [scripts without sepv](deviations.md) show." in lines


def absent(name: str) -> Peer:
    raise TargetError(expected=f"the library {name}", received=f"No module named {name!r}", remedy="pip")


def test_a_missing_library_is_left_out_and_said_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compliance, "rows", lambda *_: [_row()])
    monkeypatch.setattr(compliance, "energies", lambda *_: energies(_row()))
    monkeypatch.setattr(compliance, "release", lambda _library: "1.0")
    monkeypatch.setattr(compliance, "load", absent)
    result = CliRunner().invoke(compliance.main, ["--library", "torchsde"])
    assert result.exit_code == 0
    assert "torchsde left out" in result.stderr


def test_an_interrupted_table_goes_on_where_it_was_and_is_the_same(tmp_path, monkeypatch):
    laws = ("identity", "truncation", "mean-square-order")
    measured: list[str] = []
    original = measurements._finding

    def finding(scheme: Scheme, law: str, effort: Effort) -> dict[str, Any]:
        measured.append(law)
        if measured == ["identity", "truncation"]:
            raise KeyboardInterrupt
        return original(scheme, law, replace(effort, examples=3, paths=64))

    monkeypatch.setattr(compliance, "load", absent)
    monkeypatch.setattr(compliance, "LAWS", laws)
    monkeypatch.setattr(compliance, "load_laws", lambda: load_laws(laws))
    monkeypatch.setattr(measurements, "_finding", finding)
    keep, out = tmp_path / "kept", tmp_path / "table.md"
    arguments = ["--library", "sdeint", "--keep", str(keep), "--out", str(out)]

    stopped = CliRunner().invoke(compliance.main, arguments)
    assert (stopped.exit_code, out.exists()) == (130, False)
    assert f"interrupted: what was measured is in {keep}" in stopped.stderr
    assert CliRunner().invoke(compliance.main, arguments).exit_code == 0
    assert measured == ["identity", "truncation", "truncation", "mean-square-order"]
    first = out.read_text("utf-8")
    assert "| sepv energy-preserving | 2 of 3; mean-square-order open |  |" in first
    assert CliRunner().invoke(compliance.main, arguments).exit_code == 0
    assert len(measured) == 4
    assert out.read_text("utf-8") == first
    # Another seed is another measurement.
    assert CliRunner().invoke(compliance.main, [*arguments, "--seed", "1"]).exit_code == 0
    assert len(measured) == 7
    (file,) = keep.iterdir()
    file.write_text("[]")
    damaged = CliRunner().invoke(compliance.main, arguments)
    assert damaged.exit_code != 0
    assert "remove it" in damaged.stderr + str(damaged.exception)


def test_a_note_says_why_a_mark_is_not_what_it_seems() -> None:
    order = {"verdict": "violated", "message": "", "measured": [{"interval": [0.45, 0.6]}]}
    limit = {"verdict": "violated", "message": "wrong by 5 %", "measured": ()}
    message = "not measured:\ny = 0\nThe scheme raised.\nExpected\nRemedy"
    error = {"verdict": "error", "message": message, "measured": ()}
    scheme = Scheme("own", lambda problem, y, h, dW: y)
    found = list(
        compliance._notes(scheme, {"identity": error, "mean-square-order": order, "right-limit": limit})
    )
    assert found[0] == "own, identity: The scheme raised."
    assert found[1].startswith("own, right-limit: the error itself falls")
    order["measured"] = [{"interval": [-0.1, 0.2]}]  # the error stays: then it is a wrong limit
    assert not list(compliance._notes(scheme, {"mean-square-order": order, "right-limit": limit}))


NOTED = 'NOTES = [("README, 1.0", "2020-02-29", "order 1, not tested")]\n'


NO_NOTES = (
    "",
    "NOTES = []\n",
    'NOTES = [("README", "soon", "x")]\n',
    'NOTES = [("README", "2020-02-29", " ")]\n',
    "NOTES = 3\n",
)


@pytest.mark.parametrize("notes", NO_NOTES)
def test_nothing_is_published_without_what_the_library_itself_says(tmp_path: Path, notes: str) -> None:
    (tmp_path / "one.py").write_text(f'"""lib heun: statement."""\n{notes}raise SystemExit(1)\n')
    with pytest.raises(UsageError, match="what the library itself says"):
        deviations.deviations_shown_by(tmp_path)


def test_only_scripts_that_still_show_a_deviation_are_quoted(tmp_path: Path) -> None:
    for name, code in (("gone", 0), ("there", 1), ("broken", 2)):
        (tmp_path / f"{name}.py").write_text(
            f'"""lib {name}: statement.\n\nWhy.\n"""\n{NOTED}print("shown")\nraise SystemExit({code})\n'
        )
    (tmp_path / "crash.py").write_text(f'"""lib crash: statement."""\n{NOTED}raise ValueError\n')
    (found,) = deviations.deviations_shown_by(tmp_path)
    assert found.solver == "lib there"
    assert "### lib there: statement." in found.text
    assert found.text.index("README, 1.0, 2020-02-29: “order 1, not tested”") < found.text.index("Why.")
    assert "shown" in found.text


@pytest.mark.parametrize("script", sorted((DOCS / "peers").glob("*.py")), ids=lambda p: p.stem)
def test_every_script_is_quoted_on_the_page(script: Path) -> None:
    """Its statement, the library's own words, the measurement:
    on deviations.md or on integrator-deviations.md.
    """
    pages = {name: (DOCS / name).read_text("utf-8") for name in deviations.TITLES}
    (name,) = (name for name, text in pages.items() if f"peers/{script.name}) prints" in text)
    page = pages[name]
    tree = ast.parse(script.read_text("utf-8"))
    title, _, rest = (ast.get_docstring(tree) or "").partition("\n")
    output = page.partition(f"peers/{script.name}) prints")[2].split("```")[1].strip()
    body, notes = rest.split("Exit code 1")[0].strip(), _notes(script.name, tree)
    shown = Script(script.name, title, body, notes, 1, output, "")
    section = deviations.section(shown, "peers")
    assert section.removeprefix("#") in page
    assert deviations.Deviation(shown.solver, section).page == name


def test_a_script_shows_its_deviation_without_sepv() -> None:
    torchsde = pytest.importorskip("torchsde", reason="torchsde is not installed: the extra `peers`")
    if torchsde.__version__ != "0.2.6":
        pytest.skip(f"shown for torchsde 0.2.6, this is {torchsde.__version__}")
    script = DOCS / "peers" / "torchsde_milstein.py"
    assert subprocess.run([sys.executable, script], capture_output=True, check=False).returncode == 1


RESULTS = ROOT / "results"


def law(verdict: str, claimed: bool = True) -> dict[str, Any]:
    return {"verdict": verdict, "claimed": claimed, "defect": None, "bound": 1.0, "unit": "", "message": ""}


def record(version: str, limit: str = "holds", date: str = "2026-01-01", **changes: Any) -> dict[str, Any]:
    made: dict[str, Any] = {
        "format": 1, "library": "sdeint", "version": version, "date": date, "absent": [],
        "suite": {
            "version": "0.1.0", "laws_version": 1, "laws": ["right-limit"], "seed": 0, "examples": 12, "paths": 64,
        },
        "environment": {"python": "3.11.7", "machine": "x86_64", "packages": {"numpy": "2.0", "sdeint": version}},
        "solvers": [{
            "name": "heun", "source": "its manual", "mean_square_order": 1.0, "weak_order": None,
            "laws": {"right-limit": law(limit), "identity": law("violated", claimed=False)},
        }],
        "scripts": [{"name": "s.py", "title": "sdeint heun: no", "deviates": limit == "violated", "output": "x"}],
    }  # fmt: skip
    return {**made, **changes}


def written(folder: Path, *records: dict[str, Any]) -> list[history.ReleaseRecord]:
    for data in records:
        history.add(folder, data)
    return history.load(folder)["sdeint"]


def test_a_record_is_never_overwritten_and_a_second_one_has_its_date(tmp_path: Path) -> None:
    first = history.add(tmp_path, record("0.3.0"))
    before = first.read_bytes()
    second = history.add(tmp_path, record("0.3.0", "violated", "2026-02-02"))
    assert (first.name, second.name) == ("0.3.0.json", "0.3.0@2026-02-02.json")
    assert first.read_bytes() == before
    with pytest.raises(UsageError, match="never overwritten"):
        history.add(tmp_path, record("0.3.0", "violated", "2026-02-02"))
    assert history.recorded(tmp_path, "sdeint", "0.3.0") == [first, second]
    assert not history.recorded(tmp_path, "sdeint", "0.3")


def test_what_is_no_record_is_refused(tmp_path: Path) -> None:
    wrong = deepcopy(record("0.3.0"))
    wrong["solvers"][0]["laws"]["right-limit"]["verdict"] = "fine"
    with pytest.raises(UsageError, match=r"\$.solvers\[0\].laws"):
        history.add(tmp_path, wrong)
    with pytest.raises(UsageError, match="without any"):
        history.load(tmp_path)
    (tmp_path / "sdeint").mkdir()
    (tmp_path / "sdeint" / "0.1.json").write_text("{")
    with pytest.raises(UsageError, match="write it anew"):
        history.load(tmp_path)


def test_versions_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    names = ["0.10.0", "0.2.4", "0.9.0rc1", "0.9.0"]
    ordered = [r.version for r in written(tmp_path, *map(record, names))]
    assert ordered == ["0.2.4", "0.9.0rc1", "0.9.0", "0.10.0"]


def test_a_changed_verdict_is_named_with_its_version_and_with_what_else_changed(tmp_path: Path) -> None:
    other = record("0.3.0")
    other["environment"]["packages"]["numpy"] = "2.1"
    records = written(tmp_path, record("0.2.0"), record("0.2.4", "violated"), other)
    broke, mended = trend.changes(records)
    assert (broke.law, broke.since, broke.version) == ("right-limit", "0.2.0", "0.2.4")
    assert (broke.before, broke.after, broke.besides) == ("holds", "violated", ())
    assert (mended.version, mended.after, mended.besides) == ("0.3.0", "holds", ("numpy 2.0 → 2.1",))
    (deviation,) = trend.deviations(records)
    assert (deviation.seen, deviation.mended) == (("0.2.4",), "0.3.0")
    assert [trend.cell(r, "heun") for r in records] == ["holds", "violated: right-limit", "holds"]
    text = page({"sdeint": records})
    assert "| 0.2.4 | 0.2.0 | heun | *right-limit* | holds | violated | none |" in text
    assert "| [`s.py`](peers/s.py) | 0.2.4 | 0.3.0 |" in text


def test_a_lower_order_is_not_called_another_limit(tmp_path: Path) -> None:
    slow = record("0.3.0", "violated")
    slow["solvers"][0]["laws"]["mean-square-order"] = {**law("violated"), "defect": 0.55}
    records = written(tmp_path, record("0.2.4"), slow)
    assert "The error itself falls with h" in page({"sdeint": records})
    slow["solvers"][0]["laws"]["mean-square-order"]["defect"] = 0.01
    assert "The error itself falls" not in page({"sdeint": [history.ReleaseRecord(tmp_path, slow)]})


def test_a_deviation_that_comes_back_is_not_mended() -> None:
    assert trend._mended([("1", True), ("2", False), ("3", True)]) == ""
    assert trend._mended([("1", True), ("2", None), ("3", False), ("4", False)]) == "3"
    assert trend._mended([("1", False), ("2", False)]) == ""


def test_a_solver_that_came_is_a_change_of_the_whole(tmp_path: Path) -> None:
    more = record("0.3.0")
    more["solvers"].append({**deepcopy(more["solvers"][0]), "name": "srk"})
    (change,) = trend.changes(written(tmp_path, record("0.2.4"), more))
    assert (change.solver, change.law, change.before, change.after) == ("srk", "", "absent", "there")


def test_the_page_of_the_site_is_made_of_these_records() -> None:
    """Remade by: sepv trend results --out docs/trend.md."""
    assert (ROOT / "docs" / "trend.md").read_text(encoding="utf-8") == page(history.load(RESULTS))


def test_every_version_that_was_tried_is_recorded_with_at_least_two_of_each_library() -> None:
    found = {name: {r.version for r in records} for name, records in history.load(RESULTS).items()}
    assert {name: set(versions) for name, versions in VERSIONS.items()} == found
    assert all(len(versions) >= 2 for versions in found.values())


def test_no_record_has_an_address_or_a_path() -> None:
    for path in RESULTS.glob("*/*.json"):
        text = path.read_text(encoding="utf-8")
        assert "://" not in text, path
        assert "/site-packages/" not in text, path


def test_trend_prints_the_changes_and_writes_json(tmp_path: Path) -> None:
    written(tmp_path / "results", record("0.2.4"), record("0.3.0", "violated"))
    out = tmp_path / "trend.json"
    done = CliRunner().invoke(trends, [str(tmp_path / "results"), "-q", "--json", str(out)])
    assert done.exit_code == 0
    assert "sdeint 0.2.4 → 0.3.0: heun, right-limit: holds → violated" in done.stdout
    assert json.loads(out.read_text())["sdeint"]["versions"] == ["0.2.4", "0.3.0"]
    assert CliRunner().invoke(trends, [str(tmp_path / "none")]).exit_code == 2
    unknown = CliRunner().invoke(trends, [str(tmp_path / "results"), "--library", "torchsde"])
    assert unknown.exit_code == 2
    assert "measure it first" in unknown.stderr


def test_peers_lists_its_records_and_leaves_alone_what_is_recorded(tmp_path: Path) -> None:
    written(tmp_path, record("0.2.4"))
    listed = CliRunner().invoke(releases, ["--results", str(tmp_path)])
    assert (listed.exit_code, listed.stdout) == (0, "sdeint: 0.2.4\n")
    again = CliRunner().invoke(releases, ["sdeint", "0.2.4", "--results", str(tmp_path)])
    assert again.exit_code == 0
    assert "--again measures it once more" in again.stderr
    assert CliRunner().invoke(releases, ["numpy", "2.0"]).exit_code == 2


def test_a_version_that_cannot_be_installed_is_said_so_without_an_address(tmp_path, monkeypatch):
    """A program in uv's place that fails as uv does where it has no index, and prints an
    address.
    """
    uv = tmp_path / "uv"
    uv.write_text("#!/bin/sh\necho 'error: no solution found: https://index.example/sdeint/' >&2\nexit 1\n")
    uv.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    done = CliRunner().invoke(releases, ["sdeint", "0.0.1", "--results", str(tmp_path / "r")])
    assert done.exit_code == 3
    assert "sdeint==0.0.1 was not measured" in done.stderr
    assert "no solution found: …" in done.stderr
    assert "Remedy: uv needs an index" in done.stderr
    assert "://" not in done.stderr
    assert not (tmp_path / "r").exists()


def test_without_uv_the_remedy_is_its_installation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    done = CliRunner().invoke(releases, ["sdeint", "0.3.0", "--results", str(tmp_path)])
    assert done.exit_code == 3
    assert "Remedy: pip install uv" in done.stderr


def test_a_library_that_is_installed_here_is_recorded_as_the_schema_says(tmp_path, monkeypatch):
    sdeint = pytest.importorskip("sdeint", reason="sdeint is not installed")
    whole = load("sdeint")
    few = replace(whole, schemes={"strat-heun": whole.schemes["strat-heun"]})
    monkeypatch.setattr(peer, "load", lambda _library: few)
    monkeypatch.setattr(peer, "QUICK_LAWS", ("identity", "noise-sum", "local-mean"))
    found = peer.record("sdeint", Effort(examples=2, paths=64, shrink_checks=0), None, None, ShownProgress())
    path = history.add(tmp_path, found)
    (loaded,) = history.load(tmp_path)["sdeint"]
    assert (path.stem, loaded.version) == (sdeint.__version__, sdeint.__version__)
    entry = loaded.solvers["stratHeun"]
    seen = {name: said["verdict"] for name, said in entry["laws"].items()}
    assert seen == {"identity": "violated", "noise-sum": "holds", "local-mean": "holds"}
    assert trend.broken(entry) == {}  # identity is not claimed
    assert "numpy" in loaded.data["environment"]["packages"]
