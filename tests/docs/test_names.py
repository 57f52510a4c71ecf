"""Names in prose: each path and each dotted name that a page, a docstring or a comment has is there."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest
from doors import PAGES, ROOT

FOLDERS = ("sepv", "properties", "reference", "benchmarks", "tests", "docs", "examples")
SOURCES = sorted(p for folder in FOLDERS for p in (ROOT / folder).rglob("*.py"))
NAME = re.compile(r"(?<![\w./@-])(?:sepv|benchmarks)(?:\.[A-Za-z_]\w*)+(?![\w-]*\.(?:yml|toml|git)\b)")
FILE = re.compile(rf"(?<![\w./-])(?:{'|'.join(FOLDERS)})/[\w./*-]*\w")
# A key of click's context and a group of entry points, which are written like modules.
KEYS = ("sepv.words", "sepv.peers")
# What stands for any name, and what docs/extending.md has its reader make.
STANDS_FOR_ANY = re.compile(r"[A-Z]{3,}|…|\b_?(?:heun|heisenberg|name|test_noise_scale)\b")


@cache
def top_level(file: Path) -> dict[str, ast.AST]:
    """What a module defines or imports, without running it: adapters need their libraries."""
    found: dict[str, ast.AST] = {}
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                found[name] = node
            case ast.Assign(targets=targets):
                found |= {
                    t.id: node for target in targets for t in ast.walk(target) if isinstance(t, ast.Name)
                }
            case ast.AnnAssign(target=ast.Name(id=name)):
                found[name] = node
            case ast.Import(names=names) | ast.ImportFrom(names=names):
                found |= {a.asname or a.name: node for a in names}
    return found


def place(parts: list[str]) -> Path:
    """The folder or file of a dotted name: the properties and references are installed below sepv."""
    if parts[:2] in (["sepv", "properties"], ["sepv", "reference"]):
        parts = parts[1:]
    return ROOT.joinpath(*parts)


def exists(name: str) -> bool:
    """Whether a dotted name is a module, or something in one."""
    parts = name.split(".")
    known = next(
        n for n in range(len(parts), -1, -1)
        if not n or place(parts[:n]).is_dir() or place(parts[:n]).with_suffix(".py").is_file()
    )  # fmt: skip
    if known == len(parts):
        return True
    module, rest = place(parts[:known]), parts[known:]
    file = module / "__init__.py" if module.is_dir() else module.with_suffix(".py")
    node = top_level(file).get(rest[0]) if file.is_file() else None
    if isinstance(node, ast.ClassDef) and len(rest) > 1:
        return any(_defines(part, rest[1]) for part in ast.walk(node))
    if node is not None and (len(rest) == 1 or not isinstance(node, (ast.Import, ast.ImportFrom))):
        return True
    found: object = import_module(".".join(parts[:known]))  # names that are given on demand
    for part in rest:
        if not hasattr(found, part):
            return False
        found = getattr(found, part)
    return True


def _defines(node: ast.AST, name: str) -> bool:
    match node:
        case ast.FunctionDef(name=own) | ast.Name(id=own) | ast.Attribute(attr=own):
            return own == name
    return False


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
    assert [file for file in files_in(text) if not list(ROOT.glob(file))] == []


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
                wrong += [(file.name, name) for name in files_in(text) if not list(ROOT.glob(name))]
    assert wrong == []


# The command, an extra.
NO_PYTHON = ("sepv", "fast")
ROOMS = sorted(p for p in (ROOT / "sepv").rglob("__init__.py"))


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.parent.name)
def test_modules_that_a_room_tells_to_read_are_in_it(room: Path) -> None:
    doc = ast.get_docstring(ast.parse(room.read_text(encoding="utf-8"))) or ""
    modules = [p for p in room.parent.rglob("*") if p.is_dir() or p.suffix == ".py"]
    known = {p.stem for p in modules}.union(*(top_level(p) for p in modules if p.is_file()))
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
