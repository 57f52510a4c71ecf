"""Bundles: what is in one, what a changed one is told, and that it is measured again."""

from __future__ import annotations

import json
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import sepv
from sepv.commands._cli import main
from sepv.errors import TargetError, UsageError
from sepv.verification import Effort, bundle, consistent, verify
from sepv.verification._submission import MANIFEST, REPORT, Asked, again, environment, read, source

HEUN = """
import sepv
from sepv.problem import vector_field


def heun(problem, y, h, dW):
    f = lambda y: vector_field(problem, y)
    delta = problem.random_step(h, dW)
    return y + delta * (f(y) + f(y + delta * f(y))) / 2


scheme = sepv.Scheme("heun", heun, claims=["right-limit", "mean-square-order"], batched=True)
"""
FEW = Effort(examples=2, paths=256, shrink_checks=10)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Any]]:
    """A bundle of a module of its own, in a folder where it can be imported, and the scheme."""
    folder = tmp_path_factory.mktemp("submission")
    (folder / "heun_alone.py").write_text(HEUN)
    sys.path.insert(0, str(folder))
    asked = Asked("heun_alone:scheme", claims=("identity",))
    report = verify(asked.target, claims=asked.claims, effort=FEW)
    (folder / "heun.zip").write_bytes(bundle(report, asked))
    yield folder, report.scheme
    sys.path.remove(str(folder))
    del sys.modules["heun_alone"]


def changed(path: Path, into: Path, name: str, change: Callable[[Any], Any]) -> Path:
    """The bundle with one file changed, its hash as it was."""
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(into, "w") as new:
        for member in old.namelist():
            text = old.read(member).decode()
            new.writestr(member, json.dumps(change(json.loads(text))) if member == name else text)
    return into


def test_a_bundle_says_what_was_asked_of_what_with_which_versions(made: tuple[Path, Any]) -> None:
    found = read(made[0] / "heun.zip")
    assert found.asked == Asked("heun_alone:scheme", claims=("identity",))
    assert found.effort == FEW
    assert found.manifest["environment"] == environment()
    assert list(found.manifest["source"]) == ["heun_alone.py"]
    assert found.report["suite"]["seed"] == FEW.seed
    assert [o for o in consistent(found) if not o.right] == []


def test_it_is_measured_again_to_the_last_digit(made: tuple[Path, Any]) -> None:
    found = read(made[0] / "heun.zip")
    outcomes = list(again(found, made[1], share=0.1, seed=1))
    assert [o for o in outcomes if not o.right] == []
    assert "counterexample of energy" in {o.what for o in outcomes}
    assert sum(o.what.endswith("again") for o in outcomes) == 3  # a tenth of the laws, rounded up


def test_another_scheme_is_not_taken_for_it(made: tuple[Path, Any]) -> None:
    found = read(made[0] / "heun.zip")
    wrong = {
        o.what for o in again(found, sepv.schemes.by_name("midpoint"), share=0.01, seed=0) if not o.right
    }
    assert "counterexample of casimir" in wrong


def test_other_defects_are_seen_where_versions_are_the_same(made: tuple[Path, Any]) -> None:
    found = read(made[0] / "heun.zip")
    for law in found.report["laws"]:
        law["defect"] = 1e-300
    wrong = [o for o in again(found, made[1], share=0.01, seed=0) if not o.right]
    assert [o.what.endswith("again") for o in wrong] == [True]
    assert wrong[0].text.endswith("and not 1e-300")


def test_a_changed_source_is_seen(made: tuple[Path, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    found = read(made[0] / "heun.zip")
    monkeypatch.setitem(found.manifest["source"], "heun_alone.py", "0" * 64)
    first = next(again(found, made[1]))
    assert (first.what, first.right) == ("source of the scheme", False)


def test_a_changed_report_is_no_bundle(made: tuple[Path, Any], tmp_path: Path) -> None:
    bad = changed(made[0] / "heun.zip", tmp_path / "bad.zip", REPORT, lambda r: r | {"counts": {}})
    with pytest.raises(UsageError, match=r"other hashes of report\.json"):
        read(bad)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m: m | {"format": 2}, "manifest.json, .*format"),
        (lambda m: m | {"source": {"x": "no hash"}}, "manifest.json, .*source"),
        (lambda m: {k: v for k, v in m.items() if k != "asked"}, "'asked' is a required property"),
        (lambda m: m | {"files": {}}, "'report.json' is a required property"),
    ],
)
def test_a_wrong_manifest_is_no_bundle(
    made: tuple[Path, Any], tmp_path: Path, change: Callable[[Any], Any], words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        read(changed(made[0] / "heun.zip", tmp_path / "bad.zip", MANIFEST, change))


def test_a_level_that_does_not_follow_is_seen(made: tuple[Path, Any]) -> None:
    found = read(made[0] / "heun.zip")
    found.report["conformance"]["level"] = 3
    assert [o.what for o in consistent(found) if not o.right] == ["level"]


def test_files_that_are_no_bundles(tmp_path: Path) -> None:
    (tmp_path / "text.zip").write_text("no zip")
    with zipfile.ZipFile(tmp_path / "empty.zip", "w") as folder:
        folder.writestr("other.txt", "")
    for name in ("text.zip", "empty.zip", "missing.zip"):
        with pytest.raises(UsageError, match="a bundle of `sepv submit`, unchanged"):
            read(tmp_path / name)


def test_a_report_of_some_laws_is_not_submitted() -> None:
    report = verify("midpoint", laws=["identity"], effort=FEW)
    with pytest.raises(UsageError, match="a report of every law"):
        bundle(report, Asked("midpoint"))


def test_sources(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text("pass")
    assert list(source(Asked(program=f"python {program} --fast"))) == [str(program)]
    assert "sepv/schemes/_midpoint.py" in source(Asked("midpoint"))
    with pytest.raises(TargetError, match="no_such_module"):
        source(Asked("no_such_module:step"))


def test_a_scheme_of_the_current_folder_is_found(tmp_path: Path) -> None:
    """As `sepv` is typed: its own script's folder is the first of sys.path, and not the current one."""
    (tmp_path / "heun_here.py").write_text(HEUN)
    code = "import sys; sys.path[0] = '/'; from sepv.verification._submission import Asked, source; "
    code += "print(list(source(Asked('heun_here:scheme'))))"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.stdout.strip() == "['heun_here.py']", done.stderr


def test_the_commands(made: tuple[Path, Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    run = CliRunner().invoke
    path = str(made[0] / "heun.zip")
    right = run(main, ["check", path, "--share", "0.01", "--seed", "4"])
    assert right.exit_code == 0, right.output
    assert "schema and hashes are right" in right.output
    assert "as stated" in right.output.splitlines()[-1] or "as stated" in right.output
    assert run(main, ["check", str(tmp_path / "missing.zip")]).exit_code == 2
    assert run(main, ["submit", "--out", str(tmp_path / "x.zip")]).exit_code == 2
    assert run(main, ["submit", "no_such_module:step", "--out", str(tmp_path / "x.zip")]).exit_code == 3
    monkeypatch.delitem(sys.modules, "heun_alone")
    monkeypatch.setattr(sys, "path", [p for p in sys.path if p != str(made[0])])
    gone = run(main, ["check", path])
    assert gone.exit_code == 3
    assert "Nothing was measured again" in gone.output
