"""Docstrings and comments on constants that can be read alone, in the rooms that keep to it."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
# Rooms whose words are read and rewritten; a room is a folder or a file.
ROOMS = (
    "properties", "reference", "sepv/__init__.py", "sepv/_arguments.py", "sepv/_journal.py",
    "sepv/_patches.py", "sepv/_terminal.py", "sepv/commands", "sepv/errors.py", "sepv/exact",
    "sepv/external", "sepv/faults", "sepv/files.py", "sepv/large", "sepv/page", "sepv/peers",
    "sepv/problem", "sepv/problems", "sepv/pytest_plugin.py", "sepv/record", "sepv/schemes",
    "sepv/simulate", "sepv/solve", "sepv/studies", "sepv/verification", "sepv/workers",
)  # fmt: skip
# A first line that begins so is a part of a sentence whose rest the reader has to guess.
RIDDLE = re.compile(r"(What|Whether|Those|Of|As|The same|Its|That|This one|How|Who|Which|Where|When|Such)\b")
# A first line or a comment of one word, such as "Likewise.", names nothing.
SHORT = re.compile(r"[\w-]+\.?$")


def is_riddle(text: str) -> bool:
    return bool(RIDDLE.match(text) or SHORT.match(text))


def docstrings(tree: ast.Module) -> Iterator[tuple[int, str]]:
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and (doc := ast.get_docstring(node)):
            yield node.body[0].lineno, doc.splitlines()[0]


def comments_on_constants(tree: ast.Module, lines: list[str]) -> Iterator[tuple[int, str]]:
    """The first lines of comments directly above an assignment of a module."""
    for node in tree.body:
        if isinstance(node, (ast.Assign, ast.AnnAssign)):
            first = node.lineno - 1
            while lines[first - 1].startswith("#"):
                first -= 1
            if first < node.lineno - 1:
                yield first + 1, lines[first].lstrip("#: ")


@pytest.mark.parametrize("room", ROOMS)
def test_first_lines_can_be_read_alone(room: str) -> None:
    path, riddles = ROOT / room, []
    for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
        text = file.read_text(encoding="utf-8")
        tree = ast.parse(text)
        found = [*docstrings(tree), *comments_on_constants(tree, text.splitlines())]
        riddles += [f"{file.relative_to(ROOT)}:{n}: {line}" for n, line in found if is_riddle(line)]
    assert riddles == []


def test_a_riddle_is_seen() -> None:
    assert all(map(is_riddle, ["Of |ζ|.", "What a step is given.", "Whether it holds.", "Likewise."]))
    assert not any(map(is_riddle, ["y1 of a step.", "Whole powers are products.", "Φ(y) − y0."]))
