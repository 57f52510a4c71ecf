"""The pages of the API have every public name, and none of a private module."""

import ast
import inspect
import re
from importlib import import_module
from types import ModuleType
from typing import Any

import pytest
from doors import ROOT

import sepv

# Modules of one file beside the rooms, which are folders.
FILES = ("errors", "files", "strategies")
PAGES = sorted((ROOT / "docs" / "api").glob("*.md"))
DIRECTIVE = re.compile(r"^\.\. (?:auto(?:function|class|exception)|py:data):: (sepv\S+)$", re.MULTILINE)
PRIVATE = re.compile(r"sepv(?:\.\w+)*\._\w+")


def public(module: ModuleType) -> dict[str, Any]:
    """The names for users: in `__all__`, imported as ``X as X``,
    or classes that a file without both defines.
    """
    tree = ast.parse(inspect.getsource(module))
    names = set(getattr(module, "__all__", ()))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            names |= {a.name for a in node.names if a.asname == a.name and a.name[0] != "_"}
    names |= {n.name for n in tree.body if isinstance(n, ast.ClassDef) and not names}
    return {name: getattr(module, name) for name in names}


ROOMS = [p.parent.name for p in sorted((ROOT / "sepv").glob("*/__init__.py"))]
PUBLIC = {room: public(import_module(f"sepv.{room}")) for room in (*ROOMS, *FILES)}
DOCUMENTED = [name for page in PAGES for name in DIRECTIVE.findall(page.read_text(encoding="utf-8"))]


def found(name: str) -> Any:
    value: Any = sepv
    for part in name.split(".")[1:]:
        value = getattr(value, part)
    return value


def test_every_public_name_is_documented_once_and_nothing_else() -> None:
    assert sum(map(len, PUBLIC.values())) > 150  # the test sees the names
    assert len(set(DOCUMENTED)) == len(DOCUMENTED)
    objects = {id(found(name)): name for name in DOCUMENTED}
    public_objects = {
        id(value): f"sepv.{room}.{name}" for room, of in PUBLIC.items() for name, value in of.items()
    }
    assert not {name for key, name in public_objects.items() if key not in objects}
    assert not {name for key, name in objects.items() if key not in public_objects}


def test_names_of_sepv_itself_are_among_them() -> None:
    """A name of `sepv` is a room, or documented under this short name."""
    short = {name for name in dir(sepv) if name[0] != "_" and not inspect.ismodule(getattr(sepv, name))}
    assert {f"sepv.{name}" for name in short} <= set(DOCUMENTED)


def test_each_page_is_of_one_room_and_is_listed() -> None:
    index = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    with_names = {room for room, of in PUBLIC.items() if of}
    assert {page.stem for page in PAGES} == with_names
    assert with_names == set(re.findall(r"\(api/(\w+)\.md\)", index))


@pytest.mark.parametrize("name", DOCUMENTED)
def test_the_docstring_of_a_public_name_names_no_private_module(name: str) -> None:
    value = found(name)
    members = vars(value).items() if inspect.isclass(value) else ()
    texts = [inspect.getdoc(value) or "", *(inspect.getdoc(v) or "" for k, v in members if k[0] != "_")]
    assert texts[0]
    assert not PRIVATE.findall("\n".join(texts))
