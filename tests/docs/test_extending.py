"""docs/extending.md, followed to the letter in a copy of the tree: a scheme,
a problem and a law are shipped.
"""

import re
import shutil
from pathlib import Path

import pytest
from doors import ROOT, block_in, but_deep, doc, python

PAGE = doc("extending.md")


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
    formula, _, _ = block_in(PAGE, "python", "def formula(fields, y, z, step)").partition("report =")
    assert "from sepv.schemes._one_step import RANDOM_STEP, Explicit, one_step" in PAGE
    formula = formula.replace("import sepv\n", "").replace(
        "from sepv.schemes import", "from sepv.schemes._one_step import"
    )
    (package / "schemes" / "_heun.py").write_text(formula)
    add(package / "schemes" / "_catalogue.py", '    "itoh_abe",\n', '    "heun",\n')

    # A problem: its file, its import and its line.
    text, _, _ = block_in(PAGE, "python", 'name="heisenberg"').partition("path =")
    text = re.sub(r"^import sepv\n", "from sepv.problem import Problem\n", text, flags=re.MULTILINE)
    text = text.replace("problem = sepv.Problem(", "def heisenberg():\n    return Problem(")
    (package / "problems" / "_heisenberg.py").write_text(text)
    problems = package / "problems" / "__init__.py"
    add(
        problems,
        "from sepv.problems._kepler",
        "from sepv.problems._heisenberg import heisenberg as heisenberg\n",
    )
    add(problems, "    figure_eight, harmonic_trap,", "    heisenberg,\n")

    # A law: its file, and one line.
    law = block_in(PAGE, "python", 'name="noise-scale"')
    (package / "properties" / "test_noise_scale.py").write_text(law)
    add(package / "schemes" / "_claims.py", '    "midpoint",\n', '    "noise-scale",\n')
    return folder


def add(file: Path, before: str, line: str) -> None:
    """One line, where the page says."""
    text = file.read_text(encoding="utf-8")
    assert text.count(before) >= 1, file
    file.write_text(text.replace(before, line + before, 1), encoding="utf-8")


def sepv(tree: Path, words: str) -> str:
    """What the command prints in the tree."""
    return python("from sepv.commands import main; main()", *words.split(), folder=tree)


def test_the_list_shows_what_was_added(tree: Path) -> None:
    shown = sepv(tree, "list")
    for name in ("heun", "heisenberg", "noise-scale"):
        assert re.search(rf"^ *{name} ", shown, flags=re.MULTILINE), shown


def test_the_scheme_is_judged_by_name_and_compiled(tree: Path) -> None:
    assert re.search(r"random-step +yes +holds", sepv(tree, "verify heun --law random-step --examples 8"))
    run = "sepv.ensemble('heun', 'heisenberg', h=0.01, T=0.1, paths=4, engine='compiled')"
    assert python(f"import sepv; print({run}.y.shape, sepv.schemes.heun.name)", folder=tree) == "(3, 4) heun"


CLASSES = ("energy-preserving", "both-invariants", "several-structures", "stochastic-midpoint")
NAMED = ("midpoint -p heisenberg -p canonical-separable", "stochastic-midpoint -p random-inertia")


@pytest.mark.parametrize(
    "asked", but_deep([*CLASSES, *NAMED], "several-structures", "stochastic-midpoint", NAMED[0])
)
def test_the_law_is_measured_for_every_class_and_for_problems_of_a_user(tree: Path, asked: str) -> None:
    shown = sepv(tree, f"verify {asked} --law noise-scale --examples 8")
    assert re.search(r"noise-scale +(no|yes)? +holds", shown), shown
    # Not by random examples alone: a design asks of each class, and of a family of problems.
    if "random-inertia" not in asked:
        assert int(re.findall(r"(\d+) checks", shown)[-1]) > 24, shown


def test_the_law_finds_a_wrong_noise_in_every_class(tree: Path) -> None:
    """c² in place of c: each class of systems has a scheme that is wrong so, and the law says
    it.
    """
    code = f"""
import sepv
from sepv.schemes import by_name
for name in {CLASSES}:
    right = by_name(name)
    def step(problem, y, h, dW, right=right):
        return right.step(problem, y, h, dW * (1 + 1e-6 * problem.c[0]))
    wrong = sepv.Scheme("wrong", step, systems=right.systems)
    print(sepv.verify(wrong, laws=["noise-scale"]).findings[0].verdict.text)
"""
    assert python(code, folder=tree).split() == ["violated"] * 4
