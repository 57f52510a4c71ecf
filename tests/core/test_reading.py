"""The core is small: it is read in one order, and a step of (2.1) runs few lines of few files."""

import ast
import re
import sys
from pathlib import Path
from types import CodeType, FrameType

import numpy as np

import sepv
from sepv import core

HOME = Path(core.__file__).parent
FILES = {path.stem: path for path in HOME.glob("*.py") if path.stem != "__init__"}


def imported(path: Path) -> list[str]:
    """The modules that a file imports, inside functions too."""
    nodes = list(ast.walk(ast.parse(path.read_text())))
    plain = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    return plain + [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]


def test_the_reading_order_names_every_file_and_each_imports_only_files_above_it() -> None:
    order = re.findall(r"^\d+\. `(\w+)`", core.__doc__ or "", flags=re.M)
    assert sorted(order) == sorted(FILES)
    for place, name in enumerate(order):
        for module in imported(FILES[name]):
            if module.startswith("sepv"):
                above = {"sepv.errors", *(f"sepv.core.{other}" for other in order[:place])}
                assert module in above, f"{name} imports {module}"
            else:
                assert module.split(".")[0] in {"numpy", *sys.stdlib_module_names}, f"{name} imports {module}"


def test_the_core_has_fewer_than_1500_lines() -> None:
    assert sum(len(path.read_text().splitlines()) for path in HOME.glob("*.py")) <= 1500


def entered(problem: sepv.Problem) -> set[CodeType]:
    """The functions of the core that the second step of (2.1) on a problem enters."""
    y, dW = np.array(problem.initial), np.full(problem.noises, 0.2)
    sepv.schemes.energy_preserving.step(problem, y, 0.1, dW)
    found = set()

    def seen(frame: FrameType, *_: object) -> None:
        if Path(frame.f_code.co_filename).parent == HOME:
            found.add(frame.f_code)

    before = sys.gettrace()
    sys.settrace(seen)
    try:
        sepv.schemes.energy_preserving.step(problem, y, 0.1, dW)
    finally:
        sys.settrace(before)
    return found


def lines(code: CodeType) -> set[int]:
    """The lines of a function from its first to its last, docstring and comments included."""
    return set(range(code.co_firstlineno, max(line for *_, line in code.co_lines() if line) + 1))


def test_a_step_on_a_users_problem_enters_seven_files_and_600_lines() -> None:
    def structure(y: np.ndarray) -> np.ndarray:
        a, b, c = y
        return np.array([[0 * a, -c, b], [c, 0 * a, -a], [-b, a, 0 * a]])

    derived = sepv.Problem(
        3, structure, lambda y: (y[0] ** 2 + y[1] ** 4 + y[2] ** 2 / 3) / 2, initial=(0.8, 0.6, 0.1)
    )
    bare = sepv.Problem(
        3, structure, lambda y: np.exp(y[0]) + (y[1] ** 2 + y[2] ** 2) / 2,
        lambda y: np.stack([np.exp(y[0]), y[1], y[2]]), initial=(0.8, 0.6, 0.1),
    )  # fmt: skip
    for problem in (derived, bare):
        codes = entered(problem)
        files = {Path(code.co_filename).stem for code in codes}
        assert {"newton", "average", "formula"} <= files, "the trace sees what a step runs"
        assert len(files) <= 7
        spans = {name: set[int]() for name in files}
        for code in codes:
            spans[Path(code.co_filename).stem] |= lines(code)
        assert sum(map(len, spans.values())) <= 600
