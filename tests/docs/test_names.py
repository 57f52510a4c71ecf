"""Names in prose are there: each path and each dotted name.
First lines and comments on constants can be read alone.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from inspect import getsource
from pathlib import Path

import pytest
from doors import PAGES, ROOT

FOLDERS = ("sepv", "properties", "reference", "benchmarks", "tests", "docs", "examples")
SOURCES = sorted(p for folder in FOLDERS for p in (ROOT / folder).rglob("*.py"))
NAME = re.compile(r"(?<![\w./@-])(?:sepv|benchmarks)(?:\.[A-Za-z_]\w*)+(?![\w-]*\.(?:yml|toml|git)\b)")
FILE = re.compile(rf"(?<![\w./-])(?:{'|'.join(FOLDERS)})/[\w./*-]*\w")
# A key of click's context, a group of entry points and a file of asv, which are written like
# modules.
KEYS = ("sepv.words", "sepv.peers", "benchmarks.json")
# What stands for any name, and what docs/extending.md has its reader make.
STANDS_FOR_ANY = re.compile(r"[A-Z]{3,}|…|\b_?(?:heun|heisenberg|name|test_noise_scale)\b")


def place(parts: list[str]) -> Path:
    """The folder or file of a dotted name: the properties and references are installed below
    sepv.
    """
    if parts[:2] in (["sepv", "properties"], ["sepv", "reference"]):
        parts = parts[1:]
    return ROOT.joinpath(*parts)


@cache
def is_there(file: str) -> bool:
    """Whether a path, which may have stars, leads somewhere."""
    return bool(list(ROOT.glob(file)))


@cache
def exists(name: str) -> bool:
    """Whether a dotted name is a module, or something in one."""
    parts = name.split(".")
    files = [place(parts[: n + 1]) for n in range(len(parts))]
    known = sum(file.is_dir() or file.with_suffix(".py").is_file() for file in files)
    try:
        found: object = import_module(".".join(parts[:known]))
    except ModuleNotFoundError:  # an adapter needs its library
        text = files[known - 1].with_suffix(".py").read_text(encoding="utf-8")
        return all(re.search(rf"^(def |class )?{part}\b", text, re.MULTILINE) for part in parts[known:])
    for part in parts[known:]:
        if not hasattr(found, part):  # a field without a default, or one that an instance alone has
            source = getsource(found) if isinstance(found, type) else ""
            return bool(re.search(rf"\b{part}\b.* = |^ +{part}: ", source, re.MULTILINE))
        found = getattr(found, part)
    return True


def names_in(text: str) -> Iterator[str]:
    for match in NAME.finditer(text):
        name = match[0].removesuffix(".py")
        # What ends with _ is the beginning of a name that is made.
        if (
            not name.endswith("_")
            and name not in KEYS
            and not STANDS_FOR_ANY.search(text[match.start() : match.end() + 1])
        ):
            yield name


def files_in(text: str) -> Iterator[str]:
    for match in FILE.finditer(text):
        if not STANDS_FOR_ANY.search(text[match.start() : match.end() + 1]):
            yield match[0]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_names_and_files_on_a_page_are_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert [name for name in names_in(text) if not exists(name)] == []
    assert [file for file in files_in(text) if not is_there(file)] == []


def prose(file: Path) -> Iterator[str]:
    """Docstrings, other strings and comments: names in code are the type checker's."""
    text = file.read_text(encoding="utf-8")
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
    yield from re.findall(r"(?m)^\s*#.*$|\s{2}#.*$", text)


@pytest.mark.parametrize("folder", FOLDERS)
def test_names_and_files_in_docstrings_and_comments_are_there(folder: str) -> None:
    wrong = []
    for file in SOURCES:
        if file.relative_to(ROOT).parts[0] == folder and file != Path(__file__):
            for text in prose(file):
                wrong += [(file.name, name) for name in names_in(text) if not exists(name)]
                wrong += [(file.name, name) for name in files_in(text) if not is_there(name)]
    assert wrong == []


# The command, an extra.
NO_PYTHON = ("sepv", "fast")
ROOMS = sorted(p for p in (ROOT / "sepv").rglob("__init__.py"))


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.parent.name)
def test_modules_that_a_room_tells_to_read_are_in_it(room: Path) -> None:
    doc = ast.get_docstring(ast.parse(room.read_text(encoding="utf-8"))) or ""
    modules = [p for p in room.parent.rglob("*") if p.is_dir() or p.suffix == ".py"]
    lines = "\n".join(p.read_text(encoding="utf-8") for p in modules if p.is_file())
    known = {p.stem for p in modules}.union(re.findall(r"^(?:def |class )?(\w+)", lines, re.MULTILINE))
    asked = re.findall(r"`([a-z_]\w+)`", doc)
    assert [name for name in asked if name not in known and name not in NO_PYTHON] == []


def test_a_name_that_is_gone_is_seen() -> None:
    assert not exists("sepv.verification._gone")
    assert not exists("sepv.schemes.Scheme.gone")
    assert not exists("sepv.gone")
    assert exists("sepv.schemes._scheme.Scheme.systems")
    assert exists("sepv.properties.test_energy.law")
    assert list(names_in("see `sepv.problem._gone`, sepv.schemes.")) == ["sepv.problem._gone", "sepv.schemes"]
    assert list(files_in("tests/test_gone.py and reference/witnesses/LAW.json")) == ["tests/test_gone.py"]


FOLDERS_OF_CODE = sorted(
    {p.parent for folder in ("properties", "reference", "sepv") for p in (ROOT / folder).rglob("*.py")}
)
# A first line that begins so is a part of a sentence whose rest the reader has to guess.
RIDDLE = re.compile(r"(What|Whether|Those|Of|As|The same|Its|That|This one|How|Who|Which|Where|When|Such)\b")
# A first line or a comment of one or two plain words, such as "One path.", names nothing. A formula
# does.
SHORT = re.compile(r"[A-Za-z-]+( [A-Za-z-]+)?\.?$")
# Words for something that stands elsewhere: an argument, another function, a sentence before.
POINTS_ELSEWHERE = re.compile(r"\b(so many|this word|the latter|the former|such ones)\b|^`_")


def is_riddle(text: str) -> bool:
    return bool(RIDDLE.match(text) or SHORT.match(text) or POINTS_ELSEWHERE.search(text))


def docstrings(tree: ast.Module) -> Iterator[tuple[int, str]]:
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and (doc := ast.get_docstring(node)):
            yield node.body[0].lineno, " ".join(doc.partition("\n\n")[0].split())


def comments_on_constants(tree: ast.Module, lines: list[str]) -> Iterator[tuple[int, str]]:
    """The first lines of comments directly above an assignment of a module."""
    for node in tree.body:
        if isinstance(node, (ast.Assign, ast.AnnAssign)):
            first = node.lineno - 1
            while lines[first - 1].startswith("#"):
                first -= 1
            if first < node.lineno - 1:
                yield first + 1, lines[first].lstrip("#: ")


@pytest.mark.parametrize("room", FOLDERS_OF_CODE, ids=lambda room: str(room.relative_to(ROOT)))
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


# Names that stand in several files for one thing: what adapters of libraries and families of
# saboteurs give, public lists of problems and of schemes, a word of type checkers, and type
# variables.
SHARED = {"PEER", "FAMILY", "PAPER", "EXTENSIONS", "HAMILTONIANS", "TYPE_CHECKING", "T"}


def names_of(module: ast.Module) -> set[str]:
    """The constants and types that a module defines."""
    found = set()
    for node in module.body:
        if isinstance(node, ast.ClassDef):
            found.add(node.name)
        for target in node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]:
            names = target.elts if isinstance(target, ast.Tuple) else [target]
            found |= {
                n.id for n in names if isinstance(n, ast.Name) and re.fullmatch(r"_?[A-Z][A-Z0-9_]*", n.id)
            }
    return found


def test_a_constant_or_type_has_a_name_of_its_own() -> None:
    """One name in two files is one thing twice, or two things that a reader takes for one."""
    files: dict[str, list[str]] = {}
    for source in SOURCES:
        if source.relative_to(ROOT).parts[0] in FOLDERS[:4]:
            for name in names_of(ast.parse(source.read_text(encoding="utf-8"))):
                files.setdefault(name, []).append(str(source.relative_to(ROOT)))
    assert {name: found for name, found in files.items() if len(found) > 1 and name not in SHARED} == {}
