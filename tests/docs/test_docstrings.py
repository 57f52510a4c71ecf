"""Docstrings and comments on constants can be read alone."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from doors import ROOT

FOLDERS = ("properties", "reference", "sepv")
ROOMS = sorted({p.parent for folder in FOLDERS for p in (ROOT / folder).rglob("*.py")})
# A first line that begins so is a part of a sentence whose rest the reader has to guess.
RIDDLE = re.compile(r"(What|Whether|Those|Of|As|The same|Its|That|This one|How|Who|Which|Where|When|Such)\b")
# A first line or a comment of one or two plain words, such as "One path.", names nothing. A formula does.
SHORT = re.compile(r"[A-Za-z-]+( [A-Za-z-]+)?\.?$")
# Words for something that stands elsewhere: an argument, another function, a sentence before.
ELSEWHERE = re.compile(r"\b(so many|this word|the latter|the former|such ones)\b|^`_")


def is_riddle(text: str) -> bool:
    return bool(RIDDLE.match(text) or SHORT.match(text) or ELSEWHERE.search(text))


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


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: str(room.relative_to(ROOT)))
def test_first_lines_can_be_read_alone(room: Path) -> None:
    riddles: list[str] = []
    for file in sorted(room.glob("*.py")):
        text = file.read_text(encoding="utf-8")
        tree = ast.parse(text)
        found = [*docstrings(tree), *comments_on_constants(tree, text.splitlines())]
        riddles += [f"{file.relative_to(ROOT)}:{n}: {line}" for n, line in found if is_riddle(line)]
    assert riddles == []


def test_a_riddle_is_seen() -> None:
    riddles = ["Of |ζ|.", "What a step is given.", "Whether it holds.", "One path.", "At most so many."]
    assert all(map(is_riddle, riddles))
    assert not any(map(is_riddle, ["y1 of a step.", "Whole powers are products.", "Φ(y) − y0."]))
