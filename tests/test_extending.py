"""docs/extending.md, followed to the letter in a copy of the tree: a scheme, a problem and a law are shipped."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)


def block(word: str) -> str:
    """The page's block with this word in it."""
    (found,) = [text for text in BLOCKS if word in text]
    return found


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package as it is installed, with the additions of the page."""
    folder = tmp_path_factory.mktemp("tree")
    # With what Python and numba have compiled: both see by time and size which files change below.
    package = folder / "sepv"
    shutil.copytree(ROOT / "sepv", package)
    for name in ("properties", "reference"):
        shutil.copytree(ROOT / name, package / name)

    # A scheme: its file, and one line.
    formula, _, _ = block("def formula(fields, y, z, step)").partition("report =")
    assert "from sepv.schemes._one_step import RANDOM_STEP, Explicit, one_step" in PAGE
    formula = formula.replace("import sepv\n", "").replace(
        "from sepv.schemes import", "from sepv.schemes._one_step import"
    )
    (package / "schemes" / "_heun.py").write_text(formula)
    add(package / "schemes" / "_catalogue.py", '    "itoh_abe",\n', '    "heun",\n')

    # A problem: its file, its import and its line.
    text, _, _ = block('name="heisenberg"').partition("path =")
    text = re.sub(r"^import sepv\n", "from sepv.problem import Problem\n", text, flags=re.MULTILINE)
    text = text.replace("problem = sepv.Problem(", "def heisenberg():\n    return Problem(")
    (package / "problems" / "_heisenberg.py").write_text(text)
    problems = package / "problems" / "__init__.py"
    add(
        problems,
        "from sepv.problems._kepler",
        "from sepv.problems._heisenberg import heisenberg as heisenberg\n",
    )
    add(problems, "    kepler,\n", "    heisenberg,\n")

    # A law: its file, and one line.
    (package / "properties" / "test_short_steps.py").write_text(block('name="short-steps"'))
    add(package / "verification" / "_laws.py", '    "midpoint",\n', '    "short-steps",\n')
    return folder


def add(file: Path, before: str, line: str) -> None:
    """One line, where the page says."""
    text = file.read_text(encoding="utf-8")
    assert text.count(before) >= 1, file
    file.write_text(text.replace(before, line + before, 1), encoding="utf-8")


def sepv(tree: Path, words: str) -> str:
    """What the command prints in the tree."""
    done = subprocess.run(
        [sys.executable, "-m", "sepv", *words.split()], cwd=tree, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_list_shows_what_was_added(tree: Path) -> None:
    shown = sepv(tree, "list")
    for name in ("heun", "heisenberg", "short-steps"):
        assert re.search(rf"^ *{name} ", shown, flags=re.MULTILINE), shown


def test_the_scheme_is_judged_by_name_and_compiled(tree: Path) -> None:
    assert re.search(r"random-step +yes +holds", sepv(tree, "verify heun --law random-step --examples 8"))
    code = (
        "import sepv; print(sepv.ensemble('heun', 'heisenberg', h=0.01, T=0.1, paths=4, engine='compiled').y.shape, "
        "sepv.schemes.heun.name)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tree, capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["(3,", "4)", "heun"], done.stderr


def test_the_law_is_measured(tree: Path) -> None:
    shown = sepv(tree, "verify energy-preserving --law short-steps --examples 8")
    assert re.search(r"short-steps +holds", shown), shown
