"""Each replay that is printed replays, and reports are measured again:
a hostile file runs nothing and costs little.
"""

import copy
import json
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import pytest
from doors import Reader, command
from drawn import euler
from hypothesis import strategies as st
from sepv.properties._problems_of import problems_of

import sepv
from sepv.errors import UsageError
from sepv.files import made, write_json
from sepv.law.cases.users_problems import items
from sepv.page._views import again
from sepv.verification import Effort, Verdict, _against, against, junit_xml, read_report

FEW = Effort(examples=2, paths=256, shrink_checks=10)
COMMAND = re.compile(r"sepv verify .*--law energy .*")


def measured(scheme: Any, problems: Any = None) -> sepv.Report:
    return sepv.verify(scheme, laws="energy", problems=problems, effort=FEW)


def own_problem(name: str = "own") -> sepv.Problem:
    """A pendulum that is not known by its data."""
    return replace(sepv.problems.pendulum(), name=name, data=None)


def renamed(step: Any) -> Any:
    """The same function under a name that no import finds."""
    return lambda problem, y, h, dW: step(problem, y, h, dW)  # noqa: PLW0108  (another name is the point)


@pytest.mark.parametrize(
    ("scheme", "problems"),
    [(renamed(euler), None), (euler, own_problem()), ("midpoint", [own_problem(), own_problem("another")])],
    ids=["a function", "a problem", "two problems"],
)
def test_what_was_handed_over_as_an_object_is_replayed_by_its_report(scheme: Any, problems: Any) -> None:
    report = measured(scheme, problems)
    assert 'report.replay("energy")' in str(report)
    assert "sepv verify" not in str(report)
    again = report.replay("energy")
    assert again.verdict is Verdict.VIOLATED
    assert again.defect == report.finding("energy").defect


def test_the_problem_of_a_strategy_has_no_name_and_a_token_says_so() -> None:
    report = measured("midpoint", st.builds(own_problem))
    with pytest.raises(sepv.UsageError, match="handed over as an object"):
        report.replay("energy")


def test_a_named_scheme_and_problem_are_replayed_by_the_command_in_every_output(reader: Reader) -> None:
    report = measured("midpoint", "pendulum")
    for text in (str(report), report.html(), junit_xml(report)):
        (command,) = COMMAND.findall(unescape(text).replace("</", "\n"))
        assert "energy violated" in reader.sepv(f"{command}  # red")
        assert "H(y1) − H(y0) = " in text


def test_a_pin_keeps_what_the_scheme_is_for(reader: Reader) -> None:
    reader.sepv("sepv verify midpoint -p pendulum --law energy,casimir --examples 2 --pin pin.toml")
    assert 'problems = ["pendulum"]' in (reader.folder / "pin.toml").read_text()
    asked = "sepv verify midpoint --law energy,casimir --examples 2"
    held = reader.sepv(f"{asked} --expected pin.toml --json r.json")
    assert "The pin is about" not in held
    assert '"target": "midpoint -p pendulum"' in (reader.folder / "r.json").read_text()
    other = reader.sepv("sepv verify midpoint -p rigid-body --law energy,casimir --expected pin.toml")
    assert "The pin is about pendulum, and this run about rigid-body." in other


def test_a_problem_of_a_family_that_is_named_too_is_measured_once() -> None:
    scheme = replace(sepv.schemes.midpoint, problems=items(["canonical-separable", "pendulum", "pendulum"]))
    assert [p.name for p in problems_of(scheme) or ()] == ["harmonic-oscillator", "pendulum"]


def test_the_page_has_the_commands_that_made_its_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = [
        "compare midpoint --problem rigid-body --steps 4,8 --paths 32 --repeats 1 --seed 3 --json 'my file.json'",
        "bench midpoint --case rigid-body --save bench.json",
        "verify midpoint --law energy --examples 3 --seed 5 --json laws.json",
    ]
    for line in (*lines, "report 'my file.json' bench.json laws.json"):
        command(line)
    page = unescape((tmp_path / "report.html").read_text(encoding="utf-8"))
    for line in lines:
        assert f"\nsepv {line}\n" in page.replace(">sepv verify", "\nsepv verify")


def test_a_file_made_by_python_m_has_the_same_command(tmp_path: Path) -> None:
    line = ["verify", "midpoint", "--law", "identity", "--examples", "2", "-q", "--json", "r.json"]
    subprocess.run([sys.executable, "-m", "sepv", *line], cwd=tmp_path, check=True, capture_output=True)
    made = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))
    assert again(made, "it") == f"sepv {' '.join(line)}"


def test_a_command_of_a_file_is_quoted_anew_and_is_of_sepv() -> None:
    made = {"made": {"command": "sepv report x.json; touch y"}}
    assert again(made, "it") == "sepv report 'x.json;' touch y"
    for line in ("touch y", "sepv 'open", "", None):
        assert again({"made": {"command": line}}, "it").startswith("# it was written in Python")
    assert again({}, "it").startswith("#")


EVIL = "\x1b]0;title\x07\x1b[31m"
MIDPOINT = sepv.schemes.by_name("midpoint")


@pytest.fixture(scope="module")
def report() -> dict[str, Any]:
    """Energy violated with its witness, rounding with paths, identity holding; as a file has it."""
    found = sepv.verify("midpoint", laws="identity,energy,rounding", effort=FEW).to_json()
    return {"made": made("report"), **json.loads(json.dumps(found))}


def law(report: dict[str, Any], name: str) -> dict[str, Any]:
    return next(f for f in report["laws"] if f["law"] == name)


def test_a_report_is_seen_again_to_the_last_digit(report: dict[str, Any], tmp_path: Path) -> None:
    file = str(tmp_path / "r.json")
    write_json(file, "report", {key: value for key, value in report.items() if key != "made"})
    seen = list(against(read_report(file), MIDPOINT, FEW, laws=["energy", "identity"]))
    assert [a.what for a in seen[1:]] == [
        "counterexample of energy", "counterexample of rounding", "identity", "energy",
    ]  # fmt: skip
    assert not any(a.differs for a in seen)


def test_another_scheme_is_not_taken_for_it(report: dict[str, Any]) -> None:
    other = sepv.schemes.by_name("energy-preserving")
    wrong = {a.what: a.differs for a in against(report, other, FEW, laws=["energy"]) if a.differs}
    assert wrong["energy"] == wrong["counterexample of energy"] == "reported violated"
    higher = copy.deepcopy(report)
    higher["scheme"]["mean_square_order"] = 2.0
    first = next(against(higher, MIDPOINT, FEW))
    assert first.differs == "mean_square_order 1.0, reported 2.0"


@pytest.mark.parametrize("other", [*_against._BITS, "effort", "none"])
def test_defects_are_compared_only_where_bits_can_be_the_same(report: dict[str, Any], other: str) -> None:
    changed = copy.deepcopy(report)
    changed["laws"] = [law(changed, "identity") | {"defect": 1e-300}]
    if other == "effort":
        changed["suite"]["examples"] = 5  # cut to what the reader allows
    elif other != "none":
        changed["made"][other] = "another"
    (seen,) = [a for a in against(changed, MIDPOINT, FEW, laws=["identity"]) if a.what == "identity"]
    assert ("reported 1e-300" in seen.differs) == (other == "none")


def test_without_laws_a_random_share_is_measured() -> None:
    held = sepv.verify("midpoint", laws="identity,noise-sum,truncation", effort=FEW).to_json() | {
        "made": made("report")
    }
    drawn = {tuple(a.what for a in against(held, MIDPOINT, FEW))[1:] for _ in range(14)}
    # One of three: that 14 draws are all the same has probability 3^-13 = 6e-7.
    assert len(drawn) > 1
    assert all(len(names) == 1 for names in drawn)


def setting(*path: Any) -> Callable[[dict[str, Any]], None]:
    """A change of a report: keys, then the value; a law goes by its name."""

    def change(report: dict[str, Any]) -> None:
        *keys, last, value = path
        for key in keys:
            report = law({"laws": report}, key) if isinstance(report, list) else report[key]
        report[last] = value

    return change


WITNESS = ("laws", "energy", "witness")
PATHS = ("laws", "rounding", "witness")
CODE = {"given": "imported_by_a_file:problem", "noise": ["0x1p-1"]}
# What a file may do, with the exit code: 1 is a difference that is said, 2 a file that is refused;
# and how the page refuses it.
HOSTILE = {
    "a command as target": (setting("scheme", "target", "--exec 'touch ran'"), 0),
    "code as problem": (setting(*WITNESS, "problem", CODE), 1),
    "code with an escape": (setting(*WITNESS, "problem", CODE | {"given": f"{EVIL}:p"}), 1),
    "a batch without end": (setting(*WITNESS, "batch", 10**12), 1),
    "many dimensions": (setting(*WITNESS, "problem", "dimension", 10**9), 1),
    "an escape as state": (setting(*WITNESS, "y", [EVIL]), 1),
    "a number beyond binary64": (setting(*WITNESS, "h", "0x1p+999999"), 1),
    "no witness at all": (setting("laws", "energy", "witness", {}), 1),
    "paths without end": (setting(*PATHS, "paths", 10**12), 1),
    "a seed of text": (setting(*PATHS, "seed", EVIL), 1),
    "effort without end": (setting("suite", "shrink_checks", 10**12), 0),
    "an escape as message": (setting("laws", "energy", "message", EVIL), 0),
    "an escape as law": (setting("laws", "energy", "law", EVIL), 2),
    "an escape as key": (setting(EVIL, 1), 2),
    "an escape as profile": (setting("profiles", "not_found", {EVIL: 1}), 2),
    "counts of its own": (setting("counts", "holds", 27), 2),
    "another suite": (setting("suite", "laws_version", 99), 2),
    "no suite": (lambda report: report["suite"].pop("laws_version"), 2),
    "a law twice": (lambda report: report["laws"].append(report["laws"][0]), 2),
    "a later version": (setting("made", "version", 99), 2, "version 99"),
    "a great number": (setting("laws", "energy", "defect", 10**400), 2),
    "a report with a level": (setting("conformance", {"level": EVIL}), 0),
    "another verdict": (setting("laws", "energy", "verdict", EVIL), 2, r"r\.json: \$\.laws\[1\]\.verdict: '\\x1b"),
    "a defect in text": (setting("laws", "energy", "defect", "0x1p0"), 2, r"\$\.laws\[1\]\.defect"),
    "claims in text": (setting("scheme", "claims", EVIL), 2, r"\$\.scheme\.claims"),
    "no laws": (lambda report: report.pop("laws"), 2, r"r\.json: \$: 'laws' is a required property"),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_runs_nothing_and_is_told_apart(name, report, tmp_path, monkeypatch):
    change, code, *words = HOSTILE[name]
    spoilt = copy.deepcopy(report)
    change(spoilt)
    (tmp_path / "imported_by_a_file.py").write_text("open('ran', 'w')\n")
    (tmp_path / "r.json").write_text(json.dumps(spoilt))
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    done = command("verify midpoint --against r.json --law identity", code)
    page = command("report r.json --out page.html", None)
    assert page.exit_code in (0, 2), page.output
    assert all(page.exit_code == 2 and re.search(word, page.output) for word in words), page.output
    assert (tmp_path / "page.html").exists() == (page.exit_code == 0)
    assert not {"\x1b", "\x07"} & set(done.output + page.output)
    assert not (tmp_path / "ran").exists()
    assert "imported_by_a_file" not in sys.modules


def test_what_is_no_json_and_a_large_file_unread_are_refused(tmp_path: Path) -> None:
    """What JSON may say is asked in test_hostile.py."""
    for content, words in (
        (b"", "a report of `sepv verify"),
        (b" " * (_against.REPORT_MAX_BYTES + 1), "bytes, more than"),
    ):
        (tmp_path / "r.json").write_bytes(content)
        with pytest.raises(UsageError, match=words):
            read_report(tmp_path / "r.json")


def test_counterexamples_share_the_time_of_one_law(report, monkeypatch):
    clock = iter([0.0, 0.0, 1e9])  # of `against` alone: the first counterexample takes all
    monkeypatch.setattr(_against, "time", type("clock", (), {"monotonic": lambda: next(clock)}))
    seen = {a.what: a for a in against(report, MIDPOINT, FEW, laws=["identity"])}
    assert seen["counterexample of energy"].came == "violated"
    assert seen["counterexample of rounding"].differs == "no time is left (--timeout)"


def test_a_problem_that_is_code_is_replayed_where_the_reader_names_it(tmp_path, monkeypatch):
    code = "import sepv\nfrom dataclasses import replace\nproblem = replace(sepv.problems.pendulum(), data=None)\n"
    (tmp_path / "named_by_the_reader.py").write_text(code)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    run = "verify midpoint --law energy -p named_by_the_reader:problem --examples 2"
    command(f"{run} --json r.json")
    assert "counterexample of energy: violated" in command(f"{run} --against r.json").output
    assert "is code: add -p" in command("verify midpoint --law energy --against r.json", 1).output
