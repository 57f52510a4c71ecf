"""The README does what it says: its Python runs, its commands exist, its table names every law."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from sepv.schemes import energy_preserving
from sepv.verification import load_laws

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)


def test_python_blocks_run_as_printed(tmp_path: Path) -> None:
    mine, *others = blocks("python")
    (tmp_path / "mine.py").write_text(mine)
    for block in others:
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", block],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout
        if "sepv.verify" in block:
            assert "Verdict.HOLDS" in done.stdout
            assert "H(y1) − H(y0)" in done.stdout


def test_shell_blocks_run(tmp_path: Path) -> None:
    """The setup and the test command are what brought us here; the others run with less effort."""
    (tmp_path / "mine.py").write_text(blocks("python")[0])
    lines = [line for block in blocks("sh") for line in block.splitlines() if line.startswith("sepv ")]
    assert lines
    for line in lines:
        few = "--examples 2 --paths 64 --shrink-checks 10" + ("" if "--law" in line else " --law energy")
        done = subprocess.run(
            [sys.executable, "-W", "error", "-m", *line.split(), *few.split()],
            cwd=tmp_path, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert "holds" in done.stdout


def shape(line: str) -> str:
    """A line without its numbers and its token: what stays when a design draws another case."""
    line = re.sub(r"--replay \S+", "--replay TOKEN", line)
    line = re.sub(r"(?<![A-Za-z\d.])-?\d+(\.\d+)?(e[+-]?\d+)?(?![\d.]|th)", "#", line)
    return " ".join(line.split())


@pytest.mark.parametrize("page", ["README.md", "docs/ten-minutes.md"])
def test_what_is_shown_of_the_midpoint_rule_is_what_is_printed(page: str, tmp_path: Path) -> None:
    """Row by row and line by line, but for numbers, and for which system and step it is."""
    content = (ROOT / page).read_text()
    shown = re.findall(r"^```text\n(.*?)^```$", content, flags=re.MULTILINE | re.DOTALL)
    (tmp_path / "mine.py").write_text(
        re.findall(r"^```python\n(.*?)^```$", content, flags=re.MULTILINE | re.DOTALL)[0]
    )
    target = "midpoint" if page == "README.md" else "mine:step"
    printed = subprocess.run(
        [sys.executable, "-m", "sepv", "verify", target, "--law", "energy,casimir"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    ).stdout.splitlines()  # fmt: skip
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
    assert f"All {len(set(claims) | {'contract'})} claimed laws hold. Level 3 of suite version " in last


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
