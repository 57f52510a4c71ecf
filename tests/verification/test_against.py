"""Reports measured again: what differs is said; a hostile file runs nothing, costs little and steers no terminal."""

import copy
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from doors import command

import sepv
from sepv.errors import UsageError
from sepv.files import made, write_json
from sepv.verification import Effort, _against
from sepv.verification._against import against, read_report

FEW = Effort(examples=2, paths=256, shrink_checks=10)
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
    law(changed, "identity")["defect"] = 1e-300
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
# What a file may do, with the exit code: 1 is a difference that is said, 2 a file that is refused.
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
    "a later version": (setting("made", "version", 99), 2),
    "a great number": (setting("laws", "energy", "defect", 10**400), 2),
    "a report with a level": (setting("conformance", {"level": EVIL}), 0),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_runs_nothing_and_is_told_apart(name, report, tmp_path, monkeypatch):
    change, code = HOSTILE[name]
    spoilt = copy.deepcopy(report)
    change(spoilt)
    (tmp_path / "imported_by_a_file.py").write_text("open('ran', 'w')\n")
    (tmp_path / "r.json").write_text(json.dumps(spoilt))
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    done = command("verify midpoint --against r.json --law identity", code)
    page = command("report r.json --out page.html", None)
    assert page.exit_code in (0, 2), page.output
    assert not {"\x1b", "\x07"} & set(done.output + page.output)
    assert not (tmp_path / "ran").exists()
    assert "imported_by_a_file" not in sys.modules


def test_what_is_no_json_and_a_large_file_unread_are_refused(tmp_path: Path) -> None:
    """What JSON may say is asked in test_hostile.py."""
    for content, words in (
        (b"", "a report of `sepv verify"),
        (b" " * (_against.LARGEST + 1), "bytes, more than"),
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
