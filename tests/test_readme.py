"""The README does what it says: its Python runs, its commands exist, its table names every law."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from reader import Reader

from sepv.schemes import energy_preserving
from sepv.verification import SUITE, load_laws

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)


def test_python_blocks_run_as_printed(reader: Reader) -> None:
    mine, *others = blocks("python")
    (reader.folder / "mine.py").write_text(mine)
    for block in others:
        shown = reader.python(block)
        assert shown
        if "sepv.verify" in block:
            assert "Verdict.HOLDS" in shown
            assert "H(y1) − H(y0)" in shown


def test_shell_blocks_run(reader: Reader) -> None:
    """The setup and the test command are what brought us here; the others run with less effort."""
    (reader.folder / "mine.py").write_text(blocks("python")[0])
    lines = [line for block in blocks("sh") for line in block.splitlines() if line.startswith("sepv ")]
    assert lines
    for line in lines:
        few = "--examples 2 --paths 64 --shrink-checks 10" + ("" if "--law" in line else " --law energy")
        assert "holds" in reader.sepv(f"{line} {few}")


def shape(line: str) -> str:
    """A line without its numbers and its token: what stays when a design draws another case."""
    line = re.sub(r"--replay \S+", "--replay TOKEN", line)
    line = re.sub(r"(?<![A-Za-z\d.])-?\d+(\.\d+)?(e[+-]?\d+)?(?![\d.]|th)", "#", line)
    return " ".join(line.split())


@pytest.mark.parametrize("page", ["README.md", "docs/ten-minutes.md"])
def test_what_is_shown_of_the_midpoint_rule_is_what_is_printed(page: str, reader: Reader) -> None:
    """Row by row and line by line, but for numbers, and for which system and step it is."""
    content = (ROOT / page).read_text()
    shown = re.findall(r"^```text\n(.*?)^```$", content, flags=re.MULTILINE | re.DOTALL)
    (reader.folder / "mine.py").write_text(
        re.findall(r"^```python\n(.*?)^```$", content, flags=re.MULTILINE | re.DOTALL)[0]
    )
    command = "verify midpoint" if page == "README.md" else "verify mine:step"
    if page == "README.md":
        # As a reader sees it, in a process of its own.
        printed = subprocess.run(
            [sys.executable, "-W", "error", "-m", "sepv", *command.split(), "--law", "energy,casimir"],
            cwd=reader.folder, capture_output=True, text=True, check=False,
        ).stdout.splitlines()  # fmt: skip
    else:
        printed = reader.sepv(f"sepv {command} --law energy,casimir").splitlines()
    there = {shape(line) for line in printed}
    tables = [block for block in shown if block.startswith(" law ")]
    assert len(tables) == (page == "README.md")
    for line in "".join(tables).splitlines():
        assert shape(line) in there, line
    (violation,) = (block for block in shown if block.startswith("energy violated"))
    first, *_, step, replay, command = violation.splitlines()
    assert {shape(first), shape(replay), shape(command)} <= there
    assert shape(step).partition(", from")[0] in {line.partition(", from")[0] for line in there}


def test_the_table_of_the_trusted_scheme_is_about_its_laws_and_claims() -> None:
    table = next(block for block in blocks("text") if block.startswith("energy-preserving"))
    claims = energy_preserving.claims
    laws = {law.name for law in load_laws()}
    rows = [line.split() for line in table.splitlines() if line.split() and line.split()[0] in laws]
    assert len(rows) >= 10
    for law, second, *_ in rows:
        assert (second == "yes") == (law in claims or law == "contract"), law
    last = table.splitlines()[-1]
    assert last.startswith(f"{len(laws)} laws: ")
    held, violated, silent = (int(n) for n in re.findall(r"(\d+) (?:hold|violated|not applicable)", last))
    assert held + violated + silent == len(laws)
    assert (
        f"All {len(set(claims) | {'contract'})} claimed laws hold. Found (suite {SUITE}): method, order 1, energy"
        in last
    )


def test_every_block_of_the_readme_is_of_a_kind_that_is_run_or_compared() -> None:
    kinds = re.findall(r"^```(\w*)$", README, flags=re.MULTILINE)[::2]
    assert set(kinds) == {"sh", "python", "text"}
    assert kinds.count("text") == 3  # the two above
    ours = ("sepv verify ", "python3 -m venv", "pip install -e '.[test]'", "python -m pytest -n auto")
    for block in blocks("sh"):
        assert all(line.startswith(ours) for line in block.splitlines()), block


def test_every_law_has_its_row_and_its_file() -> None:
    for law in load_laws():
        row = next(line for line in README.splitlines() if line.startswith(f"| {law.name} |"))
        file = re.search(r"\((properties/\S+\.py)\)", row)
        assert file
        assert (ROOT / file[1]).is_file()


def test_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert "://" in target or (ROOT / target).exists(), target
