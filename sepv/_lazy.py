"""Lazy names of a package: they are loaded when they are first used.

`finders` lets a room ask a room above it without importing it: the package's front door names who
answers.
"""

from __future__ import annotations

from importlib import import_module

# `typing` and `collections.abc` take longer to import than the rest of this file.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import Any

# For each kind of thing, "module:function" of what finds one by a name that the asking room does
# not know. The function returns None for a name that it does not know either.
finders: dict[str, str] = {}


def find(kind: str, name: str) -> Any:
    """Call the finder of a kind of thing with a name; the finder's module is imported here."""
    module, _, function = finders[kind].partition(":")
    return getattr(import_module(module), function)(name)


def lazily(room: str, offered: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Make `__getattr__` and `__dir__` of a package that loads its names when they are first used.

    Parameters
    ----------
    room : str
        The name of the package.
    offered : mapping of str
        For each module of the package, the names that the package takes from it, separated by
        blanks. `one=other` is the module's `other` under the name `one`; `*one` is the module
        itself, under the name `one`.
    """
    places = {}
    for module, entries in offered.items():
        for entry in entries.split():
            name, _, attribute = entry.partition("=")
            places[name.lstrip("*")] = (f"{room}.{module}", "" if name[0] == "*" else attribute or name)

    def get(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {room!r} has no attribute {name!r}")
        module, attribute = places[name]
        loaded = import_module(module)
        return getattr(loaded, attribute) if attribute else loaded

    def names() -> list[str]:
        given = {name for name in vars(import_module(room)) if name[0] != "_" or name == "__version__"}
        return sorted((given | {*places}) - {"TYPE_CHECKING", "annotations", "lazily"})

    return get, names
