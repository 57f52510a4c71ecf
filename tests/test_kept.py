"""Results kept between runs are those that would be made, and no reason to fail."""

import pickle
from pathlib import Path

import pytest
from doors import python

from sepv import _kept
from sepv._kept import Kept

MAKE_CASES = """
import sys, sepv
from sepv._kept import save_all
from sepv.problem import Systems
from sepv.law.cases import random_cases
from sepv.law.cases.classes import CLASSES

space, placed, kept = CLASSES[Systems.SINGLE].space, random_cases.placed, "kept" in sys.argv
# A case that is drawn again ends the process, and then so does a design that is made again.
random_cases.placed = None if kept else placed
print([case for _, case in space.cases(0)])
random_cases.placed, type(space).cases = placed, None if kept else type(space).cases
print(sepv.verify("midpoint", laws="energy,casimir", effort=sepv.Effort(examples=1)).findings[0].message)
save_all()
"""


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SEPV_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(_kept, "_path", lambda kind: tmp_path / f"{kind}.pickle")


def test_a_result_is_made_once_for_all_runs() -> None:
    first = Kept("numbers")
    assert [first.get("a", lambda: 1), first.get("a", lambda: 2)] == [1, 1]
    first.save()
    assert Kept("numbers").get("a", lambda: 2) == 1
    assert Kept("others").get("a", lambda: 2) == 2


@pytest.mark.parametrize("other", ["sources", "torn", "not ours"])
def test_a_file_of_other_sources_or_a_torn_one_is_made_again(
    other: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = Kept("numbers")
    first.get("a", lambda: 1)
    first.save()
    file = tmp_path / "numbers.pickle"
    if other == "sources":
        monkeypatch.setattr(_kept, "_sources", lambda: "changed")
    else:
        file.write_bytes(file.read_bytes()[:-3] if other == "torn" else pickle.dumps(17))
    again = Kept("numbers")
    assert again.get("a", lambda: 2) == 2
    again.save()
    assert Kept("numbers").get("a", lambda: 3) == 2


def test_a_folder_that_cannot_be_written_to_costs_nothing_but_time(tmp_path: Path) -> None:
    (tmp_path / "numbers.pickle").mkdir()
    first = Kept("numbers")
    first.get("a", lambda: 1)
    first.save()
    assert Kept("numbers").get("a", lambda: 2) == 2


def test_the_results_that_were_used_last_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_kept, "STORED_MAX", 2)
    first = Kept("numbers")
    for key in "abca":
        first.get(key, lambda: 1)
    first.save()
    again = Kept("numbers")
    assert {key: again.get(key, lambda: 2) for key in "cab"} == {"c": 1, "a": 1, "b": 2}


def test_kept_cases_and_designs_are_those_that_are_drawn() -> None:
    assert python(MAKE_CASES) == python(MAKE_CASES, "kept") != ""
