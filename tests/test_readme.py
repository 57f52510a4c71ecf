"""The README does what it says: its Python runs, its commands exist, its table names every law."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from sepv.suite import load_laws

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
        few = "--examples 5 --paths 64" + ("" if "--law" in line else " --law contract --law energy")
        done = subprocess.run(
            [sys.executable, "-W", "error", "-m", *line.split(), *few.split()],
            cwd=tmp_path, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert "holds" in done.stdout


def test_every_law_has_its_row_and_its_file() -> None:
    for law in load_laws():
        row = next(line for line in README.splitlines() if line.startswith(f"| {law.name} |"))
        file = re.search(r"\((properties/\S+\.py)\)", row)
        assert file
        assert (ROOT / file[1]).is_file()


def test_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert "://" in target or (ROOT / target).exists(), target
